//! The layout of the scene: views, cameras, axes and timeline.

use re_sdk::RecordingStreamResult;
use re_sdk_types::blueprint::archetypes::{NearClipPlane, TextLogColumns};
use re_sdk_types::blueprint::components::{self, ContainerKind};
use re_sdk_types::blueprint::datatypes::{self, TextLogColumnKind};
use skysink_common::channel::Channel;
use skysink_common::estimate::Rates;
use skysink_common::scenario::Scenario;

use crate::blueprint::{Blueprint, Tile, class};
use crate::cameras::{self, beside_uav, overview};
use crate::recording::Recording;
use crate::sizes::Sizes;
use crate::slot::WallClock;
use crate::views::{film, frame, lock_axis, omit, omit_all, picture, plot, select, select_all};
use crate::{belief, curves, events, geo, layers, legend, link_map, maps, path, queues, uav};

/// Playback speed of a file [slot/s].
pub(crate) const SLOTS_PER_S: f64 = 10.0;

/// Sends the layout with a recording.
pub(crate) fn send(
    recording: &Recording,
    sizes: &Sizes,
    scenario: &Scenario,
    count: usize,
    clock: WallClock,
    estimated: Option<Rates>,
) -> RecordingStreamResult<()> {
    let mut layout = Blueprint::new(recording)?;
    let scenes = scenes(&mut layout, sizes, scenario, count, estimated)?;
    let lane = lane(&mut layout, recording.port, scenario.base.is_some())?;
    let log = log(&mut layout)?;
    let below = layout.container(ContainerKind::Tabs, &[(1.0, lane), (1.0, log)])?;
    let left = layout.container(ContainerKind::Vertical, &[(6.0, scenes), (1.1, below)])?;
    let right = beside(&mut layout, scenario, count, clock, recording.port)?;
    let root = layout.container(ContainerKind::Horizontal, &[(2.1, left), (1.0, right)])?;
    layout.send(&recording.stream, root, SLOTS_PER_S)
}

/// The UAV's state over time: a state lane, or a plot for a live viewer on the port `live`, which follows the mission.
fn lane(layout: &mut Blueprint, live: Option<u16>, has_base: bool) -> RecordingStreamResult<Tile> {
    if live.is_none() {
        let name = match has_base {
            false => "UAV: serve, fly, transit, hold",
            true => "UAV: serve, fly, transit, hold, charge, return, down",
        };
        return layout.view(class::STATES, name, "", &[select(events::LANE), select_all(events::FLEET_LANES)]);
    }
    let name = match has_base {
        false => "UAV: 4 serve (green), 3 fly (blue), 2 transit (lavender), 1 hold (white), 0 gap (grey)",
        true => "UAV: 6 return (orange), 5 charge (light green), 4 serve, 3 fly, 2 transit, 1 hold, 0 gap, -1 down",
    };
    let states: Vec<_> = events::states(has_base).map(|name| format!("{}/{name}", events::STATES)).collect();
    let states = plot(layout, name, &states)?;
    lock_axis(layout, states, if has_base { [-1.6, 6.6] } else { [-0.6, 4.6] })?;
    Ok(states)
}

/// Slots of the flown path in the top view. A map shows the whole path.
pub(crate) const TRACK_SLOTS: u32 = 40;

