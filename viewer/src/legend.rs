//! The legend for first-time users: pages of text and colour scales.

use std::ops::RangeInclusive;

use re_sdk::{RecordingStream, RecordingStreamResult};
use re_sdk_types::AnyValues;
use re_sdk_types::archetypes::{Arrows3D, Boxes3D, Image, Points3D, TextDocument, Transform3D};
use re_sdk_types::components::Radius;
use skysink_common::base::{Base, BaseArea};
use skysink_common::channel::Channel;
use skysink_common::estimate::Rates;
use skysink_common::geometry::Position;
use skysink_common::interpolation::interpolate;
use skysink_common::scenario::Scenario;

use crate::canvas::Canvas;
use crate::colour::{self, Rgb};
use crate::shapes::{circle, line_style, text_style, writing};
use crate::sizes::{MAX_BARS, Sizes};

/// The main page.
pub const PAGE: &str = "legend";
/// The colour scales.
pub const SCALE: &str = "scale";
/// Ground, frame and grid of the area.
pub const AREA: &str = "world/area";
/// Numbers at the area's axes.
pub const AXES: &str = "world/area/axes";
/// The arrow to the north.
pub const NORTH: &str = "world/area/north";

/// Text of the area for the views from above.
pub const TEXT_ABOVE: &str = "cameras/top/text";
/// The name of the base for the views from above.
const BASE_ABOVE: &str = "cameras/top/base";

/// The base.
pub const BASE: &str = "world/base";

/// Bounds of the view of the scales, in x and y (down).
pub const SCALE_BOUNDS: [[f64; 2]; 2] = [[-24.0, 624.0], [-12.0, 58.0]];

/// Writes the page of text, with the rows of `layers`; `estimated` says whether the UAV has to estimate the queues.
pub(crate) fn log_page(
    canvas: &Canvas,
    scenario: &Scenario,
    count: usize,
    sizes: &Sizes,
    estimated: Option<Rates>,
    layers: &str,
) -> RecordingStreamResult<()> {
    canvas.log_static(PAGE, &TextDocument::from_markdown(page(scenario, count, sizes, estimated, layers)))
}

/// Text of the legend for estimated queues.
const BELIEF: &str =
    " Tab *Belief and truth*: the queues as the UAV believes them to be, as they are, and the difference.";

/// Text of the legend for a map.
const MAP: &str =
    " Tab *Map*: SNs, paths and UAVs (magenta: the first) on a map, whose background comes from the internet.";

/// Rows of the legend for a base.
const BASE_ROWS: &str = "\
    | light green line | base |\n\
    | lane: **charge** (light green) | in the base: charges, serves no SN |\n\
    | lane: **return** (orange) | flies to the base: energy or time ends; serves on the way; path: the way home |\n\
    | lane: **down** (red) | its energy has ended |\n";

/// Rows of the legend for zones and buildings.
const ZONE_ROWS: &str = "| grey solid / translucent solid | building / no-fly zone |\n";

/// Row of the legend for a map of links.
const LINK_MAP_ROW: &str = "| ground, dark → pale green | rate expected of the best link from there |\n";

/// Row of the legend for buildings that block links.
const SHADOW_ROW: &str = "| ground, dark → light | fraction of the SNs in range that see a UAV there: 0 → 100 % |\n";

