//! Line of sight, where it is a matter of chance: under which angle and with which chance each served sensor node sees
//! the UAV, and what came of it. A free-space recording has none of this.
//!
//! The room around the UAV is drawn by [`field`], the choice of an altitude by [`profile`]. What is not there is a
//! number that is none: it breaks a curve, where the library would draw an empty row as 0.

pub mod field;
pub mod profile;

use rerun::components::MarkerShape;
use rerun::{Points3D, Radius, RecordingStream, RecordingStreamResult, Scalars, SeriesPoints};
use skysink_common::channel::{Channel, LineOfSight};
use skysink_common::message::{FlightReport, LinkReport, SensorNode};
use skysink_common::scenario::Scenario;

use crate::colour::{self, color};
use crate::files::Part;
use crate::shapes::{curve_style, position};
use crate::sizes::Sizes;
use field::Field;
use profile::Profile;

/// Root of what is drawn in space.
pub const SPACE: &str = "los";
/// The UAV's altitude, written beside it.
pub const MARK: &str = "los/altitude";
/// Altitude of the UAV [m].
pub const ALTITUDE: &str = "metrics/los/altitude";
/// Root of the elevation angles [deg] of the served links.
pub const ELEVATION: &str = "metrics/los/elevation";
/// Root of their chances of line of sight, 0 to 1.
pub const CHANCE: &str = "metrics/los/chance";
/// Below [`ELEVATION`] and [`CHANCE`]: the mean over the served links.
pub const MEAN: &str = "mean";
/// Below them: a point for each link in line of sight.
pub const SIGHT: &str = "sight";
/// Below them: a point for each link out of line of sight.
pub const BLOCKED: &str = "blocked";

/// Line of sight of the scene.
pub struct Los {
    link: LineOfSight,
    feet_m: Vec<[f64; 2]>,
    most_links: usize,
    mark_above_m: f32,
    field: Field,
    profile: Profile,
}

/// A served link as the curves show it.
#[derive(Debug, Clone, Copy)]
struct Seen {
    in_sight: bool,
    elevation_deg: f64,
    chance: f64,
}

impl Los {
    /// Styles the curves and what is drawn in space; nothing in free space.
    pub(crate) fn open(
        stream: &RecordingStream,
        scenario: &Scenario,
        sensors: &[SensorNode],
        sizes: &Sizes,
        part: Part,
    ) -> RecordingStreamResult<Option<Self>> {
        let Channel::LineOfSight(link) = Channel::of(scenario) else {
            return Ok(None);
        };
        log_styles(stream)?;
        let most_links = scenario.link.resource_blocks;
        let feet_m = sensors.iter().map(|sensor| [sensor.x_m, sensor.y_m]).collect();
        let field = Field::open(stream, &link, most_links, sizes, part)?;
        let profile = Profile::open(stream, scenario)?;
        Ok(Some(Self { link, feet_m, most_links, mark_above_m: 1.8 * sizes.arm_m, field, profile }))
    }

    /// Shows one slot; where nobody is served, only the altitude.
    pub(crate) fn log_slot(&mut self, stream: &RecordingStream, flight: &FlightReport) -> RecordingStreamResult<()> {
        stream.log(ALTITUDE, &Scalars::single(flight.z_m))?;
        let [x_m, y_m, z_m] = position(flight);
        let mark = Points3D::update_fields().with_positions([[x_m, y_m, z_m + self.mark_above_m]]);
        stream.log(MARK, &mark.with_labels([format!("{:.0} m", flight.z_m)]))?;
        self.log_links(stream, flight.z_m, flight.served_links())?;
        let (feet_m, links) = (&self.feet_m, flight.served_links());
        let served_m: Vec<_> = links.iter().filter_map(|link| feet_m.get(link.sensor as usize).copied()).collect();
        let uav_m = [flight.x_m, flight.y_m, flight.z_m];
        self.field.log(stream, &self.link, uav_m, &served_m)?;
        self.profile.log(stream, &self.link, uav_m, &served_m)
    }

    /// Takes away what a missed slot would show wrongly.
    pub(crate) fn log_missed(&mut self, stream: &RecordingStream) -> RecordingStreamResult<()> {
        stream.log(ALTITUDE, &Scalars::single(f64::NAN))?;
        self.log_links(stream, 0.0, &[])?;
        self.field.clear(stream)?;
        self.profile.clear(stream)
    }

    /// A point per link, and the mean.
    fn log_links(&self, stream: &RecordingStream, z_m: f64, links: &[LinkReport]) -> RecordingStreamResult<()> {
        let seen: Vec<_> = links
            .iter()
            .map(|link| Seen {
                in_sight: link.line_of_sight == 1,
                elevation_deg: link.elevation_deg,
                chance: self.link.los_probability(link.distance_m * link.distance_m, z_m),
            })
            .collect();
        self.log_curve(stream, ELEVATION, &seen, |link| link.elevation_deg)?;
        self.log_curve(stream, CHANCE, &seen, |link| link.chance)
    }

    /// One curve's points, as many numbers in every slot.
    fn log_curve(
        &self,
        stream: &RecordingStream,
        root: &str,
        seen: &[Seen],
        value: impl Fn(&Seen) -> f64,
    ) -> RecordingStreamResult<()> {
        let mean = seen.iter().map(&value).sum::<f64>() / seen.len() as f64; // of nobody: not a number
        stream.log(format!("{root}/{MEAN}"), &Scalars::single(mean))?;
        for (name, in_sight) in [(SIGHT, true), (BLOCKED, false)] {
            let points = seen.iter().map(|link| if link.in_sight == in_sight { value(link) } else { f64::NAN });
            let points = points.chain(std::iter::repeat(f64::NAN)).take(self.most_links);
            stream.log(format!("{root}/{name}"), &Scalars::new(points))?;
        }
        Ok(())
    }
}

fn log_styles(stream: &RecordingStream) -> RecordingStreamResult<()> {
    stream.log_static(ALTITUDE, &curve_style("altitude [m]", colour::UAV))?;
    for (root, mean) in [(ELEVATION, "mean elevation [°]"), (CHANCE, "mean chance of line of sight")] {
        stream.log_static(format!("{root}/{MEAN}"), &curve_style(mean, colour::UAV))?;
        for (name, colour) in [(SIGHT, colour::SIGHT), (BLOCKED, colour::BLOCKED)] {
            let points = SeriesPoints::new()
                .with_names([name])
                .with_colors([color(colour)])
                .with_markers([MarkerShape::Circle])
                .with_marker_sizes([1.5]);
            stream.log_static(format!("{root}/{name}"), &points)?;
        }
    }
    let mark = Points3D::update_fields().with_show_labels(true).with_radii([Radius::new_ui_points(1.0)]);
    stream.log_static(MARK, &mark.with_colors([color(colour::WRITING)]))
}
