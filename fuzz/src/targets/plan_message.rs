//! Plans as the UAV gets them.

use skysink_common::geometry::{Position, within};
use skysink_common::message::{FlightReport, HoldReason, MAX_SERVED, Mode, Plan};
use skysink_common::scenario::Scenario;
use skysink_field_sim::Field;
use skysink_flight_sim::Flight;

use super::flight_message;
use super::world::{WORLDS, World};
use crate::cursor::Cursor;

/// Slack of a border, relative to the extent of the area: rounding of a waypoint on it.
const BORDER: f64 = 1e-9;

/// A plan of any numbers, its schedule after its other numbers.
fn plan(input: &mut Cursor) -> Plan {
    let (x_m, y_m, z_m) = (input.f64(), input.f64(), input.f64());
    let mut plan = Plan::fly_to([x_m, y_m, z_m], Mode::Serve);
    (plan.mode, plan.solver, plan.served) = (input.u32(), input.u32(), input.u32());
    let named = usize::from(input.u8()) % (MAX_SERVED + 1);
    plan.ids[..named].fill_with(|| input.u32());
    (plan.expected_bits, plan.plan_ns) = (input.u64(), input.u64());
    (plan.anchor, plan.partner, plan.chosen) = (input.u32(), input.u32(), input.u32());
    plan
}

/// Whatever it is told, the UAV stays in reach and in the area, serves at most n sensor nodes that are in range, and
/// counts what it refuses; and the field takes its report.
///
/// # Panics
/// If not.
pub fn plan_message(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let World { scenario, list, nodes } = &WORLDS[usize::from(input.u8()) % WORLDS.len()];
    let (mut flight, mut field) = (Flight::new(scenario, nodes), Field::new(scenario, list));
    let places: Vec<Position> = list.sensors().iter().map(|sensor| sensor.position).collect();
    let mut before = flight.start();
    for slot in 1..=6 {
        let told = (input.u8() % 8 != 7).then(|| plan(&mut input));
        let report = flight.step(slot, told.as_ref());
        moved(scenario, &before, &report);
        served(scenario, &places, told.as_ref(), &report);
        flight_message::step(&mut field, &report, scenario.sensors.capacity_bits);
        before = report;
    }
}

/// Fails unless the UAV can have flown from `before` to `after`.
fn moved(scenario: &Scenario, before: &FlightReport, after: &FlightReport) {
    let area = scenario.area;
    assert!(within(&before.position().xy(), &after.position().xy(), scenario.reach_m()), "{before:?}, {after:?}");
    assert!(area.contains(&after.position().xy(), BORDER * area.width_m().max(area.height_m())), "{after:?}");
    let [lowest_m, highest_m] = scenario.altitudes_m(before.z_m);
    assert!((lowest_m..=highest_m).contains(&after.z_m), "{lowest_m} to {highest_m}: {after:?}");
}

/// Fails unless the report tells of a slot that can have been, and counts what was refused.
fn served(scenario: &Scenario, places: &[Position], told: Option<&Plan>, report: &FlightReport) {
    let links = report.served_links();
    assert!(links.len() <= scenario.link.resource_blocks && links.len() == report.served as usize);
    assert!(links.is_sorted_by(|a, b| a.sensor < b.sensor), "{links:?}");
    for link in links {
        let place = &places[link.sensor as usize];
        assert!(within(&report.position().xy(), place, scenario.link.comm_radius_m), "{link:?}");
        assert!(link.rate_bps >= 0.0 && link.rate_bps.is_finite(), "{link:?}");
        assert!(told.is_some_and(|plan| plan.scheduled().contains(&link.sensor)), "{link:?}");
    }
    let refused = match (told, HoldReason::from_repr(report.hold).unwrap_or_default()) {
        (None, HoldReason::NoPlan) => 0,
        (Some(_), HoldReason::Waypoint) => 1,
        (Some(plan), HoldReason::None) => plan.served - report.served,
        (told, hold) => panic!("{hold:?} after {told:?}"),
    };
    assert_eq!(report.refused, refused);
    assert_eq!(report.mode == Mode::Hold as u32, report.hold != HoldReason::None as u32);
}
