//! The tables of a scenario file: each key with its unit.
//!
//! Ranges of numbers are in `rules`, default values in `defaults`. Levels are in dB here and in the sensor list;
//! messages and channels are linear.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::value::{Count, Interval, count};
use super::{MAX_RESOURCE_BLOCKS, MAX_SENSORS};
use crate::geometry::Position;
use crate::units::watts_of_dbm;

/// `[area]`: the area `[0, width] × [0, height]`, closed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub struct Area {
    /// Side of a square [m]; the alternative to width and height.
    pub side_m: Option<f64>,
    /// Extent in x [m].
    pub width_m: Option<f64>,
    /// Extent in y [m].
    pub height_m: Option<f64>,
    /// Geodetic latitude of the south-west corner on the WGS84 ellipsoid [°], −90 to 90; `None` without geodetic
    /// coordinates.
    pub origin_lat_deg: Option<f64>,
    /// Longitude of the same corner [°], −180 to 180.
    pub origin_lon_deg: Option<f64>,
}

impl Area {
    /// An area without geodetic coordinates.
    #[must_use]
    pub const fn new(width_m: f64, height_m: f64) -> Self {
        Self {
            side_m: None,
            width_m: Some(width_m),
            height_m: Some(height_m),
            origin_lat_deg: None,
            origin_lon_deg: None,
        }
    }

    /// Extent in x [m].
    #[must_use]
    pub fn width_m(&self) -> f64 {
        self.width_m.or(self.side_m).unwrap_or(f64::NAN)
    }

    /// Extent in y [m].
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.height_m.or(self.side_m).unwrap_or(f64::NAN)
    }

    /// Its south-west corner on the ellipsoid; `None` without geodetic coordinates.
    #[must_use]
    pub fn origin(&self) -> Option<Origin> {
        Some(Origin { lat_deg: self.origin_lat_deg?, lon_deg: self.origin_lon_deg? })
    }

    /// Whether a position lies in the closed area, up to `slack_m` [m]; false for NaN.
    #[must_use]
    pub fn contains(&self, position: &Position, slack_m: f64) -> bool {
        (-slack_m..=self.width_m() + slack_m).contains(&position.x)
            && (-slack_m..=self.height_m() + slack_m).contains(&position.y)
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

/// `[sensors]`: the sensor nodes, before their list is drawn or read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub struct Sensors {
    /// Number of sensor nodes, drawn uniformly over the area from the seed; `None` if there is a file.
    pub count: Option<Count<1, MAX_SENSORS>>,
    /// CSV file of the sensor list, relative to the scenario's folder.
    pub file: Option<PathBuf>,
    /// Buffer of each, `B` [bit].
    #[serde(deserialize_with = "count::<1, { u32::MAX as u64 }, _, _>")]
    pub capacity_bits: u32,
    /// Sampling rate `s` [bit/s], unless the list has the column.
    pub sampling_bps: Interval,
    /// Mean `λ` [bit] of the Poisson initial queue, unless the list has the column.
    pub initial_queue_mean_bits: Interval,
}

/// `[uav]`: the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub struct UavKeys {
    /// Whether it may change its altitude.
    #[serde(default)]
    pub altitude: AltitudeMode,
    /// Altitude `H` [m]; the initial one if the altitude is free.
    pub altitude_m: f64,
    /// Lowest altitude `H_min` [m]; present if the altitude is free, as are the next two.
    pub min_altitude_m: Option<f64>,
    /// Highest altitude `H_max` [m].
    pub max_altitude_m: Option<f64>,
    /// Fastest climb and descent `V_z` [m/s].
    pub max_climb_mps: Option<f64>,
    /// Top speed `V_max` [m/s].
    pub max_speed_mps: f64,
    /// Longest flight `T_e` [s].
    pub endurance_s: f64,
    /// Start on the ground plane [m]; always present in a checked scenario.
    pub start_m: Option<[f64; 2]>,
    /// Parameters of the propulsion power.
    #[serde(default)]
    pub propulsion: Propulsion,
}

/// Limits of a free altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Climb {
    /// Lowest altitude `H_min` [m].
    pub min_altitude_m: f64,
    /// Highest altitude `H_max` [m].
    pub max_altitude_m: f64,
    /// Fastest climb and descent `V_z` [m/s].
    pub max_climb_mps: f64,
}

impl UavKeys {
    /// The limits of a free altitude; `None` if the altitude is fixed.
    #[must_use]
    pub fn climb(&self) -> Option<Climb> {
        let climb = Climb {
            min_altitude_m: self.min_altitude_m?,
            max_altitude_m: self.max_altitude_m?,
            max_climb_mps: self.max_climb_mps?,
        };
        (self.altitude == AltitudeMode::Free).then_some(climb)
    }
}

