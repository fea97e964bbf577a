//! Scenarios that are flown.

use std::path::Path;

use skysink_common::checkpoint::{Checkpoint, encode};
use skysink_common::message::{FlightReport, HoldReason, Mode};
use skysink_common::scenario::{Count, Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;
use skysink_mission::mission::Mission;
use skysink_planner::settings;

use super::flight_message::balanced;

/// Most sensor nodes that are flown over: a slot takes time with more.
const MOST_FLOWN_OVER: u64 = 16;

/// Most sensor nodes that live through a slot.
const MOST_SENSORS: u64 = 4096;

/// Slots that are flown.
const SLOTS: u64 = 3;

/// A scenario that is accepted can be flown: the UAV follows its own planner, and no bit is unaccounted for.
///
/// # Panics
/// If not.
pub fn mission(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(scenario) = Scenario::parse(text, Path::new("city.toml"), Overrides::default()).and_then(settings::resolve)
    else {
        return;
    };
    match scenario.sensors.count.map(Count::get) {
        Some(..=MOST_FLOWN_OVER) => fly(&scenario),
        Some(..=MOST_SENSORS) => live(&scenario),
        _ => {}
    }
}

fn fly(scenario: &Scenario) {
    let mut mission = Mission::new(scenario, &list(scenario)).expect("its planner's keys were checked");
    for _ in 0..SLOTS {
        let Some(flown) = mission.next() else { return };
        let (plan, flight, totals) = (flown.plan, flown.flight, flown.header.totals);
        assert_eq!((flight.hold, flight.refused), (HoldReason::None as u32, 0), "{plan:?}");
        assert_ne!(flight.mode, Mode::Hold as u32);
        assert!(totals.is_balanced(), "{totals:?}");
        assert_eq!(mission.queues_bits().iter().copied().map(u64::from).sum::<u64>(), totals.queued_bits);
    }
}

/// The first slot of the field and the last, with nobody served.
fn live(scenario: &Scenario) {
    let mut field = Field::new(scenario, &list(scenario));
    let nobody = FlightReport::at([0.0, 0.0, 0.0], Mode::Hold);
    let mut saved = Vec::new();
    field.save(&mut saved);
    for slot in [1, scenario.slots] {
        let mut state = Vec::new();
        encode(&(slot - 1), &mut state); // a state begins with its slot, and 0 takes one byte
        state.extend_from_slice(&saved[1..]);
        field.restore(&state).expect("nobody has delivered anything");
        field.step(slot, &nobody).expect("nobody is served");
        balanced(&field, scenario.sensors.capacity_bits);
    }
}

fn list(scenario: &Scenario) -> SensorList {
    SensorList::of(scenario).expect("sensor nodes are drawn, not read")
}
