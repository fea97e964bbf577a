//! Random line of sight: the elevation, the probability and the outcome of line of sight of each served link.
//! Recordings with another channel contain none of this.
//!
//! [`profile`] draws the rates over the altitude. A missing value is logged as NaN, which interrupts a curve; rerun
//! would draw an empty row as 0.

pub mod profile;

use std::sync::Arc;

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{Points3D, Scalars};
use re_sdk_types::blueprint::components::ContainerKind;
use re_sdk_types::components::{MarkerShape, Radius};
use skysink_common::channel::{Channel, LineOfSight, Uplink};
use skysink_common::message::LinkReport;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::blueprint::{Blueprint, class};
use crate::cameras::around_uav;
use crate::canvas::Canvas;
use crate::colour;
use crate::layer::{Layer, LayerRow, LayerSetup, LayerTile, OpenLayer};
use crate::shapes::{curve_style, drawn, point_style};
use crate::sizes::Sizes;
use crate::slot::SlotView;
use crate::views::{film, lock_axis, omit, omit_all, picture, plot, select, select_all};
use crate::{legend, links, path, queues, uav};
use profile::Profile;

/// The page on line of sight.
pub const PAGE: &str = "legend/los";
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

/// The random line of sight of the links.
pub(crate) const LAYER: LayerRow = LayerRow { page, tab, ..LayerRow::new(Los::open) };

/// The line-of-sight entities of the scene.
struct Los {
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
        Ok(Some(Box::new(Self {
            link,
            sensors: Arc::clone(sensors),
            most_links: scenario.link.resource_blocks,
            mark_above_m: 1.8 * sizes.arm_m,
            profile,
        })))
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

impl Layer for Los {
    /// Shows one slot; if it serves no sensor node, only the altitude.
    fn log_slot(&mut self, canvas: &Canvas, view: &SlotView) -> RecordingStreamResult<()> {
        let flight = view.flight();
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

    fn log_missed(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        canvas.append(ALTITUDE, &Scalars::single(f64::NAN))?;
        self.log_links(canvas, 0.0, &[])?;
        self.profile.clear(canvas)
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

/// The page on line of sight and the altitude of the UAV.
fn page(scenario: &Scenario) -> Option<(&'static str, String)> {
    let channel = Channel::of(&scenario.link);
    let link = channel.random_sight()?;
    let fixed = if scenario.uav.climb().is_none() { " This UAV may not choose: its altitude is fixed." } else { "" };
    let drawn = if link.correlation_m.is_none() { "drawn anew in each slot" } else { "as it stays for the mission" };
    Some((PAGE, format!(include_str!("los.md"), fixed = fixed, drawn = drawn)))
}

/// The space around the UAV, its legend, and the curves behind the choice of the altitude.
fn tab(layout: &mut Blueprint, scenario: &Scenario, sizes: &Sizes) -> LayerTile {
    if Channel::of(&scenario.link).random_sight().is_none() {
        return Ok(None);
    }
    let shown = [select_all(queues::WORLD), select_all(SPACE), omit_all(path::TRACK)];
    let hidden = [uav::TRACK, uav::DOT, links::CHOSEN, legend::AXES].map(omit);
    let contents = [&shown[..], &hidden, &[omit_all(links::CANDIDATES)]].concat();
    let room = layout.view(class::SCENE, "Links around the UAV", uav::COVERAGE, &contents)?;
    layout.show_past(room, uav::TRAIL, Some(30), scenario.slot_s)?;
    film(layout, room, &around_uav(sizes))?;
    let page = layout.view(class::TEXT, "What it shows", PAGE, &[select(PAGE)])?;
    let left = layout.container(ContainerKind::Vertical, &[(1.75, room), (1.0, page)])?;

    let why = picture(layout, "Expected rate (green) by altitude", profile::PROFILE, &[], profile::BOUNDS)?;
    let altitude = plot(layout, "Altitude [m]", &[ALTITUDE])?;
    lock_axis(layout, altitude, [-0.08, 1.1].map(|part| part * f64::from(sizes.highest_m)))?;
    let elevation = plot(layout, "Elevation of each served link [°]", &by_draw(ELEVATION))?;
    lock_axis(layout, elevation, [-5.0, 105.0])?;
    let probability = plot(layout, "Probability of sight of each served link", &by_draw(PROBABILITY))?;
    lock_axis(layout, probability, [-0.05, 1.1])?;
    let right = [(1.3, why), (1.0, altitude), (1.0, elevation), (1.0, probability)];
    let right = layout.container(ContainerKind::Vertical, &right)?;
    layout.tab(ContainerKind::Horizontal, "Line of sight", &[(1.9, left), (1.0, right)]).map(Some)
}

/// The curves of the served links below a root, by line of sight.
fn by_draw(root: &str) -> [String; 3] {
    [MEAN, SIGHT, BLOCKED].map(|name| format!("{root}/{name}"))
}
