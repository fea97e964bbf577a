//! The map of links under the field (decision D32), at the altitude of the UAV: the rate that is expected of the best
//! link, and, hidden until it is switched on, of the link of each sensor node. A recording does not know which sensor
//! node is selected.

use nalgebra::Point3;
use re_sdk::RecordingStreamResult;
use re_sdk_types::datatypes::ColorModel;
use skysink_common::channel::{Channel, ChannelModel};
use skysink_common::geometry::{Position, above};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::colour;
use crate::links::possible_rates_bps;
use crate::zones::Raster;

/// The best rate from each place over the sensor nodes within `d_c`; only of a map of links.
pub const LINK_MAP: &str = "world/link_map";

/// The rate from each place of each sensor node, numbered below it and hidden at first; of at most 200.
pub const LINK_MAPS: &str = "world/link_maps";

/// Most sensor nodes with a map of their own, each of at most 64 × 64 cells of 4 bytes: 3.3 MB before compression.
const MOST_MAPS: usize = 200;

/// Cells of the longer side of the map of a sensor node.
const CELLS: u32 = 64;

/// Cells of the longer side of that of the best link, and links that are computed for it at most.
const BEST_CELLS: u32 = 160;
const MOST_LINKS: f64 = 2e7;

/// Opacity where there is a link, so that bars and paths stand out.
const OPACITY: f64 = 0.55;

/// A map of links over the area, as an image.
struct LinkImage<'a> {
    canvas: &'a Canvas,
    channel: Channel,
    scenario: &'a Scenario,
    range_bps: std::ops::RangeInclusive<f64>,
}

impl LinkImage<'_> {
    /// Expected rate of the link of a sensor node [bit/s].
    fn rate_bps(&self, sensor: &Position, uav: &Point3<f64>) -> f64 {
        self.channel.expected_rate_bps(&self.channel.uplink(1.0, sensor, uav))
    }

    /// Draws the rates from the places in the cells; those without a link are transparent.
    fn log(
        &self,
        entity: &str,
        cells: u32,
        rate_bps: impl Fn(&Position, &Point3<f64>) -> f64,
    ) -> RecordingStreamResult<()> {
        let pixel = |at: Position| match rate_bps(&at, &above(&at, self.scenario.uav.altitude_m)) {
            rate_bps if rate_bps > 0.0 => {
                let [red, green, blue] = colour::of_rate(rate_bps, &self.range_bps);
                [red, green, blue, u8::MAX].map(|channel| (OPACITY * f64::from(channel)) as u8) // premultiplied
            }
            _ => [0; 4],
        };
        let raster = Raster::over(&self.scenario.area, cells);
        let pixels = raster.centres().flat_map(pixel).collect();
        self.canvas.log_static(entity, &raster.map(pixels, ColorModel::RGBA))
    }
}

/// How maps of links are drawn; `None` without a map of links.
fn image<'a>(canvas: &'a Canvas, scenario: &'a Scenario, sensors: &Sensors) -> Option<LinkImage<'a>> {
    let channel = Channel::of(&scenario.link);
    let range_bps = channel.map().map(|_| possible_rates_bps(&channel, scenario, sensors))?;
    Some(LinkImage { canvas, channel, scenario, range_bps })
}

/// Draws the map of the best link; nothing without a map of links.
pub(crate) fn log_best(canvas: &Canvas, scenario: &Scenario, sensors: &Sensors) -> RecordingStreamResult<()> {
    let Some(image) = image(canvas, scenario, sensors) else { return Ok(()) };
    let affordable = (MOST_LINKS / sensors.count().max(1) as f64).sqrt() as u32;
    image.log(LINK_MAP, BEST_CELLS.min(affordable.max(16)), |at, uav| {
        let mut best_bps = 0.0f64;
        let radius_m = scenario.link.comm_radius_m;
        sensors.grid.visit_within(at, radius_m, |node| best_bps = best_bps.max(image.rate_bps(&node.position, uav)));
        best_bps
    })
}

/// Draws the maps of the sensor nodes, if they are few and have maps of their own.
pub(crate) fn log_each(canvas: &Canvas, scenario: &Scenario, sensors: &Sensors) -> RecordingStreamResult<()> {
    let Some(image) = image(canvas, scenario, sensors) else { return Ok(()) };
    if !has_each(scenario, sensors.count()) {
        return Ok(());
    }
    sensors.positions.iter().enumerate().try_for_each(|(id, sensor)| {
        image.log(&format!("{LINK_MAPS}/{id}"), CELLS, |_, uav| image.rate_bps(sensor, uav))
    })
}

/// Whether there is a map of each of `count` sensor nodes.
pub(crate) fn has_each(scenario: &Scenario, count: usize) -> bool {
    let own = Channel::of(&scenario.link).map().is_some_and(|model| !model.map.names().0.is_empty());
    own && count <= MOST_MAPS
}
