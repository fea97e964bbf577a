//! The reader of sensor lists.

use std::path::Path;

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

use super::world::WORLDS;

/// A list is refused in one line, or its sensor nodes are in their ranges and read back as themselves, in a scenario
/// with an origin, in one without, and in one with the probabilistic channel.
///
/// # Panics
/// If it is neither.
pub fn sensors(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    for world in WORLDS.iter() {
        match SensorList::parse(text, Path::new("list.csv"), &world.scenario) {
            Err(error) => super::assert_one_line(&error),
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
