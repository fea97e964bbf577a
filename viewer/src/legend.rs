//! What the picture means, for somebody who sees it for the first time: a page of text and two colour scales.

use std::ops::RangeInclusive;

use rerun::{
    AnyValues, Boxes3D, Image, LineStrips3D, Points2D, Points3D, Radius, RecordingStream, RecordingStreamResult,
    TextDocument,
};
use skysink_common::scenario::Scenario;

use crate::colour::{self, color};
use crate::sizes::{MAX_BARS, Sizes};

/// The page of text.
pub const PAGE: &str = "legend";
/// The colour scales.
pub const SCALE: &str = "scale";
/// Ground, frame and grid of the area.
pub const AREA: &str = "world/area";
/// Writing at the area's corners.
pub const CORNERS: &str = "world/area/corners";

/// Bounds of the scales' picture, in x and y (down).
pub const SCALE_BOUNDS: [[f64; 2]; 2] = [[-20.0, 620.0], [-12.0, 58.0]];

/// Draws everything that explains and never changes.
pub(crate) fn log(
    stream: &RecordingStream,
    scenario: &Scenario,
    count: usize,
    sizes: &Sizes,
    rates_bps: &RangeInclusive<f64>,
) -> RecordingStreamResult<()> {
    stream.log_static(PAGE, &TextDocument::from_markdown(page(scenario, count, sizes)))?;
    log_scale(stream, rates_bps)?;
    log_area(stream, sizes)?;
    log_facts(stream, scenario, count)
}

fn page(scenario: &Scenario, count: usize, sizes: &Sizes) -> String {
    let Scenario { name, seed, slots, slot_s, .. } = scenario;
    let (strategy, blocks) = (scenario.planner.strategy.name(), scenario.link.resource_blocks);
    let (radius_m, altitude_m, grid_m) = (scenario.link.comm_radius_m, scenario.uav.altitude_m, sizes.grid_m);
    let (width_m, height_m, reach_m) = (scenario.area.width_m, scenario.area.height_m, scenario.reach_m());
    let shape = if count <= MAX_BARS { "bar" } else { "point" };
    let height = if count <= MAX_BARS { "; its height too" } else { "" };
    format!(
        "**{name}**: {count} sensor nodes fill their storages; a UAV flies from place to place and empties them.\n\n\
         | What you see | What it means |\n|---|---|\n\
         | {shape}, blue → green → red | sensor node, by queue: empty → full{height} |\n\
         | quadrotor, red arrow | UAV and its heading |\n\
         | blue line | path flown lately; in *Top view* all of it |\n\
         | magenta ring and line | planned waypoint and the way to it |\n\
         | cyan circle, plumb line | whom the UAV can serve: within {radius_m} m |\n\
         | green line, dark → pale | served link, by rate: low → high |\n\
         | five thin orange circles | places considered for the slot |\n\
         | bold orange circle | the place that won |\n\
         | lane: **serve** | at the waypoint of its strategy |\n\
         | lane: **transit** | nobody in reach: off to the fullest queue |\n\
         | lane: **hold** | stays: plan too late or not flyable |\n\
         | lane: **gap** | the viewer missed slots; the mission went on |\n\n\
         In each slot of {slot_s} s the UAV flies up to {reach_m} m at an altitude of {altitude_m} m; then up to {blocks} \
         sensor nodes within {radius_m} m on the ground upload to it. A full storage loses what its sensor samples.\n\n\
         Strategy **{strategy}**, seed {seed}, {slots} slots, area {width_m} m × {height_m} m, grid {grid_m} m.\n"
    )
}

