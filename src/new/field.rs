//! The parts of a new scenario that depend on imported positions and zones.

use std::path::PathBuf;

use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// The file name of the sensor list.
pub const LIST: &str = "sensors.csv";

/// The field of a new scenario, converted from an imported file.
#[derive(Default)]
pub struct NewField {
    /// Lines instead of `side_m` in `[area]`.
    pub area: String,
    /// Lines of `[uav]`.
    pub uav: String,
    /// The tables of zones and buildings.
    pub zones: String,
    /// The text of the sensor list; `None` without imported positions.
    pub list: Option<String>,
    /// The location of each of its rows in the imported file, for error messages.
    pub locations: Vec<String>,
    /// The imported file.
    pub source: PathBuf,
    /// Notes to print about the import.
    pub notes: Vec<String>,
    /// What is probably unintended.
    pub warnings: Vec<String>,
}

impl NewField {
    /// Checks the sensor nodes in `scenario`. Errors name the location in the imported file.
    pub fn sensors(&self, scenario: &Scenario) -> Result<SensorList, InputError> {
        match &self.list {
            Some(list) => SensorList::parse_rows(list, &self.source, scenario, |row, _| self.locations[row].clone()),
            None => SensorList::of(scenario),
        }
    }
}