/// `[uav.propulsion]`: a rotary-wing aircraft in the model of Zeng, Xu and Zhang, "Energy Minimization for Wireless
/// Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, with the values of its table I.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
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

/// `[link]`: the radio. Each channel model has its own keys.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
pub struct LinkBudget {
    /// Channel model.
    pub model: LinkModel,
    /// Bandwidth of a resource block, `W` [Hz].
    pub bandwidth_hz: f64,
    /// Transmission power of a sensor node, `p` [W].
    pub tx_power_w: f64,
    /// Noise power, `σ²` [dBm].
    pub noise_dbm: f64,
    /// Free space: the reference gain at 1 m, `α` [dB]; a range is uniform in dB.
    pub gain_db: Option<Interval>,
    /// Free space: whether the gain is redrawn.
    pub gain: Option<GainMode>,
    /// Probabilistic line of sight: the surroundings; the alternative to `los`.
    pub environment: Option<Environment>,
    /// Probabilistic line of sight: the probability over the elevation angle.
    pub los: Option<LosCurve>,
    /// Probabilistic line of sight: gain at 1 m, `β0` [dB].
    pub reference_gain_db: Option<f64>,
    /// Path loss exponent in line of sight, `α_L`.
    pub los_exponent: Option<f64>,
    /// Path loss exponent out of line of sight, `α_N`.
    pub nlos_exponent: Option<f64>,
    /// Further attenuation out of line of sight, `μ` [dB].
    pub nlos_extra_db: Option<f64>,
    /// SNR gap of a real modem, `Γ` [dB].
    pub snr_gap_db: Option<f64>,
    /// Communication radius on the ground, `d_c` [m].
    pub comm_radius_m: f64,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
    /// Resource blocks, `n`: the most sensor nodes served in a slot.
    #[serde(deserialize_with = "count::<1, { MAX_RESOURCE_BLOCKS as u64 }, _, _>")]
    pub resource_blocks: usize,
}

impl LinkBudget {
    /// Noise power, `σ²` [W].
    #[must_use]
    pub fn noise_w(&self) -> f64 {
        watts_of_dbm(self.noise_dbm)
    }

    /// Range [dB] of the reference gain at 1 m; in the probabilistic model, which has one gain, both ends are `β0`.
    #[must_use]
    pub fn gain_range_db(&self) -> [f64; 2] {
        self.gain_db.map_or([self.reference_gain_db.unwrap_or_default(); 2], Interval::ends)
    }

    /// Probability of line of sight over the elevation angle; `None` in free space.
    #[must_use]
    pub fn los_curve(&self) -> Option<LosCurve> {
        self.los.or_else(|| self.environment.map(Environment::curve))
    }
}

/// `link.los`: probability of line of sight over the elevation angle `θ` [deg].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "expected { a = , b = } or { b1 = , b2 = , b3 = , b4 = }, all of them numbers"
)]
pub enum LosCurve {
    /// `1/(1 + a e^{−b(θ−a)})`.
    Sigmoid {
        /// Parameter a.
        a: f64,
        /// Parameter b.
        b: f64,
    },
    /// `b3 + b4/(1 + e^{−(b1 + b2 θ)})`, `b3 + b4 = 1`, clamped to 0.
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

/// Channel model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LinkModel {
    /// Line of sight at a fixed altitude (UTS eq. 4).
    FreeSpace,
    /// At random in or out of line of sight (UTS section IV).
    ProbabilisticLos,
}

/// Whether the UAV may change its altitude.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AltitudeMode {
    /// Constant altitude.
    #[default]
    Fixed,
    /// The UAV climbs and descends within a range.
    Free,
}

/// Surroundings with published parameters of the line-of-sight probability, from open to built up.
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
    /// Its probability of line of sight.
    #[must_use]
    pub fn curve(self) -> LosCurve {
        let [a, b] = match self {
            Self::Suburban => [4.88, 0.43],
            Self::Urban => [9.61, 0.16],
            Self::DenseUrban => [12.08, 0.11],
            Self::HighRise => [27.23, 0.08],
        };
        LosCurve::Sigmoid { a, b }
    }
}

/// Whether the reference gain changes during the mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GainMode {
    /// One gain per sensor node and mission.
    Static,
    /// Redrawn from `gain_db` in every slot; the planner knows only that of the sensor list.
    PerSlot,
}
