//! The scenario: the mission, its field, channel and strategy.
//!
//! A [`Scenario`] is valid by construction. It is read from TOML: `keys` declares the keys of each table, `defaults`
//! fills them in, `forms` handles alternative keys, and `rules` checks the values. [`Scenario::to_toml`] writes it back
//! with all defaults. Sensor lists are read by [`crate::sensors`], `[planner]` by the planner.

mod defaults;
mod forms;
mod keys;
mod planner;
mod rules;
mod setting;
mod value;

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

pub use keys::{
    AltitudeMode, Area, Climb, Environment, GainMode, LinkBudget, LinkModel, LosCurve, Origin, Propulsion, Sensors,
    UavKeys,
};
pub use planner::PlannerKeys;
pub use setting::{Setting, SettingOrigin};
pub use value::{Count, Interval};
use value::{Source, count, name};

use crate::error::{InputError, read_text};

/// Most resource blocks of a UAV, and so most served sensor nodes in a message.
pub const MAX_RESOURCE_BLOCKS: usize = 64;

/// Largest seed: the largest integer of TOML.
pub const MAX_SEED: u64 = i64::MAX as u64;

/// Slots of the longest mission.
const MAX_SLOTS: u64 = 1_000_000_000;

/// Most sensor nodes of a field.
pub(crate) const MAX_SENSORS: u64 = 10_000_000;

/// Most bits that one sensor node may sample in a mission: counted through `f64`, which is exact up to 2^53.
pub(crate) const MAX_SAMPLED_BITS: f64 = 9.0e15;

/// Most bits that all sensor nodes together may sample in a mission: the totals of the ledger are `u64`.
pub(crate) const MAX_FIELD_BITS: f64 = 9.0e18;

/// The built-in `letter.toml`: the mission of the UTS letter (arXiv 2103.00753, section V).
pub const LETTER: &str = include_str!("../letter.toml");

/// A checked scenario: the keys of its file with all defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub struct Scenario {
    /// Name of the mission, usable as a folder's name.
    #[serde(deserialize_with = "name")]
    pub name: String,
    /// Seed of every random number of the mission.
    #[serde(deserialize_with = "count::<0, MAX_SEED, _, _>")]
    pub seed: u64,
    /// Number of slots, `T`.
    #[serde(deserialize_with = "count::<1, MAX_SLOTS, _, _>")]
    pub slots: u64,
    /// Length of a slot, `τ` [s].
    pub slot_s: f64,
    /// The area that is flown over.
    pub area: Area,
    /// The sensor nodes.
    pub sensors: Sensors,
    /// The vehicle.
    pub uav: UavKeys,
    /// The radio.
    pub link: LinkBudget,
    /// The strategy and its keys, which the planner checks.
    pub planner: PlannerKeys,
    /// The file that it was read from, for messages.
    #[serde(skip)]
    pub path: PathBuf,
    /// The settings that replaced values of the file, for messages.
    #[serde(skip)]
    pub settings: Vec<Setting>,
}

/// Changes to a scenario from the command line, made before it is checked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overrides {
    /// Replaces `seed`.
    pub seed: Option<u64>,
    /// Replaces `planner.strategy`.
    pub strategy: Option<&'static str>,
    /// Replaces `slots`; `uav.endurance_s` is raised to the length of the mission if it is less.
    pub slots: Option<u64>,
    /// Replaces any keys, before the replacements above.
    pub keys: Vec<Setting>,
}

impl Scenario {
    /// Reads and checks a file. A relative sensor list is relative to the file's folder.
    ///
    /// # Errors
    /// If the file cannot be read, is not a scenario, or has a value out of range.
    pub fn read(path: &Path, overrides: Overrides) -> Result<Self, InputError> {
        let text = read_text("scenario", path)?;
        Self::parse(&text, path, overrides)
    }

