//! Messages with arbitrary numbers: they have no effect that a valid message could not have.

use std::mem::offset_of;

use arbitrary::{Result, Unstructured};
use bytemuck::Zeroable;
use skysink_common::geometry::{Position, within};
use skysink_common::message::{FlightReport, HoldReason, LinkReport, Mode};
use skysink_common::message::{PathPoint, Plan};
use skysink_common::possible::{Message as _, are_possible_paths};
use skysink_field_sim::Field;
use skysink_flight_sim::Flight;
use skysink_ring::health::Health;

use crate::world::{WORLDS, World, assert_one_line};

/// A report of arbitrary numbers, with at most `links` links other than zero.
pub fn report(u: &mut Unstructured, links: usize) -> Result<FlightReport> {
    let mut report = FlightReport::zeroed();
    let length = offset_of!(FlightReport, links) + links * size_of::<LinkReport>();
    u.fill_buffer(&mut bytemuck::bytes_of_mut(&mut report)[..length])?;
    Ok(report)
}

/// A flight of arbitrary numbers is refused and changes nothing, or moves the bits of its links, and the ledger
/// balances.
pub fn flight(u: &mut Unstructured) -> Result<()> {
    let World { scenario, list } = &WORLDS[0];
    let mut field = Field::new(scenario, list);
    for _ in 1..=4 {
        step(&mut field, &report(u, 6)?, scenario.sensors.capacity_bits.ends()[1]);
    }
    Ok(())
}

/// Advances by a slot with `flight`, and with none, and compares.
fn step(field: &mut Field, flight: &FlightReport, capacity_bits: u32) {
    let slot = field.slot() + 1;
    let before = field.clone();
    let mut unserved = field.clone();
    unserved.step(slot, &[FlightReport::at([0.0, 0.0, 0.0], Mode::Hold)]).expect("no SN is served");
    let links = flight.served_links();
    let known = links.iter().all(|link| (link.sensor as usize) < field.queues_bits().len());
    let Ok(bits) = field.step(slot, &[*flight]) else {
        assert!(!known, "a flight to known sensor nodes is refused");
        assert_eq!((field.queues_bits(), field.totals()), (before.queues_bits(), before.totals()));
        return;
    };
    assert!(known, "a link to an unknown SN is accepted");
    balanced(field, capacity_bits);
    let now = field.totals();
    let then = before.totals();
    let idle = unserved.totals();
    assert_eq!((now.sampled_bits, now.lost_bits), (idle.sampled_bits, idle.lost_bits), "lost because of a flight");
    assert_eq!(now.delivered_bits - then.delivered_bits, bits.delivered_bits);
    assert_eq!(now.lost_bits - then.lost_bits, bits.lost_bits);
    for (sensor, (&queue, &unserved)) in field.queues_bits().iter().zip(unserved.queues_bits()).enumerate() {
        let own = links.iter().filter(|link| link.sensor as usize == sensor);
        let carried: u128 = own.map(|link| u128::from(link.capacity_bits)).sum();
        assert_eq!(u128::from(queue), u128::from(unserved).saturating_sub(carried), "SN {sensor}");
    }
}

/// Fails unless the ledger of a field balances.
pub fn balanced(field: &Field, capacity_bits: u32) {
    let queues = field.queues_bits();
    let totals = field.totals();
    assert!(totals.is_balanced(), "{totals:?}");
    assert!(queues.iter().all(|&queue| queue <= capacity_bits), "{queues:?}");
    assert_eq!(queues.iter().copied().map(u64::from).sum::<u64>(), totals.queued_bits);
}

/// For any plan, the flight is feasible, refusals are counted, and the field accepts the report.
pub fn plan(u: &mut Unstructured) -> Result<()> {
    let world = u.choose(&*WORLDS)?;
    let World { scenario, list } = world;
    let mut flight = Flight::new(scenario, &list.nodes());
    let mut field = Field::new(scenario, list);
    let mut before = flight.start();
    for slot in 1..=6 {
        let is_told = u.arbitrary::<u8>()? % 8 != 7;
        let mut plan = Plan::zeroed();
        u.fill_buffer(bytemuck::bytes_of_mut(&mut plan))?;
        let told = is_told.then_some(plan);
        let report = flight.step(slot, told.as_ref());
        flown(world, &before, told.as_ref(), &report);
        step(&mut field, &report, scenario.sensors.capacity_bits.ends()[1]);
        before = report;
    }
    Ok(())
}

