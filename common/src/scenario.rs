//! The scenario: what is flown, over which field, through which channel, by which strategy.
//!
//! A [`Scenario`] that exists is valid. It is read from TOML: `keys` has the keys of each table, `defaults`, `forms` and
//! `rules` what becomes of them. [`Scenario::to_toml`] writes it back with every default visible. Sensor lists
//! are read by [`crate::sensors`], `[planner]` by the planner.

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

/// Most resource blocks of a UAV: messages hold this many served sensor nodes.
pub const MAX_RESOURCE_BLOCKS: usize = 64;

/// Largest seed, which is TOML's largest number.
pub const MAX_SEED: u64 = i64::MAX as u64;

/// Slots of the longest mission.
const MAX_SLOTS: u64 = 1_000_000_000;

/// Most sensor nodes of a field.
pub(crate) const MAX_SENSORS: u64 = 10_000_000;

/// Bits that one sensor node may sample in a mission: counted through `f64`, exact up to 2^53.
pub(crate) const MAX_SAMPLED_BITS: f64 = 9.0e15;

/// Bits that all sensor nodes together may sample in a mission: the ledger's totals are 64 bits wide.
pub(crate) const MAX_FIELD_BITS: f64 = 9.0e18;

/// The letter's mission (section V), which needs no file.
pub const LETTER: &str = include_str!("../letter.toml");

/// A checked scenario: the keys of its file, every default filled in.
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
    /// What was set instead of the file's values, for messages.
    #[serde(skip)]
    pub settings: Vec<Setting>,
}

/// What the command line changes in a scenario before it is checked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overrides {
    /// Instead of `seed`.
    pub seed: Option<u64>,
    /// Instead of `planner.strategy`.
    pub strategy: Option<&'static str>,
    /// Instead of `slots`; `uav.endurance_s` becomes at least as long as they last.
    pub slots: Option<u64>,
    /// Any keys; those above come after them.
    pub keys: Vec<Setting>,
}

impl Scenario {
    /// Reads and checks a file. A relative sensor list is relative to the file's folder.
    ///
    /// # Errors
    /// If the file cannot be read, is not a scenario, or holds a value out of its range.
    pub fn read(path: &Path, overrides: Overrides) -> Result<Self, InputError> {
        let text = read_text("scenario", path)?;
        Self::parse(&text, path, overrides)
    }

    /// The letter's mission.
    ///
    /// # Errors
    /// If an override is out of its range.
    pub fn letter(overrides: Overrides) -> Result<Self, InputError> {
        Self::parse(LETTER, Path::new("letter.toml (built in)"), overrides)
    }

    /// Checks the text of the scenario file `path`.
    ///
    /// # Errors
    /// If the text is not a scenario or holds a value out of its range.
    pub fn parse(text: &str, path: &Path, overrides: Overrides) -> Result<Self, InputError> {
        let mut table: Table = text.parse().map_err(|error| InputError::toml("scenario", path, text, &error))?;
        if table.contains_key("axes") || table.contains_key("strategies") {
            let message = "it is a sweep: expected a scenario (skysink sweep flies this file)";
            return Err(InputError::new("scenario", path, message));
        }
        Setting::apply_all(&overrides.keys, &mut table)?;
        for (key, number) in [("seed", overrides.seed), ("slots", overrides.slots)] {
            if let Some(number) = number {
                // What TOML cannot write is more than either may be.
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

    /// Where its values come from.
    fn source(&self) -> Source<'_> {
        Source { path: &self.path, settings: &self.settings }
    }

    /// The scenario as a file, every key present.
    ///
    /// # Panics
    /// Never: a scenario is plain tables of numbers and strings.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a scenario is plain tables of numbers and strings")
    }

    /// The scenario as a file whose sensor list is the neighbouring file `list`.
    #[must_use]
    pub fn to_toml_with_list(&self, list: &str) -> String {
        let sensors = Sensors { count: None, file: Some(list.into()), ..self.sensors.clone() };
        Self { sensors, ..self.clone() }.to_toml()
    }

    /// A number that two scenarios share only if they fly the same: of every key but where the sensor list comes from,
    /// which the topic `sensors` carries.
    #[must_use]
    pub fn hash(&self) -> u64 {
        xxhash_rust::xxh3::xxh3_64(self.to_toml_with_list("").as_bytes())
    }

    /// The file with the sensor list, if it is not drawn.
    #[must_use]
    pub fn sensor_file(&self) -> Option<PathBuf> {
        self.sensors.file.as_ref().map(|file| self.path.parent().unwrap_or(Path::new("")).join(file))
    }

    /// Where the UAV starts [m].
    #[must_use]
    pub fn start(&self) -> Point3<f64> {
        let [x_m, y_m] = self.uav.start_m.unwrap_or([f64::NAN; 2]);
        Point3::new(x_m, y_m, self.uav.altitude_m)
    }

    /// Altitudes that can be reached in one slot from `altitude_m` [m], the lowest and the highest.
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