    /// The mission of the paper, [`LETTER`].
    ///
    /// # Errors
    /// If an override is out of range.
    pub fn letter(overrides: Overrides) -> Result<Self, InputError> {
        Self::parse(LETTER, Path::new("letter.toml (built in)"), overrides)
    }

    /// Checks the text of the scenario file `path`.
    ///
    /// # Errors
    /// If the text is not a scenario or has a value out of range.
    pub fn parse(text: &str, path: &Path, overrides: Overrides) -> Result<Self, InputError> {
        let mut table: Table = text.parse().map_err(|error| InputError::toml("scenario", path, text, &error))?;
        if table.contains_key("axes") || table.contains_key("strategies") {
            let message = "it is a sweep: expected a scenario (skysink sweep flies this file)";
            return Err(InputError::new("scenario", path, message));
        }
        Setting::apply_all(&overrides.keys, &mut table)?;
        for (key, number) in [("seed", overrides.seed), ("slots", overrides.slots)] {
            if let Some(number) = number {
                // A number beyond TOML's range is beyond that of either key; -1 is refused.
                table.insert(key.to_owned(), Value::Integer(i64::try_from(number).unwrap_or(-1)));
            }
        }
        defaults::fill(&mut table);
        let mut scenario: Self = value::read(table.clone(), "", Source { path, settings: &overrides.keys })?;
        path.clone_into(&mut scenario.path);
        scenario.settings = overrides.keys;
        if let Some(strategy) = overrides.strategy {
            strategy.clone_into(&mut scenario.planner.strategy);
        }
        if let Some(slots) = overrides.slots {
            scenario.uav.endurance_s = scenario.uav.endurance_s.max(slots as f64 * scenario.slot_s);
        }
        let centre_m = [scenario.area.width_m() / 2.0, scenario.area.height_m() / 2.0];
        scenario.uav.start_m.get_or_insert(centre_m);
        rules::check(&scenario, &table)?;
        Ok(scenario)
    }

    /// The origin of its values, for messages.
    fn source(&self) -> Source<'_> {
        Source { path: &self.path, settings: &self.settings }
    }

    /// The scenario as a TOML file with all keys.
    ///
    /// # Panics
    /// Never: a scenario consists of tables of numbers and strings.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a scenario consists of tables of numbers and strings")
    }

    /// The scenario as a TOML file, with the sensor list in the file `list` of the same folder.
    #[must_use]
    pub fn to_toml_with_list(&self, list: &str) -> String {
        let sensors = Sensors { count: None, file: Some(list.into()), ..self.sensors.clone() };
        Self { sensors, ..self.clone() }.to_toml()
    }

    /// Hash (XXH3) of all keys except the origin of the sensor list, which is published on the topic `sensors`.
    #[must_use]
    pub fn hash(&self) -> u64 {
        xxhash_rust::xxh3::xxh3_64(self.to_toml_with_list("").as_bytes())
    }

    /// The file of the sensor list; `None` if the list is drawn.
    #[must_use]
    pub fn sensor_file(&self) -> Option<PathBuf> {
        self.sensors.file.as_ref().map(|file| self.path.parent().unwrap_or(Path::new("")).join(file))
    }

    /// Start of the UAV [m].
    #[must_use]
    pub fn start(&self) -> Point3<f64> {
        let [x_m, y_m] = self.uav.start_m.unwrap_or([f64::NAN; 2]);
        Point3::new(x_m, y_m, self.uav.altitude_m)
    }

    /// The lowest and the highest altitude that can be reached in one slot from `altitude_m` [m].
    #[must_use]
    pub fn altitudes_m(&self, altitude_m: f64) -> [f64; 2] {
        self.uav.climb().map_or([altitude_m; 2], |climb| {
            let step_m = climb.max_climb_mps * self.slot_s;
            [(altitude_m - step_m).max(climb.min_altitude_m), (altitude_m + step_m).min(climb.max_altitude_m)]
        })
    }

    /// Farthest flight in one slot, `V_max τ` [m].
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        self.uav.max_speed_mps * self.slot_s
    }
}