/// The tabs: three views of the 3D scene, the maps, the legend, and those for estimated queues and of layers.
fn scenes(
    layout: &mut Blueprint,
    sizes: &Sizes,
    scenario: &Scenario,
    count: usize,
    estimated: Option<Rates>,
) -> RecordingStreamResult<Tile> {
    let slot_s = scenario.slot_s;
    let world = select_all(queues::WORLD);
    let uavs = scenario.uav.uavs();
    let omit_each = |entity: &str| if uavs == 1 { omit(entity) } else { omit_all(entity) };
    let show_past = |layout: &Blueprint, view: Tile, entity: &str, slots: Option<u32>| {
        (0..uavs).try_for_each(|uav| layout.show_past(view, &uav::name_of(entity, uav), slots, slot_s))
    };
    let field = [world.clone(), omit_each(uav::TRACK), omit_all(path::TRACK)];
    let field = layout.view(class::SCENE, "Field (3D)", cameras::field_frame(sizes), &field)?;
    show_past(layout, field, uav::TRAIL, Some(15))?;
    let top = [world.clone(), select_all(cameras::TOP), omit_each(uav::TRAIL), omit_all(path::PATH)];
    let top = from_above(layout, "Top view", &str::to_owned, &top, sizes)?;
    show_past(layout, top, uav::TRACK, Some(TRACK_SLOTS))?;
    let mut chase = vec![world, omit_each(uav::TRACK), omit(uav::DOT), omit(legend::AXES), omit_all(path::TRACK)];
    if sizes.has_tall_bars {
        chase.extend([omit(queues::BARS), omit(queues::LOST)]);
    }
    let chase = layout.view(class::SCENE, "Chase", uav::UAV, &chase)?;
    show_past(layout, chase, uav::TRAIL, Some(10))?;
    for (view, camera) in [(field, overview(sizes)), (chase, beside_uav(sizes))] {
        film(layout, view, &camera)?;
    }
    if link_map::has_each(scenario, count) {
        [field, top, chase].into_iter().try_for_each(|view| layout.hide(view, link_map::LINK_MAPS))?;
    }
    let maps = maps(layout, sizes, slot_s)?;
    let mut tabs = vec![(1.0, field), (1.0, top), (1.0, chase), (1.0, maps)];
    if scenario.area.origin().is_some() {
        let map = layout.view(class::MAP, "Map", geo::GEO, &[select_all(geo::GEO)])?;
        show_past(layout, map, geo::TRAIL, None)?;
        tabs.push((1.0, map));
    }
    if estimated.is_some() {
        tabs.push((1.0, beliefs(layout, sizes)?));
    }
    tabs.extend(layers::tabs(layout, scenario, sizes)?.into_iter().map(|tab| (1.0, tab)));
    tabs.push((1.0, layout.view(class::TEXT, "Legend", legend::PAGE, &[select(legend::PAGE)])?));
    layout.container(ContainerKind::Tabs, &tabs)
}

/// The maps of loss, time to overflow, coverage, and the flown path.
fn maps(layout: &mut Blueprint, sizes: &Sizes, slot_s: f64) -> RecordingStreamResult<Tile> {
    let loss = map(layout, "Data lost so far, by SN", maps::LOSS, sizes)?;
    let overflow = map(layout, "Time until each SN is full", maps::OVERFLOW, sizes)?;
    let coverage = map(layout, "How long ago each place was in range", maps::COVERAGE, sizes)?;
    let flown = flown(layout, "All that was flown", &str::to_owned, sizes, slot_s)?;
    four(layout, "Loss and coverage", [loss, overflow, coverage, flown])
}

/// The whole path from above; `name_of` returns the full name of an entity.
pub(crate) fn flown(
    layout: &mut Blueprint,
    title: &str,
    name_of: &dyn Fn(&str) -> String,
    sizes: &Sizes,
    slot_s: f64,
) -> RecordingStreamResult<Tile> {
    let all = [legend::AREA, uav::COVERAGE].map(|entity| select_all(&name_of(entity)));
    let shown = [uav::TRACK, legend::TEXT_ABOVE].map(|entity| select(&name_of(entity)));
    let shown = [&shown[..], &all].concat();
    let view = from_above(layout, title, name_of, &shown, sizes)?;
    layout.show_past(view, &name_of(uav::TRACK), None, slot_s)?;
    Ok(view)
}

/// A view from above, north up; `name_of` returns the full name of an entity. rerun has no camera without perspective:
/// the camera is far away.
pub(crate) fn from_above(
    layout: &mut Blueprint,
    title: &str,
    name_of: &dyn Fn(&str) -> String,
    shown: &[String],
    sizes: &Sizes,
) -> RecordingStreamResult<Tile> {
    let view = layout.view(class::PICTURE, title, &name_of(cameras::TOP), shown)?;
    frame(layout, view, cameras::top_bounds(sizes))?;
    layout.set(view, &NearClipPlane::new(cameras::TOP_NEAR))?;
    Ok(view)
}

/// The estimated and the true queues.
fn beliefs(layout: &mut Blueprint, sizes: &Sizes) -> RecordingStreamResult<Tile> {
    let believed = map(layout, "What the UAV believes: queues", belief::BELIEVED, sizes)?;
    let truth = map(layout, "What is true: queues", belief::TRUE, sizes)?;
    let error = map(layout, "Error: believed − true, of the buffer", belief::ERROR, sizes)?;
    let errors = [belief::MEAN_ERROR, belief::LARGEST_ERROR];
    let curve = plot(layout, "Error ÷ buffer: largest (yellow), mean (grey)", &errors)?;
    lock_axis(layout, curve, [-0.04, 1.1])?;
    four(layout, "Belief and truth", [believed, truth, error, curve])
}