/// Fails unless the report is of a feasible flight, and counts every refusal.
fn flown(World { scenario, list }: &World, before: &FlightReport, told: Option<&Plan>, report: &FlightReport) {
    let area = &scenario.area;
    let here = report.position().xy();
    assert!(within(&before.position().xy(), &here, scenario.reach_m()), "{before:?}, {report:?}");
    let rounding_m = area.border_slack_m();
    assert!(area.contains(&here, rounding_m), "{report:?}");
    let [lowest_m, highest_m] = scenario.altitudes_m(before.z_m);
    assert!((lowest_m..=highest_m).contains(&report.z_m), "{lowest_m} to {highest_m}: {report:?}");
    assert!(FlightReport::are_possible(&[*report]), "{report:?}");
    let links = report.served_links();
    assert!(links.len() <= scenario.link.resource_blocks && links.len() == report.served as usize);
    assert!(links.is_sorted_by(|a, b| a.sensor < b.sensor), "{links:?}");
    for link in links {
        let place = &list.sensors()[link.sensor as usize].position;
        assert!(within(&here, place, scenario.link.comm_radius_m), "{link:?}");
        assert!(link.rate_bps >= 0.0 && link.rate_bps.is_finite(), "{link:?}");
        assert!(told.is_some_and(|plan| plan.scheduled().contains(&link.sensor)), "{link:?}");
    }
    let refused = match (told, HoldReason::from_repr(report.hold).unwrap_or_default()) {
        (None, HoldReason::NoPlan) => 0,
        (Some(_), HoldReason::Waypoint | HoldReason::Base | HoldReason::Zone | HoldReason::Pad) => 1,
        (Some(plan), HoldReason::None) => plan.served - report.served,
        (told, hold) => panic!("{hold:?} after {told:?}"),
    };
    assert_eq!(report.refused, refused);
    let is_held = report.hold != HoldReason::None as u32 && !report.awaits_pad();
    assert_eq!(report.mode == Mode::Hold as u32, is_held);
}

/// A health message decodes to nothing, or to an event whose text is one line and whose encoding decodes to itself.
pub fn health(u: &mut Unstructured) -> Result<()> {
    while !u.is_empty() {
        let [process, event] = u.arbitrary()?;
        let message = Health { process, event, detail: u.arbitrary()?, reserved: u.arbitrary()? };
        if let Some((role, event)) = message.decode() {
            assert_one_line(&event);
            assert_eq!(Health::of(role, event).decode(), Some((role, event)), "{message:?}");
        }
    }
    Ok(())
}

/// Paths are refused, or have at most 64 points each, all of them finite and over the area.
pub fn path(u: &mut Unstructured) -> Result<()> {
    let area = &u.choose(&*WORLDS)?.scenario.area;
    while !u.is_empty() {
        let length = u.arbitrary::<u8>()? % 160;
        let mut point = |_| {
            let [x_m, y_m, z_m] = u.arbitrary()?;
            let uav = u32::from(u.arbitrary::<u8>()? / 100);
            Ok(PathPoint { x_m, y_m, z_m, uav, reserved: 0 })
        };
        let path = (0..length).map(&mut point).collect::<Result<Vec<_>>>()?;
        if are_possible_paths(&path, area, 2) {
            let of_uav = |uav| path.iter().filter(|point| point.uav == uav).count();
            let lengths = [of_uav(0), of_uav(1)];
            assert!(!path.is_empty() && lengths.iter().sum::<usize>() == path.len(), "{path:?}");
            assert!(lengths.iter().all(|length| *length <= 64), "{path:?}");
            for point in &path {
                let [x_m, y_m, z_m] = [point.x_m, point.y_m, point.z_m].map(|m| f64::from(m as f32)); // as drawn
                assert!(area.contains(&Position::new(x_m, y_m), 1e-3) && z_m.is_finite(), "{point:?}");
            }
        }
    }
    Ok(())
}