fn page(scenario: &Scenario, count: usize, sizes: &Sizes, estimated: Option<Rates>, layers: &str) -> String {
    let fixed = || format!("an altitude of {} m", span(scenario.uav_kinds().map(|uav| uav.altitude_m)));
    let link = match Channel::of(&scenario.link).line_of_sight() {
        None => "| green line, dark → pale | served link, by rate: low → high |\n",
        Some(_) => {
            "| bold light blue line | served link, in line of sight |\n\
             | thin orange line | served link, its sight blocked |\n"
        }
    };
    format!(
        include_str!("legend.md"),
        name = scenario.name,
        count = count,
        shape = if count <= MAX_BARS { "bar" } else { "point" },
        height = if count <= MAX_BARS { "; its height too" } else { "" },
        marks = if count <= MAX_BARS { "| red dot above | SN that has lost data in the mission |\n" } else { "" },
        bursts = if scenario.arrival_law().is_random() {
            "| cyan dot | SN that has sampled more than twice its mean in the slot |\n"
        } else {
            ""
        },
        base = if scenario.base.is_some() { BASE_ROWS } else { "" },
        zones = if scenario.area.no_fly.is_some() || scenario.area.building.is_some() { ZONE_ROWS } else { "" },
        layers = layers,
        shadows = match Channel::of(&scenario.link) {
            Channel::Map(_) => LINK_MAP_ROW,
            channel if channel.buildings().is_some() => SHADOW_ROW,
            _ => "",
        },
        belief = estimated.map_or("", |_| BELIEF),
        link = link,
        slot_s = scenario.slot_s,
        reach_m = span(scenario.kinds().map(|kind| kind.reach_m())),
        altitude = scenario.uav.climb().map_or_else(fixed, |climb| {
            format!("altitudes from {} m to {} m", climb.min_altitude_m, climb.max_altitude_m)
        }),
        blocks = span(scenario.kinds().map(|kind| kind.link.resource_blocks as f64)),
        radius_m = scenario.link.comm_radius_m,
        readout = readout(scenario),
        unit = unit(sizes),
        map = scenario.area.origin().map_or("", |_| MAP),
        strategy = scenario.planner.strategy,
        seed = scenario.seed,
        slots = scenario.slots,
        width_m = scenario.area.width_m(),
        height_m = scenario.area.height_m(),
        grid_m = sizes.grid_m,
    )
}

/// The least and the greatest of numbers, of which there is one; one of them if they are equal.
fn span(numbers: impl Iterator<Item = f64>) -> String {
    let ends = numbers.map(|number| [number; 2]).reduce(|[low, high], [one, _]| [low.min(one), high.max(one)]);
    match ends {
        Some([low, high]) if low < high => format!("{low} to {high}"),
        _ => ends.map_or_else(String::new, |[low, _]| low.to_string()),
    }
}

/// What is written at a UAV.
fn readout(scenario: &Scenario) -> String {
    let first = if scenario.uav.uavs() == 1 { "time since the start" } else { "its number" };
    let battery = if scenario.uav_kinds().any(|uav| uav.battery.is_some()) { ", energy in the battery" } else { "" };
    format!("{first}, altitude, mean speed in the slot{battery}")
}

/// Text of the legend for areas that are shown in a larger unit.
fn unit(sizes: &Sizes) -> String {
    if sizes.unit_m > 1.0 {
        format!(" Positions that the viewer displays in *Field (3D)* are in units of {} m.", sizes.unit_m)
    } else {
        String::new()
    }
}

/// The colour scales: queue fill and overflow at the left; at the right the link rate, or, among buildings, the
/// fraction of the sensor nodes that see a UAV.
pub(crate) fn log_scales(
    canvas: &Canvas,
    scenario: &Scenario,
    rates_bps: Option<&RangeInclusive<f64>>,
) -> RecordingStreamResult<()> {
    let per_cent = [0.0, 0.5, 1.0].map(|fraction| (fraction, format!("{:.0} %", 100.0 * fraction)));
    log_scale(canvas, "queue", 160, &colour::of_fill, per_cent.clone())?;
    canvas.log_static(format!("{SCALE}/overflow"), &Transform3D::from_translation([222.0, 0.0, 0.0]))?;
    log_scale(canvas, "overflow", 40, &|_| colour::LOSS, [(0.5, "loses data".to_owned())])?;
    let at_the_right = Transform3D::from_translation([360.0, 0.0, 0.0]);
    let Some(rates_bps) = rates_bps else {
        if Channel::of(&scenario.link).buildings().is_none() {
            return Ok(());
        }
        canvas.log_static(format!("{SCALE}/sight"), &at_the_right)?;
        return log_scale(canvas, "sight", 200, &colour::of_sight, per_cent);
    };
    canvas.log_static(format!("{SCALE}/rate"), &at_the_right)?;
    let rate_bps = |fraction: f64| interpolate(*rates_bps.start(), *rates_bps.end(), fraction);
    let colour = |fraction: f64| colour::of_rate(rate_bps(fraction), rates_bps);
    log_scale(canvas, "rate", 200, &colour, [0.0, 1.0].map(|fraction| (fraction, format_rate(rate_bps(fraction)))))
}

