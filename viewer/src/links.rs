//! The candidate circles of the winning anchor, and the served links.
//!
//! A link is coloured by its line of sight if that is random, else by its rate.

use std::ops::RangeInclusive;

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::LineStrips3D;
use re_sdk_types::components::Radius;
use skysink_common::channel::{Channel, ChannelModel};
use skysink_common::message::{FlightReport, LinkReport, Plan};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::colour;
use crate::shapes::{Point, drawn, line_style, show_circle};
use crate::sizes::Sizes;

/// The candidate circles, numbered below it.
pub const CANDIDATES: &str = "world/candidates";
/// The chosen candidate circle.
pub const CHOSEN: &str = "world/chosen";
/// Number of candidate circles of a plan.
const CIRCLES: usize = 5;
/// The served links.
pub const LINKS: &str = "world/links";

/// Links and circles of the scene.
pub(crate) struct Links {
    feet: Vec<Point>,
    radius_m: f32,
    /// Height of the circles.
    circles_z_m: f32,
    /// The range of the colour scale [bit/s]; `None` if links are coloured by line of sight.
    pub(crate) rates_bps: Option<RangeInclusive<f64>>,
}

/// Width of a link with and without line of sight, in points of the screen.
const WIDTHS_UI: [f32; 2] = [3.0, 1.4];

impl Links {
    /// Styles links and circles.
    pub(crate) fn open(
        canvas: &Canvas,
        scenario: &Scenario,
        sensors: &Sensors,
        sizes: &Sizes,
    ) -> RecordingStreamResult<Self> {
        for candidate in 0..CIRCLES {
            canvas.log_static(candidate_of(candidate), &line_style(colour::CANDIDATE, 0.8))?;
        }
        canvas.log_static(CHOSEN, &line_style(colour::CHOSEN, 2.2))?;
        let channel = Channel::of(&scenario.link);
        let rates_bps = match channel.line_of_sight() {
            Some(_) => None,
            None => {
                let links = LineStrips3D::update_fields().with_radii([Radius::new_ui_points(1.6)]);
                canvas.log_static(LINKS, &links)?;
                Some(possible_rates_bps(&channel, scenario, sensors))
            }
        };
        Ok(Self {
            feet: sensors.positions.iter().map(|position| [position.x as f32, position.y as f32, 0.0]).collect(),
            radius_m: sizes.radius_m,
            circles_z_m: 0.2 * sizes.layer_m,
            rates_bps,
        })
    }

    /// Shows the circles of a plan; clears them without a plan.
    pub(crate) fn log_circles(&self, canvas: &Canvas, plan: Option<&Plan>) -> RecordingStreamResult<()> {
        let circles_m = plan.map_or([[f64::NAN; 2]; CIRCLES], |plan| plan.circles_m);
        let is_drawn = |centre_m: &&[f64; 2]| centre_m.iter().all(|coordinate_m| coordinate_m.is_finite());
        let centre = |&[x_m, y_m]: &[f64; 2]| [x_m as f32, y_m as f32, self.circles_z_m];
        for (candidate, centre_m) in circles_m.iter().enumerate() {
            let at = Some(centre_m).filter(is_drawn).map(centre);
            show_circle(canvas, &candidate_of(candidate), at, self.radius_m)?;
        }
        let chosen = plan.and_then(|plan| circles_m.get(plan.chosen as usize)).filter(is_drawn);
        show_circle(canvas, CHOSEN, chosen.map(centre), self.radius_m)
    }

    /// Shows the links of all flights; clears them without one.
    pub(crate) fn log_links(&self, canvas: &Canvas, flights: &[FlightReport]) -> RecordingStreamResult<()> {
        let ends = |flight: &FlightReport| drawn(flight.position());
        let served = || {
            flights.iter().flat_map(move |flight| flight.served_links().iter().map(move |link| (ends(flight), link)))
        };
        let strips = served().filter_map(|(uav, link)| Some([uav, *self.feet.get(link.sensor as usize)?]));
        let links_drawn = || served().filter_map(|(_, link)| Some((*self.feet.get(link.sensor as usize)?, link)));
        let links = LineStrips3D::update_fields().with_strips(strips);
        let links = match &self.rates_bps {
            Some(rates_bps) => {
                links.with_colors(links_drawn().map(|(_, link)| colour::of_rate(link.rate_bps, rates_bps)))
            }
            None => links
                .with_colors(links_drawn().map(|(_, link)| of_draw(link, [colour::SIGHT, colour::BLOCKED])))
                .with_radii(links_drawn().map(|(_, link)| Radius::new_ui_points(of_draw(link, WIDTHS_UI)))),
        };
        canvas.show(LINKS, &links)
    }
}

/// The entity of a candidate circle.
fn candidate_of(candidate: usize) -> String {
    format!("{CANDIDATES}/{candidate}")
}

/// Selects the first value for a link with line of sight, else the second.
fn of_draw<T>(link: &LinkReport, [sight, blocked]: [T; 2]) -> T {
    if link.line_of_sight == 1 { sight } else { blocked }
}

/// The range of rates [bit/s]: from the weakest sensor node at the distance `d_c` to the strongest directly below the
/// UAV.
pub(crate) fn possible_rates_bps(channel: &Channel, scenario: &Scenario, sensors: &Sensors) -> RangeInclusive<f64> {
    if matches!(channel, Channel::Map(_)) {
        return 0.0..=channel.best_rate_bps(&channel.uplink_at(1.0, 0.0, scenario.uav.altitude_m));
    }
    let drawn = channel.drawn_gains().unwrap_or([f64::INFINITY, 0.0]);
    let weakest = sensors.gains.iter().copied().fold(drawn[0], f64::min);
    let strongest = sensors.gains.iter().copied().fold(drawn[1], f64::max);
    let radius_m = scenario.link.comm_radius_m;
    let rate_bps = |gain, d2_m2| channel.expected_rate_bps(&channel.uplink_at(gain, d2_m2, scenario.uav.altitude_m));
    rate_bps(weakest, radius_m * radius_m)..=rate_bps(strongest, 0.0)
}
