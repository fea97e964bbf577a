//! Probability of line of sight and rates of the served links over the altitude, at the UAV's horizontal position.
//!
//! With increasing altitude, the probability of line of sight rises and the rate in line of sight falls. The expected
//! rate has its maximum in between.

use nalgebra::Point3;
use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::LineStrips2D;
use re_sdk_types::components::Radius;
use skysink_common::channel::{ChannelModel, LineOfSight, Uplink};
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::interpolation::interpolate;
use skysink_common::scenario::Scenario;

use crate::canvas::Canvas;
use crate::colour;
use crate::shapes::writing;

/// Root of the picture.
pub const PROFILE: &str = "profile";
/// Mean probability, mean rate in line of sight, mean expected rate, each over the altitude.
pub const CURVES: &str = "profile/curves";
/// The altitude flown.
pub const FLOWN: &str = "profile/flown";
/// Bounds of the picture, in x and y (down).
pub const BOUNDS: [[f64; 2]; 2] = [[-30.0, 216.0], [-12.0, 132.0]];

const WIDTH: f64 = 200.0;
const HEIGHT: f64 = 100.0;
/// Points of a curve.
const STEPS: u16 = 48;

/// The picture of the scene.
pub(crate) struct Profile {
    range_m: [f64; 2],
}

impl Profile {
    pub(crate) fn open(canvas: &Canvas, scenario: &Scenario) -> RecordingStreamResult<Self> {
        let range_m = range_m(scenario);
        let frame = LineStrips2D::new([
            vec![[0.0, 0.0], [0.0, HEIGHT as f32], [WIDTH as f32, HEIGHT as f32]],
            vec![[0.0, 0.0], [WIDTH as f32, 0.0]],
        ]);
        let frame = frame.with_colors([colour::GRID]).with_radii([Radius::new_ui_points(0.7)]);
        canvas.log_static(format!("{PROFILE}/frame"), &frame)?;
        let below = HEIGHT as f32 + 4.0;
        let [lowest_m, highest_m] = range_m;
        let middle_m = 0.5 * (lowest_m + highest_m);
        let altitudes = [(0.0, lowest_m), (0.5, middle_m), (1.0, highest_m)];
        let altitudes =
            altitudes.map(|(along, altitude_m)| ([along * WIDTH as f32, below], format!("{altitude_m:.0} m")));
        let heights = [0.0, 50.0, 100.0]
            .map(|percent: f64| ([-14.0, (HEIGHT * (1.0 - percent / 100.0)) as f32 - 6.0], format!("{percent} %")));
        let ticks = writing(altitudes.into_iter().chain(heights));
        canvas.log_static(format!("{PROFILE}/ticks"), &ticks)?;
        let curves = LineStrips2D::update_fields()
            .with_colors([colour::SIGHT, colour::MISSED, colour::DELIVERY])
            .with_radii([1.6, 1.6, 2.4].map(Radius::new_ui_points));
        canvas.log_static(CURVES, &curves)?;
        let line = LineStrips2D::update_fields().with_colors([colour::UAV]);
        canvas.log_static(FLOWN, &line.with_radii([Radius::new_ui_points(1.0)]))?;
        Ok(Self { range_m })
    }

    /// Shows the curves of the served sensor nodes; at least one.
    pub(crate) fn log(
        &self,
        canvas: &Canvas,
        link: &LineOfSight,
        uav: Point3<f64>,
        served: &[Position],
    ) -> RecordingStreamResult<()> {
        let distances2_m2: Vec<_> = served.iter().map(|sensor| distance_squared(&uav.xy(), sensor)).collect();
        let mean = |value: &dyn Fn(f64) -> f64| {
            distances2_m2.iter().map(|&d2_m2| value(d2_m2)).sum::<f64>() / distances2_m2.len() as f64
        };
        let [lowest_m, highest_m] = self.range_m;
        let unit_bps = mean(&|d2_m2| link.los_rate_bps(d2_m2, lowest_m)); // the most: it falls with the altitude
        let curve = |fraction: &dyn Fn(f64) -> f64| -> Vec<[f32; 2]> {
            (0..=STEPS)
                .map(|step| f64::from(step) / f64::from(STEPS))
                .map(|along| [along * WIDTH, HEIGHT * (1.0 - fraction(interpolate(lowest_m, highest_m, along)))])
                .map(|point| point.map(|coordinate| coordinate as f32))
                .collect()
        };
        let curves = [
            curve(&|z_m| mean(&|d2_m2| link.los_probability(&Uplink::at(1.0, d2_m2, z_m)))),
            curve(&|z_m| mean(&|d2_m2| link.los_rate_bps(d2_m2, z_m)) / unit_bps),
            curve(&|z_m| mean(&|d2_m2| link.expected_rate_bps(&Uplink::at(1.0, d2_m2, z_m))) / unit_bps),
        ];
        canvas.show(CURVES, &LineStrips2D::update_fields().with_strips(curves))?;
        let at = (WIDTH * (uav.z - lowest_m) / (highest_m - lowest_m)) as f32;
        canvas.show(FLOWN, &LineStrips2D::update_fields().with_strips([[[at, 0.0], [at, HEIGHT as f32]]]))
    }

    /// Clears the curves.
    pub(crate) fn clear(&self, canvas: &Canvas) -> RecordingStreamResult<()> {
        canvas.clear(CURVES)?;
        canvas.clear(FLOWN)
    }
}

/// The range of altitudes: those that the UAV may fly, or a range around a fixed one.
fn range_m(scenario: &Scenario) -> [f64; 2] {
    let fixed_m = scenario.uav.altitude_m;
    let fixed = [0.5 * fixed_m, 1.5 * fixed_m];
    let free = scenario.uav.climb().map(|climb| [climb.min_altitude_m, climb.max_altitude_m]);
    free.filter(|[lowest_m, highest_m]| lowest_m < highest_m).unwrap_or(fixed)
}