/// A bar from the colour of 0 to that of 1, with labels below at fractions of its width.
fn log_scale(
    canvas: &Canvas,
    name: &str,
    width: u16,
    colour: &dyn Fn(f64) -> Rgb,
    texts: impl IntoIterator<Item = (f64, String)>,
) -> RecordingStreamResult<()> {
    const HEIGHT: u16 = 20;
    let row: Vec<u8> = (0..width).flat_map(|x| colour(f64::from(x) / f64::from(width - 1))).collect();
    let bar = Image::from_rgb24(row.repeat(HEIGHT.into()), [width, HEIGHT].map(u32::from));
    canvas.log_static(format!("{SCALE}/{name}/bar"), &bar)?;
    let places = texts.into_iter().map(|(fraction, text)| ([fraction as f32 * f32::from(width), 24.0], text));
    canvas.log_static(format!("{SCALE}/{name}/text"), &writing(places))
}

/// Formats a rate with three digits and its unit.
fn format_rate(rate_bps: f64) -> String {
    let (value, unit) = match rate_bps {
        rate if rate >= 1e6 => (rate / 1e6, "Mbit/s"),
        rate if rate >= 1e3 => (rate / 1e3, "kbit/s"),
        rate => (rate, "bit/s"),
    };
    let digits = if value >= 100.0 { 0 } else { 1 };
    format!("{value:.digits$} {unit}")
}

/// The ground, its frame, a grid, the numbers at the axes, and the arrow to the north. The ground is thick enough to
/// hide the sunken part of bars.
pub(crate) fn log_area(canvas: &Canvas, sizes: &Sizes) -> RecordingStreamResult<()> {
    let Sizes { width_m, depth_m, .. } = *sizes;
    let below_m = sizes.layer_m;
    let half_m = 0.5 * sizes.bar_m + below_m;
    let margin_m = sizes.bar_half_m;
    let ground = Boxes3D::from_centers_and_half_sizes(
        [[width_m / 2.0, depth_m / 2.0, -half_m - below_m]],
        [[width_m / 2.0 + margin_m, depth_m / 2.0 + margin_m, half_m]],
    );
    let ground = ground.with_colors([colour::GROUND]).with_fill_mode(re_sdk_types::components::FillMode::Solid);
    canvas.log_static(format!("{AREA}/ground"), &ground)?;
    let z_m = -0.8 * below_m;
    let north = sizes.grid_lines(width_m).map(|x_m| [[x_m, 0.0, z_m], [x_m, depth_m, z_m]]);
    let east = sizes.grid_lines(depth_m).map(|y_m| [[0.0, y_m, z_m], [width_m, y_m, z_m]]);
    let grid = line_style(colour::GRID, 0.5).with_strips(north.chain(east));
    canvas.log_static(format!("{AREA}/grid"), &grid)?;
    let away_m = 0.03 * sizes.longer_m();
    let at_x = sizes.axis_numbers(width_m).map(|x_m| ([x_m, -away_m, 0.0], format!("{x_m} m")));
    let at_y = sizes.axis_numbers(depth_m).skip(1).map(|y_m| ([-1.5 * away_m, y_m, 0.0], format!("{y_m} m")));
    let (places, texts): (Vec<_>, Vec<_>) = at_x.chain(at_y).unzip();
    canvas.log_static(AXES, &text_style(colour::WRITING).with_positions(places).with_labels(texts))?;
    log_north(canvas, sizes)
}

