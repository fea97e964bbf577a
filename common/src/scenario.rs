//! The scenario: what is flown, over which field, through which channel, by which strategy.
//!
//! A [`Scenario`] that exists is valid. It is read from TOML: `keys` has every key with its check and default, `resolve`
//! the rules between keys. [`Scenario::to_toml`] writes it back with every default visible. Sensor lists are read by
//! [`crate::sensors`], `[planner]` by the planner.

mod error;
mod keys;
mod planner;
mod resolve;
mod value;

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use toml::{Table, Value};

use crate::geometry::Position;
pub use error::ScenarioError;
pub use keys::{AltitudeMode, Environment, GainMode, LinkModel, Propulsion};
use keys::{Keys, SensorKeys};
pub use planner::PlannerKeys;
pub use value::{Count, NonNegative, Positive};

/// Most resource blocks of a UAV: messages hold this many served sensor nodes.
pub const MAX_RESOURCE_BLOCKS: usize = 64;

/// Largest seed, which is TOML's largest number.
const MAX_SEED: u64 = i64::MAX as u64;

/// Slots of the longest mission.
const MAX_SLOTS: u64 = 1_000_000_000;

/// Most sensor nodes of a field.
const MAX_SENSORS: u64 = 10_000_000;

/// Bits that one sensor node may sample in a mission: counted through `f64`, exact up to 2^53.
pub(crate) const MAX_SAMPLED_BITS: f64 = 9.0e15;

/// Bits that all sensor nodes together may sample in a mission: the ledger's totals are 64 bits wide.
pub(crate) const MAX_FIELD_BITS: f64 = 9.0e18;

/// The letter's mission (section V), which needs no file.
pub const LETTER: &str = include_str!("../../scenarios/letter.toml");

/// A checked scenario in SI units; levels in dB stay only in the sensor node's gain range.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Name of the mission, usable as a folder's name.
    pub name: String,
    /// Seed of every random number of the mission.
    pub seed: u64,
    /// Number of slots, `T`.
    pub slots: u64,
    /// Length of a slot, `τ` [s].
    pub slot_s: f64,
    /// The area that is flown over.
    pub area: Area,
    /// Where the area lies on the Earth, if the file says so.
    pub origin: Option<Origin>,
    /// The sensor nodes.
    pub sensors: Sensors,
    /// The vehicle.
    pub uav: Uav,
    /// The radio.
    pub link: LinkBudget,
    /// The strategy and its keys, which the planner checks.
    pub planner: PlannerKeys,
    /// The file that it was read from, for messages.
    pub path: PathBuf,
    /// The same in the keys and units of the file, every key present but those of the planner.
    keys: Keys,
}

/// The area `[0, width] × [0, height]`, closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// Extent in x [m].
    pub width_m: f64,
    /// Extent in y [m].
    pub height_m: f64,
}

impl Area {
    /// Whether a position lies in the closed area, up to `slack_m` [m]; false for NaN.
    #[must_use]
    pub fn contains(&self, position: &Position, slack_m: f64) -> bool {
        (-slack_m..=self.width_m + slack_m).contains(&position.x)
            && (-slack_m..=self.height_m + slack_m).contains(&position.y)
    }
}

/// The south-west corner of the area on the WGS84 ellipsoid, at altitude 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Geodetic latitude [°], −90 to 90.
    pub lat_deg: f64,
    /// Longitude [°], −180 to 180.
    pub lon_deg: f64,
}

/// The sensor nodes of a scenario, before their list is drawn or read.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensors {
    /// Where their positions come from.
    pub source: SensorSource,
    /// Storage of each, `B` [bit].
    pub capacity_bits: u32,
    /// Lowest and highest sampling rate `s` [bit/s] of those whose list does not name one.
    pub sampling_bps: [f64; 2],
    /// Lowest and highest mean `λ` [bit] of the Poisson initial queue of those whose list does not name one.
    pub initial_queue_mean_bits: [f64; 2],
}

impl Sensors {
    /// The mean of what is uniform between two `ends`, such as [`Sensors::sampling_bps`].
    #[must_use]
    pub fn mean([lowest, highest]: [f64; 2]) -> f64 {
        lowest + (highest - lowest) / 2.0
    }
}

/// Where the positions of the sensor nodes come from.
#[derive(Debug, Clone, PartialEq)]
pub enum SensorSource {
    /// This many, drawn uniformly over the area from the seed.
    Drawn(u32),
    /// A CSV file, its path resolved against the scenario's folder.
    File(PathBuf),
}

/// The vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uav {
    /// Altitude `H` [m], or the one it starts at.
    pub altitude_m: f64,
    /// Range in which it may change its altitude; none at a fixed one.
    pub climb: Option<Climb>,
    /// Top speed `V_max` [m/s].
    pub max_speed_mps: f64,
    /// Longest flight `T_e` [s].
    pub endurance_s: f64,
    /// Where it starts [m].
    pub start: Point3<f64>,
    /// What flying costs.
    pub propulsion: Propulsion,
}

/// How the UAV may change its altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Climb {
    /// Lowest altitude `H_min` [m].
    pub min_altitude_m: f64,
    /// Highest altitude `H_max` [m].
    pub max_altitude_m: f64,
    /// Fastest climb and descent `V_z` [m/s].
    pub max_climb_mps: f64,
}

/// A channel that is in line of sight or not, by chance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LosModel {
    /// Chance of line of sight over the elevation angle.
    pub curve: LosCurve,
    /// Gain at 1 m, `β0`, as a linear ratio.
    pub reference_gain: f64,
    /// Path loss exponent in line of sight, `α_L`.
    pub los_exponent: f64,
    /// Path loss exponent out of line of sight, `α_N`.
    pub nlos_exponent: f64,
    /// Further attenuation out of line of sight, `μ`, as a linear ratio.
    pub nlos_extra: f64,
    /// SNR gap of a real modem, `Γ`, as a linear ratio.
    pub snr_gap: f64,
}

