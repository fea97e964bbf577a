//! How the scene is arranged on the screen: views, cameras, axes and timeline.

use rerun::external::re_sdk_types::blueprint::archetypes::{
    Background, EyeControls3D, LineGrid3D, PlotLegend, ScalarAxis, SpatialInformation, TextLogColumns, VisualBounds2D,
};
use rerun::external::re_sdk_types::blueprint::components::{self, BackgroundKind, ContainerKind, Eye3DKind};
use rerun::external::re_sdk_types::blueprint::datatypes::{self, TextLogColumnKind};
use rerun::{RecordingStream, RecordingStreamResult};

use crate::colour::{self, color};
use crate::layout::{Class, Layout, Tile};
use crate::scene::Timing;
use crate::sizes::Sizes;
use crate::{curves, events, legend, queues, uav};

/// Slots per second at which a viewer plays a file.
const SLOTS_PER_S: f64 = 10.0;

/// Sends the layout of the screen along with the recording `name`.
pub(crate) fn send(
    stream: &RecordingStream,
    name: &str,
    sizes: &Sizes,
    slot_s: f64,
    timing: Timing,
) -> RecordingStreamResult<()> {
    let mut layout = Layout::new(name)?;
    let scenes = scenes(&mut layout, sizes, slot_s)?;
    let lane = layout.view(Class::States, "UAV: serve, transit, hold", "", &[select(events::LANE)])?;
    let left = layout.container(ContainerKind::Vertical, &[(6.0, scenes), (1.1, lane)])?;
    let right = beside(&mut layout, timing)?;
    let root = layout.container(ContainerKind::Horizontal, &[(2.1, left), (1.0, right)])?;
    layout.send(stream, root, SLOTS_PER_S)
}

fn select(entity: &str) -> String {
    format!("+ /{entity}")
}

fn omit(entity: &str) -> String {
    format!("- /{entity}")
}

/// The 3D scene, seen in three ways.
fn scenes(layout: &mut Layout, sizes: &Sizes, slot_s: f64) -> RecordingStreamResult<Tile> {
    let world = || select(&format!("{}/**", queues::WORLD));
    let field = [world(), omit(uav::TRACK)];
    let field = layout.view(Class::Scene, "Field (3D)", queues::WORLD, &field)?;
    layout.show_past(field, uav::TRAIL, Some(15), slot_s)?;
    let top = layout.view(Class::Scene, "Top view", queues::WORLD, &[world(), omit(uav::TRAIL)])?;
    layout.show_past(top, uav::TRACK, None, slot_s)?;
    let chase = [world(), omit(uav::TRACK), omit(uav::DOT), omit(legend::CORNERS)];
    let chase = layout.view(Class::Scene, "Chase", uav::UAV, &chase)?;
    layout.show_past(chase, uav::TRAIL, Some(10), slot_s)?;
    for (view, camera) in [(field, overview(sizes)), (top, above(sizes)), (chase, beside_uav(sizes))] {
        layout.set(view, &camera)?;
        layout.set(view, &background())?;
        layout.set(view, &LineGrid3D::new().with_visible(false))?; // the area has its own
        layout.set(view, &SpatialInformation::update_fields().with_show_axes(false))?;
    }
    layout.container(ContainerKind::Tabs, &[(1.0, field), (1.0, top), (1.0, chase)])
}

fn camera(eye: [f32; 3], target: [f32; 3], up: [f32; 3]) -> EyeControls3D {
    EyeControls3D::new().with_kind(Eye3DKind::Orbital).with_position(eye).with_look_target(target).with_eye_up(up)
}

/// The whole area from the south, at about 45 degrees.
fn overview(sizes: &Sizes) -> EyeControls3D {
    let (x_m, y_m, span_m) = (sizes.width_m / 2.0, sizes.depth_m / 2.0, sizes.span_m());
    let eye = [x_m, y_m - 0.5 * sizes.depth_m - 0.42 * span_m, 0.68 * span_m];
    camera(eye, [x_m, y_m - 0.08 * span_m, 0.0], [0.0, 0.0, 1.0])
}

