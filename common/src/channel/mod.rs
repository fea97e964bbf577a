//! The radio channel of an uplink: its expected rate, its slopes with the position of the UAV, and its rate in a slot.
//!
//! Each model is a variant and a file. Planners use the expected rate; only flight-sim draws.

mod free_space;
mod line_of_sight;

pub use free_space::{FreeSpace, draw_gain_db};
pub use line_of_sight::LineOfSight;

use nalgebra::Point3;

use crate::geometry::{Position, distance_squared, elevation_deg};
use crate::random::Streams;
use crate::scenario::Scenario;

/// The channel of all uplinks of a mission, one resource block wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Channel {
    /// Free space, with one gain per sensor node.
    FreeSpace(FreeSpace),
    /// Probabilistic line of sight, by the elevation angle, with one gain for all sensor nodes.
    LineOfSight(LineOfSight),
}

/// One uplink: the gain of the sensor node, and the position of the UAV relative to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uplink {
    /// Reference channel gain of the sensor node at 1 m, `α_i`, as a linear ratio.
    pub gain: f64,
    /// Squared horizontal distance, `d²` [m²].
    pub d2_m2: f64,
    /// Altitude of the UAV, `z` [m], above 0.
    pub z_m: f64,
}

/// A channel in one slot, as drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draw {
    /// Whether the link is in line of sight.
    pub line_of_sight: bool,
    /// Its rate [bit/s].
    pub rate_bps: f64,
}

/// The partial derivatives of an expected rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slopes {
    /// By the squared distance `D² = d² + z²`, at a constant elevation angle [bit/s/m²].
    pub by_distance2: f64,
    /// By the elevation angle, at a constant distance [bit/s/°].
    pub by_elevation: f64,
}

impl Uplink {
    /// The uplink of a sensor node with `gain` at the position `sensor`, to the UAV at `uav`.
    #[must_use]
    #[inline]
    pub fn new(gain: f64, sensor: &Position, uav: &Point3<f64>) -> Self {
        Self { gain, d2_m2: distance_squared(&uav.xy(), sensor), z_m: uav.z }
    }

    /// Elevation angle `θ` [deg] of the UAV as seen from the sensor node.
    #[must_use]
    pub fn elevation_deg(&self) -> f64 {
        elevation_deg(self.d2_m2, self.z_m)
    }
}

impl Channel {
    /// The channel of a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        LineOfSight::of(scenario).map_or_else(|| Self::FreeSpace(FreeSpace::of(scenario)), Self::LineOfSight)
    }

    /// The probabilistic line-of-sight model; `None` in free space. With it, the rate depends on the elevation angle,
    /// and there is a best altitude.
    #[must_use]
    pub fn line_of_sight(&self) -> Option<&LineOfSight> {
        match self {
            Self::FreeSpace(_) => None,
            Self::LineOfSight(model) => Some(model),
        }
    }

    /// Whether the rate is drawn in every slot.
    #[must_use]
    pub fn is_random(&self) -> bool {
        match self {
            Self::FreeSpace(model) => model.redrawn_db.is_some(),
            Self::LineOfSight(_) => true,
        }
    }

    /// Expected rate [bit/s] of one uplink.
    #[must_use]
    #[inline]
    pub fn expected_rate_bps(&self, uplink: &Uplink) -> f64 {
        match self {
            Self::FreeSpace(model) => model.rate_bps(uplink),
            Self::LineOfSight(model) => model.expected_rate_bps(uplink.d2_m2, uplink.z_m),
        }
    }

    /// The slopes of [`Self::expected_rate_bps`].
    #[must_use]
    #[inline]
    pub fn slopes(&self, uplink: &Uplink) -> Slopes {
        match self {
            Self::FreeSpace(model) => model.slopes(uplink),
            Self::LineOfSight(model) => model.slopes(uplink.d2_m2, uplink.z_m),
        }
    }

    /// Draws the uplink of `sensor` in `slot`, from the random stream of the two.
    #[must_use]
    pub fn draw(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        match self {
            Self::FreeSpace(model) => model.draw(uplink, streams, slot, sensor),
            Self::LineOfSight(model) => model.draw(uplink, streams, slot, sensor),
        }
    }

    /// Whole bits that an uplink of `rate_bps` [bit/s] carries in one slot: `floor(r τ_c)` (UTS eq. 7).
    #[must_use]
    #[inline]
    pub fn capacity_bits(&self, rate_bps: f64) -> u64 {
        let comm_s = match self {
            Self::FreeSpace(model) => model.comm_s,
            Self::LineOfSight(model) => model.comm_s,
        };
        (rate_bps * comm_s).floor() as u64
    }
}
