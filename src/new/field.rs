//! The parts of a new scenario that depend on its field.

use std::path::PathBuf;

use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// The file name of the sensor list.
pub const LIST: &str = "sensors.csv";

/// The parts of a new scenario that depend on its field.
pub struct NewField {
    /// Lines instead of `side_m` in `[area]`.
    pub area: Option<String>,
    /// Lines instead of `count` in `[sensors]`.
    pub sensors: Option<String>,
    /// The sensor list, if there is one.
    pub list: Option<NewList>,
    /// Notes to print about the import.
    pub notes: Vec<String>,
}

impl NewField {
    /// The paper's field.
    pub fn drawn() -> Self {
        Self { area: None, sensors: None, list: None, notes: Vec::new() }
    }
}

/// The sensor list of a new scenario, converted from an imported file.
pub struct NewList {
    /// The text of the file.
    pub text: String,
    /// The location of each row in the imported file, for error messages.
    pub locations: Vec<String>,
    /// The imported file.
    pub source: PathBuf,
}

impl NewList {
    /// Checks the sensor nodes in `scenario`. Errors name the location in the imported file.
    pub fn sensors(&self, scenario: &Scenario) -> Result<SensorList, InputError> {
        SensorList::parse_rows(&self.text, &self.source, scenario, |row, _| self.locations[row].clone())
    }
}
