//! What the picture means, for somebody who sees it for the first time: pages of text and two colour scales.

use std::ops::RangeInclusive;

use rerun::{AnyValues, Boxes3D, Image, Points3D, Radius, RecordingStream, RecordingStreamResult, TextDocument};
use skysink_common::channel::{Channel, LineOfSight};
use skysink_common::scenario::Scenario;

use crate::colour::{self, color};
use crate::los::field;
use crate::shapes::{line_style, writing};
use crate::sizes::{MAX_BARS, Sizes};

/// The page of text.
pub const PAGE: &str = "legend";
/// The page on line of sight.
pub const LOS_PAGE: &str = "legend/los";
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
    rates_bps: Option<&RangeInclusive<f64>>,
) -> RecordingStreamResult<()> {
    stream.log_static(PAGE, &TextDocument::from_markdown(page(scenario, count, sizes)))?;
    if let Channel::LineOfSight(link) = Channel::of(scenario) {
        let page = los_page(scenario, &link);
        stream.log_static(LOS_PAGE, &TextDocument::from_markdown(page))?;
    }
    log_scale(stream, rates_bps)?;
    log_area(stream, sizes)?;
    log_facts(stream, scenario, count)
}

fn page(scenario: &Scenario, count: usize, sizes: &Sizes) -> String {
    let Scenario { name, seed, slots, slot_s, .. } = scenario;
    let (strategy, blocks) = (&scenario.planner.strategy, scenario.link.resource_blocks);
    let (radius_m, altitude_m, grid_m) = (scenario.link.comm_radius_m, scenario.uav.altitude_m, sizes.grid_m);
    let altitude = scenario.uav.climb().map_or(format!("an altitude of {altitude_m} m"), |climb| {
        format!("altitudes from {} m to {} m", climb.min_altitude_m, climb.max_altitude_m)
    });
    let (width_m, height_m, reach_m) = (scenario.area.width_m, scenario.area.height_m, scenario.reach_m());
    let link = match Channel::of(scenario) {
        Channel::FreeSpace(_) => "| green line, dark → pale | served link, by rate: low → high |\n",
        Channel::LineOfSight(_) => {
            "| bold light blue line | served link, in line of sight |\n\
             | thin orange line | served link, its sight blocked |\n"
        }
    };
    let shape = if count <= MAX_BARS { "bar" } else { "point" };
    let height = if count <= MAX_BARS { "; its height too" } else { "" };
    format!(
        "**{name}**: {count} sensor nodes fill their storages; a UAV flies from place to place and empties them.\n\n\
         | What you see | What it means |\n|---|---|\n\
         | {shape}, blue → green → red | sensor node, by queue: empty → full{height} |\n\
         | quadrotor, red arrow | UAV and its heading |\n\
         | blue line | path flown lately; in *Top view* all of it |\n\
         | magenta ring and line | planned waypoint and the way to it |\n\
         | thin violet line, dots | where the plan leads after it, if it is known |\n\
         | cyan circle, plumb line | whom the UAV can serve: within {radius_m} m |\n\
         {link}\
         | five thin orange circles | places considered for the slot |\n\
         | bold orange circle | the place that won |\n\
         | lane: **serve** | at the waypoint of its strategy |\n\
         | lane: **transit** | nobody in reach: off to the fullest queue |\n\
         | lane: **hold** | stays: plan too late or not flyable |\n\
         | lane: **gap** | the viewer missed slots; the mission went on |\n\n\
         In each slot of {slot_s} s the UAV flies up to {reach_m} m at {altitude}; then up to {blocks} \
         sensor nodes within {radius_m} m on the ground upload to it. A full storage loses what its sensor samples.\n\n\
         Strategy **{strategy}**, seed {seed}, {slots} slots, area {width_m} m × {height_m} m, grid {grid_m} m.\n"
    )
}

/// Why the UAV climbs, and what shows it.
fn los_page(scenario: &Scenario, link: &LineOfSight) -> String {
    let percent = 100.0 * field::funnel_chance(link);
    let fixed = if scenario.uav.climb().is_none() { " This UAV may not choose: its altitude is fixed." } else { "" };
    format!(
        "**Why climb?** Buildings block links. The *steeper* a sensor node looks up to the UAV, the likelier it sees it. \
         But the *higher* the UAV, the longer the link and the lower its rate. The best altitude lies between.{fixed}\n\n\
         | What you see | What it means |\n|---|---|\n\
         | right, green line | expected rate here, by altitude: the UAV looks for its top; white line: where it is |\n\
         | right, blue and grey line | what it is made of: chance of line of sight, and rate if there is |\n\
         | dots, bold / thin lines | served links: blue in line of sight, orange blocked, drawn anew in each slot |\n\
         | funnel | from inside, the UAV is seen with a chance of {percent:.0} % or more |\n\
         | square at the UAV | mean chance of the served if it were there, violet → yellow: 0 → 100 % |\n\
         "
    )
}

/// Two bars with their ends written below: queue fill to the left; link rate, or the chance of line of sight, to the
/// right.
fn log_scale(stream: &RecordingStream, rates_bps: Option<&RangeInclusive<f64>>) -> RecordingStreamResult<()> {
    const WIDTH: u32 = 260;
    const HEIGHT: u32 = 20;
    let bar = |colour: &dyn Fn(f64) -> colour::Rgb| {
        let row: Vec<u8> = (0..WIDTH).flat_map(|x| colour(f64::from(x) / f64::from(WIDTH - 1))).collect();
        Image::from_rgb24(row.repeat(HEIGHT as usize), [WIDTH, HEIGHT])
    };
    stream.log_static(format!("{SCALE}/queue/bar"), &bar(&colour::of_fill))?;
    let writing = |texts| writing([[30.0, 24.0], [230.0, 24.0]], texts);
    let queue = ["empty", "full"].map(str::to_owned);
    stream.log_static(format!("{SCALE}/queue/text"), &writing(queue))?;
    let (name, right, ends) = match rates_bps {
        Some(rates_bps) => {
            let (lowest_bps, highest_bps) = (*rates_bps.start(), *rates_bps.end());
            let rate = |share: f64| colour::of_rate(lowest_bps + share * (highest_bps - lowest_bps), rates_bps);
            ("rate", bar(&rate), [lowest_bps, highest_bps].map(format_rate))
        }
        None => ("chance", bar(&colour::of_chance), ["blocked", "in sight"].map(str::to_owned)),
    };
    stream.log_static(format!("{SCALE}/{name}"), &rerun::Transform3D::from_translation([340.0, 0.0, 0.0]))?;
    stream.log_static(format!("{SCALE}/{name}/bar"), &right)?;
    stream.log_static(format!("{SCALE}/{name}/text"), &writing(ends))
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
    let grid = line_style(colour::GRID, 0.5).with_strips(north.chain(east));
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
        .with_component::<Text>("strategy", [scenario.planner.strategy.as_str()])
        .with_component::<Text>("seed", [scenario.seed.to_string()]) // a Scalar is exact up to 2^53 only
        .with_component::<Scalar>("sensors", [count as f64])
        .with_component::<Scalar>("slots", [scenario.slots as f64]);
    stream.send_property("mission", &facts)
}
