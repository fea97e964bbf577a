//! The keys of a scenario file: each one once, with its unit, its check and its default, as read and as written.
//!
//! The defaults are the letter's mission (section V). Levels are in dB here and nowhere behind. Rules between keys, and
//! defaults that depend on other keys, are next door.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::planner::PlannerKeys;
use super::value::{
    Count, Exponent, Finite, GainDb, GapDb, LatitudeDeg, LongitudeDeg, MeanBits, Name, NoiseDbm, NonNegative,
    OneOrRange, Positive,
};
use super::{MAX_RESOURCE_BLOCKS, MAX_SEED, MAX_SENSORS, MAX_SLOTS};

/// A scenario file. The keys are documented on [`super::Scenario`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub(super) struct Keys {
    pub name: Name,
    #[serde(default = "Count::of::<1>")]
    pub seed: Count<0, MAX_SEED>,
    #[serde(default = "Count::of::<600>")]
    pub slots: Count<1, MAX_SLOTS>,
    #[serde(default = "one_second")]
    pub slot_s: Positive,
    #[serde(default)]
    pub area: AreaKeys,
    #[serde(default)]
    pub sensors: SensorKeys,
    #[serde(default)]
    pub uav: UavKeys,
    #[serde(default)]
    pub link: LinkKeys,
    #[serde(default)]
    pub planner: PlannerKeys,
}

fn one_second() -> Positive {
    Positive(1.0)
}

/// `[area]`: `side_m`, or `width_m` and `height_m`; and the latitude and longitude of its south-west corner, or neither.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub(super) struct AreaKeys {
    pub side_m: Option<Positive>,
    pub width_m: Option<Positive>,
    pub height_m: Option<Positive>,
    pub origin_lat_deg: Option<LatitudeDeg>,
    pub origin_lon_deg: Option<LongitudeDeg>,
}

/// `[sensors]`: `count` or `file`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct SensorKeys {
    pub count: Option<Count<1, MAX_SENSORS>>,
    pub file: Option<PathBuf>,
    pub capacity_bits: Count<1, { u32::MAX as u64 }>,
    pub sampling_bps: OneOrRange<NonNegative>,
    pub initial_queue_mean_bits: OneOrRange<MeanBits>,
}

impl Default for SensorKeys {
    fn default() -> Self {
        Self {
            count: None,
            file: None,
            capacity_bits: Count::of::<30_000>(),
            sampling_bps: OneOrRange::One(NonNegative(100.0)),
            initial_queue_mean_bits: OneOrRange::One(MeanBits(10_000.0)),
        }
    }
}

/// `[uav]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct UavKeys {
    pub altitude: AltitudeMode,
    pub altitude_m: Positive,
    pub min_altitude_m: Option<Positive>,
    pub max_altitude_m: Option<Positive>,
    pub max_climb_mps: Option<NonNegative>,
    pub max_speed_mps: Positive,
    pub endurance_s: Positive,
    pub start_m: Option<[f64; 2]>,
    pub propulsion: Propulsion,
}

impl Default for UavKeys {
    fn default() -> Self {
        Self {
            altitude: AltitudeMode::Fixed,
            altitude_m: Positive(20.0),
            min_altitude_m: None,
            max_altitude_m: None,
            max_climb_mps: None,
            max_speed_mps: Positive(30.0),
            endurance_s: Positive(600.0),
            start_m: None,
            propulsion: Propulsion::default(),
        }
    }
}

/// `[uav.propulsion]`: a rotary-wing aircraft in the model of Zeng, Xu and Zhang, "Energy Minimization for Wireless
/// Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, with the values of its table I.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub struct Propulsion {
    /// Blade profile power in hovering, `P_0` [W].
    pub blade_profile_w: Positive,
    /// Induced power in hovering, `P_i` [W].
    pub induced_w: Positive,
    /// Speed of the rotor's blade tips, `U_tip` [m/s].
    pub tip_speed_mps: Positive,
    /// Mean rotor induced velocity in hovering, `v_0` [m/s].
    pub hover_induced_mps: Positive,
    /// Fuselage drag ratio, `d_0`.
    pub drag_ratio: NonNegative,
    /// Air density, `ρ` [kg/m³].
    pub air_density_kgpm3: Positive,
    /// Rotor solidity, `s`.
    pub rotor_solidity: Positive,
    /// Rotor disc area, `A` [m²].
    pub rotor_disc_m2: Positive,
}

impl Default for Propulsion {
    fn default() -> Self {
        Self {
            blade_profile_w: Positive(79.86),
            induced_w: Positive(88.63),
            tip_speed_mps: Positive(120.0),
            hover_induced_mps: Positive(4.03),
            drag_ratio: NonNegative(0.6),
            air_density_kgpm3: Positive(1.225),
            rotor_solidity: Positive(0.05),
            rotor_disc_m2: Positive(0.503),
        }
    }
}

/// `[link]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct LinkKeys {
    pub model: LinkModel,
    pub bandwidth_hz: Positive,
    pub tx_power_w: Positive,
    pub noise_dbm: NoiseDbm,
    pub gain_db: Option<OneOrRange<GainDb>>,
    pub gain: Option<GainMode>,
    pub environment: Option<Environment>,
    pub los: Option<LosKeys>,
    pub reference_gain_db: Option<GainDb>,
    pub los_exponent: Option<Exponent>,
    pub nlos_exponent: Option<Exponent>,
    pub nlos_extra_db: Option<GainDb>,
    pub snr_gap_db: Option<GapDb>,
    pub comm_radius_m: Positive,
    pub comm_s: Positive,
    pub resource_blocks: Count<1, { MAX_RESOURCE_BLOCKS as u64 }>,
}

impl Default for LinkKeys {
    fn default() -> Self {
        Self {
            model: LinkModel::FreeSpace,
            bandwidth_hz: Positive(5e6),
            tx_power_w: Positive(0.05),
            noise_dbm: NoiseDbm(-100.0),
            gain_db: None,
            gain: None,
            environment: None,
            los: None,
            reference_gain_db: None,
            los_exponent: None,
            nlos_exponent: None,
            nlos_extra_db: None,
            snr_gap_db: None,
            comm_radius_m: Positive(10.0),
            comm_s: Positive(0.1),
            resource_blocks: Count::of::<4>(),
        }
    }
}

/// `link.los`: parameters of the probability of line of sight instead of an environment's, a and b or b1 to b4.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub(super) struct LosKeys {
    pub a: Option<Positive>,
    pub b: Option<Positive>,
    pub b1: Option<Finite>,
    pub b2: Option<Positive>,
    pub b3: Option<Finite>,
    pub b4: Option<Positive>,
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

/// Whether the reference gain changes during the mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GainMode {
    /// One gain per sensor node and mission.
    Static,
    /// Redrawn from `gain_db` in every slot; the planner knows only the sensor list's.
    PerSlot,
}
