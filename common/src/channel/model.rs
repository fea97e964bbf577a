//! What a channel model is: its properties, for one uplink.
//!
//! The models are files beside this one, and variants of [`Channel`](super::Channel).

use enum_dispatch::enum_dispatch;
use nalgebra::Point3;

use super::fading::Fading;
use crate::geometry::{Position, distance_squared, elevation_deg};
use crate::random::Streams;

/// One uplink: the gain of the sensor node, and the position of the UAV relative to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uplink {
    /// Reference channel gain of the sensor node at 1 m, `α_i`, as a linear ratio.
    pub gain: f64,
    /// Squared horizontal distance, `d²` [m²].
    pub d2_m2: f64,
    /// Altitude of the UAV above the sensor node, `z` [m], above 0.
    pub z_m: f64,
    /// Whether no building is between them; true for channels that do not know.
    pub in_sight: bool,
    /// SNR [dB] or rate [bit/s] of a map of links. Infinite where no place is given, and for other channels.
    pub level: f64,
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
    /// The uplink of a sensor node with `gain` on the ground at the position `sensor`, to the UAV at `uav`, in sight of
    /// each other.
    #[must_use]
    #[inline]
    pub fn new(gain: f64, sensor: &Position, uav: &Point3<f64>) -> Self {
        Self::at(gain, distance_squared(&uav.xy(), sensor), uav.z)
    }

    /// The uplink of a sensor node with `gain` on the ground at the squared horizontal distance `d2_m2` [m²], to the
    /// UAV at the altitude `z_m` [m], in sight of each other.
    #[must_use]
    #[inline]
    pub fn at(gain: f64, d2_m2: f64, z_m: f64) -> Self {
        Self { gain, d2_m2, z_m, in_sight: true, level: f64::INFINITY }
    }

    /// Elevation angle `θ` [deg] of the UAV as seen from the sensor node.
    pub fn elevation_deg(&self) -> f64 {
        elevation_deg(self.d2_m2, self.z_m)
    }
}

/// The properties of a channel model.
#[enum_dispatch]
pub trait ChannelModel {
    /// Expected rate [bit/s] of one uplink.
    fn expected_rate_bps(&self, uplink: &Uplink) -> f64;

    /// The slopes of [`Self::expected_rate_bps`].
    fn slopes(&self, uplink: &Uplink) -> Slopes;

    /// Whether the rate is drawn in every slot.
    fn is_random(&self) -> bool;

    /// Draws the uplink of `sensor` in `slot`, from the random stream of the two.
    fn draw(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw;

    /// The highest rate [bit/s] that can be drawn for this uplink, or for one that is longer and not steeper.
    fn best_rate_bps(&self, uplink: &Uplink) -> f64;

    /// The highest rate [bit/s] for this uplink, or for one that is longer and not steeper, with the draw of `sensor`
    /// in `slot`, which does not depend on the position.
    fn best_drawn_rate_bps(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> f64;

    /// Mean over the draws of `value`, a function of the rate [bit/s] that never falls; not below it where the mean is
    /// approximate.
    fn mean_over_draws(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> f64;

    /// The highest [`Self::mean_over_draws`] of this uplink, or of one that is longer and not steeper.
    fn best_mean_over_draws(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        self.mean_over_draws(uplink, value)
    }

    /// Whether the expected rate depends on the elevation angle, so that there is a best altitude. Otherwise it depends
    /// on the distance alone.
    fn depends_on_elevation(&self) -> bool {
        false
    }

    /// Whether each sensor node has its own gain, such as that of a sensor list; otherwise all have the same.
    fn has_own_gains(&self) -> bool {
        true
    }

    /// The fading of the links; `None` if their power does not fade.
    fn fading(&self) -> Option<&Fading> {
        None
    }

    /// The range of the reference gain (linear) that is redrawn in every slot; `None` if gains do not change.
    fn drawn_gains(&self) -> Option<[f64; 2]> {
        None
    }
}

/// Whole bits that `rate_bps` [bit/s] carries in `time_s` [s].
#[inline]
#[must_use]
pub fn carried_bits(rate_bps: f64, time_s: f64) -> u64 {
    (rate_bps * time_s).floor() as u64
}