/// The whole area as on a map: north is up.
fn above(sizes: &Sizes) -> EyeControls3D {
    let (x_m, y_m) = (sizes.width_m / 2.0, sizes.depth_m / 2.0);
    camera([x_m, y_m, 1.16 * sizes.span_m()], [x_m, y_m, 0.0], [0.0, 1.0, 0.0])
}

/// In the UAV's frame, so that the camera flies along.
fn beside_uav(sizes: &Sizes) -> EyeControls3D {
    let near_m = sizes.radius_m + 0.5 * sizes.altitude_m;
    let eye = [-1.2 * near_m, -1.9 * near_m, 0.9 * near_m];
    camera(eye, [0.0, 0.0, -0.55 * sizes.altitude_m], [0.0, 0.0, 1.0])
}

/// Curves, scales and text, beside the scene.
fn beside(layout: &mut Layout, timing: Timing) -> RecordingStreamResult<Tile> {
    let losses = [curves::LOSS, curves::LOSS_MARK];
    let fills = [curves::FILL_MAX, curves::FILL_MEAN];
    let fill = plot(layout, "Queue fill: fullest (violet), mean (blue)", &fills)?;
    layout.set(fill, &ScalarAxis::new().with_range([-0.04, 1.1]).with_zoom_lock(true))?;
    let mut rows = vec![
        (1.15, plot(layout, "Loss rate so far: lost ÷ sampled (red), 1 % (grey)", &losses)?),
        (1.15, fill),
        (1.0, plot(layout, "Delivered per slot [kbit]", &[curves::DELIVERED])?),
    ];
    if timing == Timing::Measured {
        let latency = plot(layout, "Plan latency [ms]", &[curves::PLAN_LATENCY])?;
        let pace = plot(layout, "Pace [slot/s]", &[curves::PACE])?;
        rows.push((0.9, layout.container(ContainerKind::Horizontal, &[(1.0, latency), (1.0, pace)])?));
    }
    rows.push((0.7, scales(layout)?));
    let page = layout.view(Class::Text, "Legend", legend::PAGE, &[select(legend::PAGE)])?;
    let log = log(layout)?;
    let missed = plot(layout, "Missed slots", &[curves::MISSED])?;
    rows.push((2.5, layout.container(ContainerKind::Tabs, &[(1.0, page), (1.0, log), (1.0, missed)])?));
    layout.container(ContainerKind::Vertical, &rows)
}

/// Curves whose names are in the title: a box of names would cover them.
fn plot(layout: &mut Layout, name: &str, entities: &[&str]) -> RecordingStreamResult<Tile> {
    let entities: Vec<_> = entities.iter().map(|entity| select(entity)).collect();
    let view = layout.view(Class::Curves, name, "", &entities)?;
    layout.set(view, &PlotLegend::new().with_visible(false))?;
    Ok(view)
}

fn log(layout: &mut Layout) -> RecordingStreamResult<Tile> {
    let view = layout.view(Class::Log, "Events", events::LOG, &[select(events::LOG)])?;
    let columns = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body]
        .map(|kind| components::TextLogColumn(datatypes::TextLogColumn { visible: true.into(), kind }));
    layout.set(view, &TextLogColumns::update_fields().with_text_log_columns(columns))?;
    Ok(view)
}

fn scales(layout: &mut Layout) -> RecordingStreamResult<Tile> {
    let contents = [select(&format!("{}/**", legend::SCALE))];
    let view = layout.view(Class::Picture, "Colours: queue fill, link rate", legend::SCALE, &contents)?;
    let [x, y] = legend::SCALE_BOUNDS;
    let bounds = rerun::datatypes::Range2D { x_range: x.into(), y_range: y.into() };
    layout.set(view, &VisualBounds2D::new(components::VisualBounds2D(bounds)))?;
    layout.set(view, &background())?;
    Ok(view)
}

fn background() -> Background {
    Background::new(BackgroundKind::SolidColor).with_color(color(colour::BACKGROUND))
}