/// Chance of line of sight over the elevation angle `θ` [deg].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LosCurve {
    /// `1/(1 + a e^{−b(θ−a)})`.
    Sigmoid {
        /// Parameter a.
        a: f64,
        /// Parameter b.
        b: f64,
    },
    /// `b3 + b4/(1 + e^{−(b1 + b2 θ)})`, `b3 + b4 = 1`; below 0 it is 0.
    Logistic {
        /// Parameter b1.
        b1: f64,
        /// Parameter b2.
        b2: f64,
        /// Parameter b3.
        b3: f64,
        /// Parameter b4.
        b4: f64,
    },
}

/// The radio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkBudget {
    /// The probabilistic model; none in free space.
    pub los: Option<LosModel>,
    /// Bandwidth of a resource block, `W` [Hz].
    pub bandwidth_hz: f64,
    /// Transmission power of a sensor node, `p` [W].
    pub tx_power_w: f64,
    /// Noise power, `σ²` [W].
    pub noise_w: f64,
    /// Range [dB] of the reference gain at 1 m, `α`, uniform in dB; `β0` twice in the probabilistic model.
    pub gain_db: [f64; 2],
    /// Whether the gain is redrawn.
    pub gain: GainMode,
    /// Communication radius on the ground, `d_c` [m].
    pub comm_radius_m: f64,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
    /// Resource blocks, `n`: the most sensor nodes served in a slot.
    pub resource_blocks: usize,
}

/// What the command line changes in a scenario before it is checked.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Overrides {
    /// Instead of `seed`.
    pub seed: Option<u64>,
    /// Instead of `planner.strategy`.
    pub strategy: Option<&'static str>,
    /// Instead of `slots`; `uav.endurance_s` becomes at least as long as they last.
    pub slots: Option<u64>,
}

impl Scenario {
    /// Reads and checks a file. A relative sensor list is relative to the file's folder.
    ///
    /// # Errors
    /// If the file cannot be read, is not a scenario, or holds a value out of its range.
    pub fn read(path: &Path, overrides: Overrides) -> Result<Self, ScenarioError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ScenarioError::Unreadable { path: path.to_owned(), source })?;
        Self::parse(&text, path, overrides)
    }

    /// The letter's mission.
    ///
    /// # Errors
    /// If an override is out of its range.
    pub fn letter(overrides: Overrides) -> Result<Self, ScenarioError> {
        Self::parse(LETTER, Path::new("letter.toml (built in)"), overrides)
    }

    /// Checks the text of the scenario file `path`.
    ///
    /// # Errors
    /// If the text is not a scenario or holds a value out of its range.
    pub fn parse(text: &str, path: &Path, overrides: Overrides) -> Result<Self, ScenarioError> {
        let mut table: Table = text.parse().map_err(|error| malformed(&error, text, path))?;
        for (key, number) in [("seed", overrides.seed), ("slots", overrides.slots)] {
            if let Some(number) = number {
                // What TOML cannot write is more than either may be.
                table.insert(key.to_owned(), Value::Integer(i64::try_from(number).unwrap_or(-1)));
            }
        }
        let mut keys: Keys = value::read(table, "", path)?;
        if let Some(strategy) = overrides.strategy {
            strategy.clone_into(&mut keys.planner.strategy);
        }
        if let Some(slots) = overrides.slots {
            keys.uav.endurance_s = Positive(keys.uav.endurance_s.0.max(slots as f64 * keys.slot_s.0));
        }
        resolve::resolve(keys, path)
    }

    /// The scenario as a file, every key present.
    #[must_use]
    pub fn to_toml(&self) -> String {
        self.write(self.keys.sensors.clone())
    }

    /// The scenario as a file whose sensor list is the neighbouring file `list`.
    #[must_use]
    pub fn to_toml_with_list(&self, list: &str) -> String {
        let file = Some(PathBuf::from(list));
        self.write(SensorKeys { count: None, file, ..self.keys.sensors.clone() })
    }

    fn write(&self, sensors: SensorKeys) -> String {
        let keys = Keys { sensors, planner: self.planner.clone(), ..self.keys.clone() };
        toml::to_string(&keys).expect("a scenario is plain tables of numbers and strings")
    }

    /// A number that two scenarios share only if they fly the same: of every key but where the sensor list comes from,
    /// which the topic `sensors` carries.
    #[must_use]
    pub fn hash(&self) -> u64 {
        xxhash_rust::xxh3::xxh3_64(self.to_toml_with_list("").as_bytes())
    }

    /// Altitudes that can be reached in one slot from `altitude_m` [m], the lowest and the highest.
    #[must_use]
    pub fn altitudes_m(&self, altitude_m: f64) -> [f64; 2] {
        self.uav.climb.map_or([altitude_m; 2], |climb| {
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

/// One line for what the TOML reader says: its line, the text there, its message.
fn malformed(error: &toml::de::Error, text: &str, path: &Path) -> ScenarioError {
    let place = error.span().map_or_else(String::new, |span| {
        let before = &text[..span.start.min(text.len())];
        let number = before.matches('\n').count() + 1;
        let line = text.lines().nth(number - 1).unwrap_or_default().trim();
        format!("line {number}: `{line}`: ")
    });
    let message = error.message().trim().replace('\n', ", ");
    ScenarioError::Malformed { path: path.to_owned(), place, message }
}
