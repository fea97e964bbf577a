//! Random line of sight: the elevation, the probability and the outcome of line of sight of each served link.
//! Recordings with another channel contain none of this.
//!
//! [`profile`] draws the rates over the altitude. A missing value is logged as NaN, which interrupts a curve; rerun
//! would draw an empty row as 0.

pub mod profile;

use std::sync::Arc;

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{Points3D, Scalars};
use re_sdk_types::components::{MarkerShape, Radius};
use skysink_common::channel::{Channel, LineOfSight, Uplink};
use skysink_common::message::{FlightReport, LinkReport};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::colour;
use crate::shapes::{curve_style, drawn, point_style};
use crate::sizes::Sizes;
use profile::Profile;

/// Root of the 3D entities.
pub const SPACE: &str = "los";
/// The altitude label beside the UAV.
pub const MARK: &str = "los/altitude";
/// Altitude of the UAV [m].
pub const ALTITUDE: &str = "metrics/los/altitude";
/// Root of the elevation angles [deg] of the served links.
pub const ELEVATION: &str = "metrics/los/elevation";
/// Root of the probabilities of line of sight of the served links, 0 to 1.
pub const PROBABILITY: &str = "metrics/los/probability";
/// Below [`ELEVATION`] and [`PROBABILITY`]: the mean over the served links.
pub const MEAN: &str = "mean";
/// Below them: a point per link with line of sight.
pub const SIGHT: &str = "sight";
/// Below them: a point per link without line of sight.
pub const BLOCKED: &str = "blocked";

/// The line-of-sight entities of the scene.
pub(crate) struct Los {
    link: LineOfSight,
    sensors: Arc<Sensors>,
    most_links: usize,
    mark_above_m: f32,
    profile: Profile,
}

impl Los {
    /// Styles the curves and the 3D entities.
    fn open(canvas: &Canvas, LayerSetup { scenario, sensors, sizes }: LayerSetup<'_>) -> OpenLayer {
        let Some(link) = Channel::of(&scenario.link).random_sight().cloned() else {
            return Ok(None);
        };
        log_styles(canvas)?;
        let profile = Profile::open(canvas, scenario)?;
        Ok(Some(Self {
            link,
            sensors: Arc::clone(sensors),
            most_links: scenario.link.resource_blocks,
            mark_above_m: 1.8 * sizes.arm_m,
            profile,
        }))
    }

    /// Shows one slot; if it serves no sensor node, only the altitude.
    pub(crate) fn log_slot(&mut self, canvas: &Canvas, flight: &FlightReport) -> RecordingStreamResult<()> {
        canvas.append(ALTITUDE, &Scalars::single(flight.z_m))?;
        let [x_m, y_m, z_m] = drawn(flight.position());
        let mark = Points3D::update_fields().with_positions([[x_m, y_m, z_m + self.mark_above_m]]);
        canvas.show(MARK, &mark.with_labels([format!("{:.0} m", flight.z_m)]))?;
        self.log_links(canvas, flight.z_m, flight.served_links())?;
        let position = |link: &LinkReport| self.sensors.positions.get(link.sensor as usize).copied();
        let served: Vec<_> = flight.served_links().iter().filter_map(position).collect();
        if served.is_empty() {
            return self.profile.clear(canvas);
        }
        self.profile.log(canvas, &self.link, flight.position(), &served)
    }

    /// Clears what is outdated in a missed slot.
    pub(crate) fn log_missed(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        canvas.append(ALTITUDE, &Scalars::single(f64::NAN))?;
        self.log_links(canvas, 0.0, &[])?;
        self.profile.clear(canvas)
    }

    /// A point per link, and the mean.
    fn log_links(&self, canvas: &Canvas, z_m: f64, links: &[LinkReport]) -> RecordingStreamResult<()> {
        self.log_curve(canvas, ELEVATION, links, |link| link.elevation_deg)?;
        let probability =
            |link: &LinkReport| self.link.los_probability(&Uplink::at(1.0, link.distance_m * link.distance_m, z_m));
        self.log_curve(canvas, PROBABILITY, links, probability)
    }

    /// The points of one curve, with the same number of values in every slot.
    fn log_curve(
        &self,
        canvas: &Canvas,
        root: &str,
        links: &[LinkReport],
        value: impl Fn(&LinkReport) -> f64,
    ) -> RecordingStreamResult<()> {
        let mean = links.iter().map(&value).sum::<f64>() / links.len() as f64; // NaN if there are none
        canvas.append(format!("{root}/{MEAN}"), &Scalars::single(mean))?;
        for (name, is_in_sight) in [(SIGHT, true), (BLOCKED, false)] {
            let is_shown = |link: &LinkReport| (link.line_of_sight == 1) == is_in_sight;
            let points = links.iter().map(|link| if is_shown(link) { value(link) } else { f64::NAN });
            let points = points.chain(std::iter::repeat(f64::NAN)).take(self.most_links);
            canvas.append(format!("{root}/{name}"), &Scalars::new(points))?;
        }
        Ok(())
    }
}

fn log_styles(canvas: &Canvas) -> RecordingStreamResult<()> {
    canvas.log_static(ALTITUDE, &curve_style("altitude [m]", colour::UAV))?;
    for (root, mean) in [(ELEVATION, "mean elevation [°]"), (PROBABILITY, "mean probability of line of sight")] {
        canvas.log_static(format!("{root}/{MEAN}"), &curve_style(mean, colour::UAV))?;
        for (name, colour) in [(SIGHT, colour::SIGHT), (BLOCKED, colour::BLOCKED)] {
            canvas.log_static(format!("{root}/{name}"), &point_style(name, colour, MarkerShape::Circle, 1.5))?;
        }
    }
    let mark = Points3D::update_fields().with_show_labels(true).with_radii([Radius::new_ui_points(1.0)]);
    canvas.log_static(MARK, &mark.with_colors([colour::WRITING]))
}