/// A named container of four views in two rows.
fn four(layout: &mut Blueprint, name: &str, [a, b, c, d]: [Tile; 4]) -> RecordingStreamResult<Tile> {
    let above = layout.container(ContainerKind::Horizontal, &[(1.0, a), (1.0, b)])?;
    let below = layout.container(ContainerKind::Horizontal, &[(1.0, c), (1.0, d)])?;
    layout.tab(ContainerKind::Vertical, name, &[(1.0, above), (1.0, below)])
}

/// A map of the entities below `root` and those that all maps share.
fn map(layout: &mut Blueprint, name: &str, root: &str, sizes: &Sizes) -> RecordingStreamResult<Tile> {
    picture(layout, name, root, &[select_all(maps::AREA), select(maps::UAV)], maps::bounds(sizes))
}

/// The column with curves, colour scales and text.
fn beside(
    layout: &mut Blueprint,
    scenario: &Scenario,
    count: usize,
    clock: WallClock,
    live: Option<u16>,
) -> RecordingStreamResult<Tile> {
    let losses = [curves::LOSS, curves::LOSS_MARK];
    let fills = [curves::FILL_MAX, curves::FILL_MEAN];
    let fill = plot(layout, "Queue fill: fullest (yellow), mean (grey)", &fills)?;
    lock_axis(layout, fill, [-0.04, 1.1])?;
    let Scenario { name, seed, planner, .. } = scenario;
    let title = format!("{name}: {}, seed {seed}", planner.strategy);
    let mut rows = vec![
        (0.75, layout.view(class::TEXT, &title, events::STATUS, &[select(events::STATUS)])?),
        (1.5, plot(layout, "Loss rate so far: lost ÷ sampled (red), 1 % (grey)", &losses)?),
        (1.3, fill),
    ];
    if live.is_some() {
        let newest = layout.view(
            class::TEXT,
            "Newest slot, wherever the time cursor is",
            events::NEWEST,
            &[select(events::NEWEST)],
        )?;
        rows.insert(1, (0.5, newest));
    }
    let delivered = if scenario.arrival_law().is_random() {
        plot(layout, "Delivered (green), sampled (cyan) [kbit]", &[curves::DELIVERED, curves::SAMPLED])?
    } else {
        plot(layout, "Delivered [kbit]", &[curves::DELIVERED])?
    };
    let mut others = vec![(1.0, delivered)];
    let (batteries, _): (Vec<String>, Vec<_>) = curves::batteries(scenario).into_iter().unzip();
    if !batteries.is_empty() {
        let title = if batteries.len() == 1 { "Battery [%]" } else { "Batteries [%], in the colours of the UAVs" };
        let battery = plot(layout, title, &batteries)?;
        lock_axis(layout, battery, [-4.0, 110.0])?;
        others.insert(0, (1.0, battery));
    }
    for view in layers::plots(layout, scenario, count)? {
        others.insert(0, (1.0, view));
    }
    if clock == WallClock::Measured {
        others.push((1.0, plot(layout, "Plan [ms]", &[curves::PLAN_LATENCY])?));
        others.push((1.0, plot(layout, "Pace [slot/s]", &[curves::PACE])?));
    }
    others.push((1.0, plot(layout, "Missed slots", &[curves::MISSED])?));
    rows.push((1.5, layout.container(ContainerKind::Tabs, &others)?));
    let channel = Channel::of(&scenario.link);
    let colours = match channel.line_of_sight() {
        None => "Colours: queue fill, link rate; more in the tab Legend",
        Some(_) if channel.buildings().is_some() => "Colours: queue fill, SNs in sight; more in Legend",
        Some(_) => "Colours: queue fill; more in the tab Legend",
    };
    rows.push((0.7, picture(layout, colours, legend::SCALE, &[], legend::SCALE_BOUNDS)?));
    layout.container(ContainerKind::Vertical, &rows)
}

fn log(layout: &mut Blueprint) -> RecordingStreamResult<Tile> {
    let view = layout.view(class::LOG, "Events", events::LOG, &[select(events::LOG)])?;
    let columns = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body]
        .map(|kind| components::TextLogColumn(datatypes::TextLogColumn { visible: true.into(), kind }));
    layout.set(view, &TextLogColumns::update_fields().with_text_log_columns(columns))?;
    Ok(view)
}
