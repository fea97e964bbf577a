//! The scenario file as it is written: its keys, units and defaults, not yet checked.
//!
//! The defaults are the letter's mission (section V). Levels are in dB here and nowhere behind.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::planner::PlannerKeys;

/// A scenario file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)] // the keys are documented on the checked types
pub struct Scenario {
    pub name: String,
    #[serde(default = "one")]
    pub seed: u64,
    #[serde(default = "letter::slots")]
    pub slots: u64,
    #[serde(default = "letter::slot_s")]
    pub slot_s: f64,
    #[serde(default)]
    pub area: Area,
    #[serde(default)]
    pub sensors: Sensors,
    #[serde(default)]
    pub uav: Uav,
    #[serde(default)]
    pub link: Link,
    #[serde(default)]
    pub planner: PlannerKeys,
}

fn one() -> u64 {
    1
}

/// `[area]`: `side_m`, or `width_m` and `height_m`; and the latitude and longitude of its south-west corner, or neither.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Area {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin_lat_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin_lon_deg: Option<f64>,
}

/// `[sensors]`: `count` or `file`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)]
pub struct Sensors {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub count: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    pub capacity_bits: u64,
    pub sampling_bps: OneOrRange,
    pub initial_queue_mean_bits: OneOrRange,
}

/// `[uav]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)]
pub struct Uav {
    pub altitude: AltitudeMode,
    pub altitude_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_altitude_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_altitude_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_climb_mps: Option<f64>,
    pub max_speed_mps: f64,
    pub endurance_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_m: Option<[f64; 2]>,
    pub propulsion: Propulsion,
}

/// `[uav.propulsion]`: a rotary-wing aircraft in the model of Zeng, Xu and Zhang, "Energy Minimization for Wireless
/// Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, with the values of its table I.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Propulsion {
    /// Blade profile power in hovering, `P_0` [W].
    pub blade_profile_w: f64,
    /// Induced power in hovering, `P_i` [W].
    pub induced_w: f64,
    /// Speed of the rotor's blade tips, `U_tip` [m/s].
    pub tip_speed_mps: f64,
    /// Mean rotor induced velocity in hovering, `v_0` [m/s].
    pub hover_induced_mps: f64,
    /// Fuselage drag ratio, `d_0`.
    pub drag_ratio: f64,
    /// Air density, `ρ` [kg/m³].
    pub air_density_kgpm3: f64,
    /// Rotor solidity, `s`.
    pub rotor_solidity: f64,
    /// Rotor disc area, `A` [m²].
    pub rotor_disc_m2: f64,
}

impl Default for Propulsion {
    fn default() -> Self {
        Self {
            blade_profile_w: 79.86,
            induced_w: 88.63,
            tip_speed_mps: 120.0,
            hover_induced_mps: 4.03,
            drag_ratio: 0.6,
            air_density_kgpm3: 1.225,
            rotor_solidity: 0.05,
            rotor_disc_m2: 0.503,
        }
    }
}

/// `[link]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)]
pub struct Link {
    pub model: LinkModel,
    pub bandwidth_hz: f64,
    pub tx_power_w: f64,
    pub noise_dbm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_db: Option<OneOrRange>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<GainMode>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<Environment>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub los: Option<LosFit>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_gain_db: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub los_exponent: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nlos_exponent: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nlos_extra_db: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snr_gap_db: Option<f64>,
    pub comm_radius_m: f64,
    pub comm_s: f64,
    pub resource_blocks: u64,
}

/// Channel model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LinkModel {
    /// Line of sight at a fixed altitude (UTS eq. 4).
    FreeSpace,
    /// In line of sight or not, by chance (UTS section IV).
    ProbabilisticLos,
}

/// Whether the UAV may change its altitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AltitudeMode {
    /// It stays at its altitude.
    Fixed,
    /// It climbs and descends within its range.
    Free,
}

