//! Texts that people write: scenarios and sensor lists.

use std::path::Path;

use skysink_common::checkpoint::{Checkpoint, encode};
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, HoldReason, Mode};
use skysink_common::scenario::{Count, Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;
use skysink_mission::mission::Mission;
use skysink_planner::settings;

use crate::assert_one_line;
use crate::messages::balanced;
use crate::world::WORLDS;

/// Most sensor nodes that are flown over: a slot takes time with more.
const MOST_FLOWN_OVER: u64 = 16;

/// Most sensor nodes that advance by a slot.
const MOST_SENSORS: u64 = 4096;

/// Slots that are flown.
const SLOTS: u64 = 3;

fn parse(text: &str) -> Result<Scenario, InputError> {
    Scenario::parse(text, Path::new("folder/city.toml"), Overrides::default()).and_then(settings::resolve)
}

/// A text is refused in one line, or is a scenario that reads back as itself.
pub fn scenario(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match parse(text) {
        Err(error) => assert_one_line(&error),
        Ok(scenario) => {
            let written = scenario.to_toml();
            let again = parse(&written).unwrap_or_else(|error| panic!("{error}\n{written}"));
            assert_eq!(again, scenario);
            assert_eq!((again.to_toml(), again.hash()), (written, scenario.hash()));
            let flown = parse(&scenario.to_toml_with_list("sensors.csv")).expect("the run's own copy is a scenario");
            assert_eq!(flown.hash(), scenario.hash());
        }
    }
}

/// A list is refused in one line, or its sensor nodes are in their ranges and read back as themselves, in each world.
pub fn sensors(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    for world in WORLDS.iter() {
        match SensorList::parse(text, Path::new("list.csv"), &world.scenario) {
            Err(error) => assert_one_line(&error),
            Ok(list) => accepted(&list, &world.scenario),
        }
    }
}

fn accepted(list: &SensorList, scenario: &Scenario) {
    assert!(!list.sensors().is_empty());
    for sensor in list.sensors() {
        assert!(scenario.area.contains(&sensor.position, 0.0), "{sensor:?}");
        assert!(sensor.queue_bits <= scenario.sensors.capacity_bits, "{sensor:?}");
        assert!((-300.0..=0.0).contains(&sensor.gain_db), "{sensor:?}");
        assert!(sensor.sampling_bps >= 0.0 && sensor.sampling_bps.is_finite(), "{sensor:?}");
    }
    let written = list.to_csv();
    let again = SensorList::parse(&written, Path::new("written.csv"), scenario);
    assert_eq!(&again.unwrap_or_else(|error| panic!("{error}\n{written}")), list);
}

/// A scenario that is accepted can be flown: the UAV follows its own planner, and no bit is unaccounted for.
pub fn mission(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(scenario) = parse(text) else { return };
    let Some(count @ ..=MOST_SENSORS) = scenario.sensors.count.map(Count::get) else { return };
    let list = SensorList::of(&scenario).expect("sensor nodes are drawn, not read");
    advance(&scenario, &list);
    if count <= MOST_FLOWN_OVER {
        fly(&scenario, &list);
    }
}

fn fly(scenario: &Scenario, list: &SensorList) {
    let mut mission = Mission::new(scenario, list).expect("its planner's keys were checked");
    for _ in 0..SLOTS {
        let Some(flown) = mission.next() else { return };
        let flight = flown.flight;
        assert_eq!((flight.hold, flight.refused), (HoldReason::None as u32, 0), "{:?}", flown.plan);
        assert_ne!(flight.mode, Mode::Hold as u32);
        assert_eq!(flown.header.totals, mission.field().totals());
        balanced(mission.field(), scenario.sensors.capacity_bits);
    }
}

/// The first slot of the field and the last, with nobody served.
fn advance(scenario: &Scenario, list: &SensorList) {
    let mut field = Field::new(scenario, list);
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