/// Two bars with their ends written below: queue fill to the left, link rate to the right.
fn log_scale(stream: &RecordingStream, rates_bps: &RangeInclusive<f64>) -> RecordingStreamResult<()> {
    const WIDTH: u32 = 260;
    const HEIGHT: u32 = 20;
    let bar = |colour: &dyn Fn(f64) -> colour::Rgb| {
        let row: Vec<u8> = (0..WIDTH).flat_map(|x| colour(f64::from(x) / f64::from(WIDTH - 1))).collect();
        Image::from_rgb24(row.repeat(HEIGHT as usize), [WIDTH, HEIGHT])
    };
    let (lowest_bps, highest_bps) = (*rates_bps.start(), *rates_bps.end());
    let rate = |share: f64| colour::of_rate(lowest_bps + share * (highest_bps - lowest_bps), rates_bps);
    stream.log_static(format!("{SCALE}/queue/bar"), &bar(&colour::of_fill))?;
    stream.log_static(format!("{SCALE}/rate/bar"), &bar(&rate))?;
    stream.log_static(format!("{SCALE}/rate"), &rerun::Transform3D::from_translation([340.0, 0.0, 0.0]))?;
    let writing = |texts: [String; 2]| {
        Points2D::new([[30.0, 24.0], [230.0, 24.0]])
            .with_labels(texts)
            .with_show_labels(true)
            .with_radii([0.1])
            .with_colors([color(colour::WRITING)])
    };
    let queue = ["empty", "full"].map(str::to_owned);
    let rates = [lowest_bps, highest_bps].map(format_rate);
    stream.log_static(format!("{SCALE}/queue/text"), &writing(queue))?;
    stream.log_static(format!("{SCALE}/rate/text"), &writing(rates))
}

/// A rate with three digits and its unit.
fn format_rate(rate_bps: f64) -> String {
    let (value, unit) = match rate_bps {
        rate if rate >= 1e6 => (rate / 1e6, "Mbit/s"),
        rate if rate >= 1e3 => (rate / 1e3, "kbit/s"),
        rate => (rate, "bit/s"),
    };
    let digits = if value >= 100.0 { 0 } else { 1 };
    format!("{value:.digits$} {unit}")
}

/// The ground, its frame, a grid, and the extent written at two corners.
fn log_area(stream: &RecordingStream, sizes: &Sizes) -> RecordingStreamResult<()> {
    let (width_m, depth_m, grid_m) = (sizes.width_m, sizes.depth_m, sizes.grid_m);
    let below_m = 0.01 * sizes.radius_m;
    let ground = Boxes3D::from_centers_and_half_sizes(
        [[width_m / 2.0, depth_m / 2.0, -2.0 * below_m]],
        [[width_m / 2.0, depth_m / 2.0, below_m]],
    );
    let ground = ground.with_colors([color(colour::GROUND)]).with_fill_mode(rerun::FillMode::Solid);
    stream.log_static(format!("{AREA}/ground"), &ground)?;
    let steps = |length_m: f32| (0..).map(move |step| step as f32 * grid_m).take_while(move |&at_m| at_m < length_m);
    let z_m = -0.8 * below_m;
    let north = steps(width_m).chain([width_m]).map(|x_m| [[x_m, 0.0, z_m], [x_m, depth_m, z_m]]);
    let east = steps(depth_m).chain([depth_m]).map(|y_m| [[0.0, y_m, z_m], [width_m, y_m, z_m]]);
    let grid = LineStrips3D::new(north.chain(east))
        .with_colors([color(colour::GRID)])
        .with_radii([Radius::new_ui_points(0.5)]);
    stream.log_static(format!("{AREA}/grid"), &grid)?;
    let corners = Points3D::new([[0.0, 0.0, 0.0], [width_m, 0.0, 0.0], [0.0, depth_m, 0.0]])
        .with_labels(["0 m".to_owned(), format!("x = {width_m} m"), format!("y = {depth_m} m")])
        .with_show_labels(true)
        .with_radii([Radius::new_ui_points(1.5)])
        .with_colors([color(colour::WRITING)]);
    stream.log_static(CORNERS, &corners)
}

/// The run's facts, which the viewer lists as properties of the recording.
fn log_facts(stream: &RecordingStream, scenario: &Scenario, count: usize) -> RecordingStreamResult<()> {
    use rerun::components::{Scalar, Text};
    let facts = AnyValues::default()
        .with_component::<Text>("scenario", [scenario.name.as_str()])
        .with_component::<Text>("strategy", [scenario.planner.strategy.name()])
        .with_component::<Text>("seed", [scenario.seed.to_string()]) // a Scalar is exact up to 2^53 only
        .with_component::<Scalar>("sensors", [count as f64])
        .with_component::<Scalar>("slots", [scenario.slots as f64]);
    stream.send_property("mission", &facts)
}