/// Surroundings with known parameters of line of sight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Environment {
    /// (a, b) = (4.88, 0.43).
    Suburban,
    /// (a, b) = (9.61, 0.16).
    Urban,
    /// (a, b) = (12.08, 0.11).
    DenseUrban,
    /// (a, b) = (27.23, 0.08).
    HighRise,
}

impl Environment {
    /// All of them, from open to built up.
    pub const ALL: [Self; 4] = [Self::Suburban, Self::Urban, Self::DenseUrban, Self::HighRise];

    /// The name in scenario files and figures.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Suburban => "suburban",
            Self::Urban => "urban",
            Self::DenseUrban => "dense-urban",
            Self::HighRise => "high-rise",
        }
    }

    /// Parameters (a, b) of its chance of line of sight.
    #[must_use]
    pub fn sigmoid(self) -> (f64, f64) {
        match self {
            Self::Suburban => (4.88, 0.43),
            Self::Urban => (9.61, 0.16),
            Self::DenseUrban => (12.08, 0.11),
            Self::HighRise => (27.23, 0.08),
        }
    }
}

/// Parameters of the chance of line of sight, instead of an environment's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, deny_unknown_fields, expecting = "expected { a = , b = } or { b1 = , b2 = , b3 = , b4 = }")]
#[allow(missing_docs)]
pub enum LosFit {
    Sigmoid { a: f64, b: f64 },
    Logistic { b1: f64, b2: f64, b3: f64, b4: f64 },
}

/// A value of the sensor nodes: one number for all of them, or the ends of the range that each draws its own from.
#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number or [lowest, highest]")]
pub enum OneOrRange {
    /// The same for all.
    One(f64),
    /// Drawn uniformly; levels uniformly in dB.
    Range([f64; 2]),
}

impl OneOrRange {
    /// The lowest value and the highest.
    #[must_use]
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::One(value) => [value; 2],
            Self::Range(ends) => ends,
        }
    }
}

/// As in the file.
impl fmt::Debug for OneOrRange {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::One(value) => value.fmt(formatter),
            Self::Range(ends) => ends.fmt(formatter),
        }
    }
}

/// Whether the reference gain changes during the mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GainMode {
    /// One gain per sensor node and mission.
    Static,
    /// Redrawn from `gain_db` in every slot; the planner knows only the sensor list's.
    PerSlot,
}

/// The letter's values (section V).
pub(super) mod letter {
    use super::{AltitudeMode, GainMode, Link, LinkModel, OneOrRange, Propulsion, Sensors, Uav};

    pub const SIDE_M: f64 = 100.0;
    pub const COUNT: u64 = 200;

    pub const GAIN_DB: OneOrRange = OneOrRange::Range([-55.0, -50.0]);
    pub const GAIN: GainMode = GainMode::Static;

    pub fn slots() -> u64 {
        600
    }

    pub fn slot_s() -> f64 {
        1.0
    }

    impl Default for Sensors {
        fn default() -> Self {
            Self {
                count: None,
                file: None,
                capacity_bits: 30_000,
                sampling_bps: OneOrRange::One(100.0),
                initial_queue_mean_bits: OneOrRange::One(10_000.0),
            }
        }
    }

    impl Default for Uav {
        fn default() -> Self {
            Self {
                altitude: AltitudeMode::Fixed,
                min_altitude_m: None,
                max_altitude_m: None,
                max_climb_mps: None,
                altitude_m: 20.0,
                max_speed_mps: 30.0,
                endurance_s: 600.0,
                start_m: None,
                propulsion: Propulsion::default(),
            }
        }
    }

    impl Default for Link {
        fn default() -> Self {
            Self {
                model: LinkModel::FreeSpace,
                bandwidth_hz: 5e6,
                tx_power_w: 0.05,
                noise_dbm: -100.0,
                gain_db: None,
                gain: None,
                environment: None,
                los: None,
                reference_gain_db: None,
                los_exponent: None,
                nlos_exponent: None,
                nlos_extra_db: None,
                snr_gap_db: None,
                comm_radius_m: 10.0,
                comm_s: 0.1,
                resource_blocks: 4,
            }
        }
    }
}