/// An arrow to the north, east of the area.
fn log_north(canvas: &Canvas, sizes: &Sizes) -> RecordingStreamResult<()> {
    let Sizes { north_foot_m, north_m, .. } = *sizes;
    let [x_m, y_m] = north_foot_m;
    let arrow = Arrows3D::from_vectors([[0.0, north_m, 0.0]])
        .with_origins([[x_m, y_m, 0.0]])
        .with_radii([0.04 * north_m])
        .with_colors([colour::WRITING]);
    canvas.log_static(NORTH, &arrow)?;
    let tip = text_style(colour::WRITING).with_positions([[x_m, y_m + 1.35 * north_m, 0.0]]).with_labels(["N"]);
    canvas.log_static(format!("{NORTH}/letter"), &tip)
}

/// Writes the numbers at the axes, the north and the base for the views from above, in which rerun draws no text of the
/// scene.
pub(crate) fn log_text_above(canvas: &Canvas, scenario: &Scenario, sizes: &Sizes) -> RecordingStreamResult<()> {
    let Sizes { depth_m, north_foot_m: [x_m, y_m], north_m, .. } = *sizes;
    let north = ([x_m, depth_m - y_m - 1.6 * north_m], "N".to_owned());
    canvas.log_static(TEXT_ABOVE, &writing(sizes.numbers_on_map().chain([north])))?;
    let Some(base) = scenario.landing_base() else { return Ok(()) };
    let names = base.names().map(|(at, name)| (sizes.on_map(&at), name));
    canvas.log_static(BASE_ABOVE, &writing(names).with_colors([colour::CHARGE]))
}

/// Draws the base, if there is one.
pub(crate) fn log_base(canvas: &Canvas, scenario: &Scenario) -> RecordingStreamResult<()> {
    let Some(base) = scenario.landing_base() else { return Ok(()) };
    let on_ground = |at: &Position| [at.x as f32, at.y as f32, 0.0];
    let closed = |area: &BaseArea| {
        let corners = area.polygon.corners();
        corners.iter().chain(corners.first()).map(on_ground).collect()
    };
    let rims: Vec<Vec<_>> = base
        .shapes()
        .flat_map(|shape| match shape {
            Base::Disk { centre, radius_m } => vec![circle(on_ground(centre), *radius_m as f32)],
            Base::Areas(areas) => areas.iter().map(closed).collect(),
            Base::Sites(_) => Vec::new(), // a shape is none
        })
        .collect();
    canvas.log_static(format!("{BASE}/rim"), &line_style(colour::CHARGE, 2.0).with_strips(rims))?;
    let mut labels: Vec<String> = base.names().map(|(_, name)| name).collect();
    labels.dedup(); // one for all of a single base
    let name = Points3D::new(base.places().map(|place| on_ground(&place)))
        .with_labels(labels)
        .with_show_labels(true)
        .with_radii([Radius::new_ui_points(3.0)])
        .with_colors([colour::CHARGE]);
    canvas.log_static(BASE, &name)
}

/// Logs the properties of the recording, which rerun lists.
pub(crate) fn log_facts(stream: &RecordingStream, scenario: &Scenario, count: usize) -> RecordingStreamResult<()> {
    use re_sdk_types::components::{Scalar, Text};
    let facts = AnyValues::default()
        .with_component::<Text>("scenario", [scenario.name.as_str()])
        .with_component::<Text>("strategy", [scenario.planner.strategy.as_str()])
        .with_component::<Text>("seed", [scenario.seed.to_string()]) // a Scalar is exact up to 2^53 only
        .with_component::<Scalar>("sensors", [count as f64])
        .with_component::<Scalar>("slots", [scenario.slots as f64]);
    stream.send_property("mission", &facts)
}
