//! How the scene is arranged on the screen: views, cameras, axes and timeline.
//!
//! The library builds layouts but has no words for the properties of a view; [`Properties`] adds those to the same
//! blueprint by hand, as entities below the view's own.

use rerun::RecordingStream;
use rerun::blueprint::{
    Blueprint, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView, Spatial3DView,
    StateTimelineView, Tabs, TextDocumentView, TextLogView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_sdk_types::blueprint::archetypes::{
    Background, EyeControls3D, LineGrid3D, PlotLegend, ScalarAxis, SpatialInformation, TextLogColumns, VisualBounds2D,
};
use rerun::external::re_sdk_types::blueprint::components::{self, BackgroundKind, Eye3DKind, PanelState, TextLogColumn};
use rerun::external::re_sdk_types::blueprint::datatypes::{self, TextLogColumnKind};

use crate::colour::{self, color};
use crate::properties::Properties;
use crate::recording::SLOT;
use crate::scene::Timing;
use crate::sizes::Sizes;
use crate::{curves, events, legend, queues, uav};

/// Slots per second at which a viewer plays a file.
const FRAMES_PER_S: f64 = 10.0;

/// A camera: where it is, what it looks at, what is up.
struct Camera {
    eye: [f32; 3],
    target: [f32; 3],
    up: [f32; 3],
}

/// Sends the layout along with the recording.
pub(crate) fn send(
    stream: &RecordingStream,
    sizes: &Sizes,
    slot_s: f64,
    timing: Timing,
) -> rerun::RecordingStreamResult<()> {
    let mut layout = Layout { sizes, slot_s, properties: Properties::default() };
    let left = Vertical::new([layout.scenes(), layout.lane()]).with_row_shares([6.0, 1.1]);
    let right = layout.beside(timing);
    let time_panel = TimePanel::new().with_state(PanelState::Collapsed).with_timeline(SLOT).with_fps(FRAMES_PER_S);
    let blueprint = Blueprint::new(Horizontal::new([left.into(), right]).with_column_shares([2.1, 1.0]))
        .with_auto_layout(false)
        .with_auto_views(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(time_panel); // no play state: a file then plays, a live stream follows
    layout.properties.send(stream, &blueprint)
}

/// The layout in the making.
struct Layout<'a> {
    sizes: &'a Sizes,
    slot_s: f64,
    properties: Properties,
}

impl Layout<'_> {
    /// The 3D scene, seen in three ways.
    fn scenes(&mut self) -> ContainerLike {
        let Sizes { width_m, depth_m, altitude_m, radius_m, .. } = *self.sizes;
        let (middle, span_m) = ([width_m / 2.0, depth_m / 2.0, 0.0], self.sizes.span_m());
        let [x_m, y_m, _] = middle;
        let overview = Camera {
            eye: [x_m, y_m - 0.5 * depth_m - 0.42 * span_m, 0.68 * span_m],
            target: [x_m, y_m - 0.08 * span_m, 0.0],
            up: [0.0, 0.0, 1.0],
        };
        let above = Camera { eye: [x_m, y_m, 1.08 * span_m], target: middle, up: [0.0, 1.0, 0.0] };
        let near_m = radius_m + 0.5 * altitude_m;
        let chase = Camera {
            eye: [-1.2 * near_m, -1.9 * near_m, 0.9 * near_m],
            target: [0.0, 0.0, -0.55 * altitude_m],
            up: [0.0, 0.0, 1.0],
        };
        let corners = format!("- /{}", legend::CORNERS);
        let everything = format!("/{}/**", queues::WORLD);
        let world = |name: &str, without: &[String]| {
            let contents = std::iter::once(everything.clone()).chain(without.iter().cloned());
            Spatial3DView::new(name).with_origin(queues::WORLD).with_contents(contents)
        };
        let track = format!("- /{}", uav::TRACK);
        let trail = format!("- /{}", uav::TRAIL);
        let dot = format!("- /{}", uav::DOT);
        let field = self.scene(world("Field (3D)", &[track.clone()]), &overview, uav::TRAIL, Some(15));
        let top = self.scene(world("Top view", &[trail]), &above, uav::TRACK, None);
        let chase =
            self.scene(world("Chase", &[corners, dot, track]).with_origin(uav::UAV), &chase, uav::TRAIL, Some(10));
        Tabs::new([field, top, chase]).into()
    }

    /// One view, which shows the last `slots` slots of a path, or all.
    fn scene(&mut self, view: Spatial3DView, camera: &Camera, path: &str, slots: Option<u32>) -> ContainerLike {
        let view = ContainerLike::from(view);
        let eye = EyeControls3D::new()
            .with_kind(Eye3DKind::Orbital)
            .with_position(camera.eye)
            .with_look_target(camera.target)
            .with_eye_up(camera.up);
        self.properties.set(&view, "EyeControls3D", eye);
        self.properties.set(&view, "Background", background());
        self.properties.set(&view, "LineGrid3D", LineGrid3D::new().with_visible(false));
        self.properties.set(&view, "SpatialInformation", SpatialInformation::update_fields().with_show_axes(false));
        self.properties.show_past(&view, path, slots, self.slot_s);
        view
    }

    /// The lane of the UAV's state, below the scene.
    fn lane(&self) -> ContainerLike {
        StateTimelineView::new("UAV: serve, transit, hold").with_origin("/").with_contents([events::LANE]).into()
    }

    /// Curves, scales and text, beside the scene.
    fn beside(&mut self, timing: Timing) -> ContainerLike {
        let losses = [curves::LOSS, curves::LOSS_MARK];
        let fills = [curves::FILL_MAX, curves::FILL_MEAN];
        let mut rows = vec![
            (1.15, self.plot("Loss rate so far: lost ÷ sampled (red), 1 % (grey)", &losses, None)),
            (1.15, self.plot("Queue fill: fullest (violet), mean (blue)", &fills, Some([-0.04, 1.1]))),
            (1.0, self.plot("Delivered per slot [kbit]", &[curves::DELIVERED], None)),
        ];
        if timing == Timing::Measured {
            let latency = self.plot("Plan latency [ms]", &[curves::PLAN_LATENCY], None);
            let pace = self.plot("Pace [slot/s]", &[curves::PACE], None);
            rows.push((0.9, Horizontal::new([latency, pace]).into()));
        }
        rows.push((0.62, self.scale()));
        let legend = TextDocumentView::new("Legend").with_origin(legend::PAGE).into();
        let log = self.log();
        let missed = self.plot("Missed slots", &[curves::MISSED], None);
        rows.push((2.5, Tabs::new([legend, log, missed]).into()));
        let (shares, rows): (Vec<f32>, Vec<_>) = rows.into_iter().unzip();
        Vertical::new(rows).with_row_shares(shares).into()
    }

    fn plot(&mut self, name: &str, entities: &[&str], range: Option<[f64; 2]>) -> ContainerLike {
        let entities = entities.iter().map(|entity| format!("/{entity}"));
        let view = ContainerLike::from(TimeSeriesView::new(name).with_origin("/").with_contents(entities));
        self.properties.set(&view, "PlotLegend", PlotLegend::new().with_visible(false));
        if let Some(range) = range {
            self.properties.set(&view, "ScalarAxis", ScalarAxis::new().with_range(range).with_zoom_lock(true));
        }
        view
    }

    fn log(&mut self) -> ContainerLike {
        let view = ContainerLike::from(TextLogView::new("Events").with_origin(events::LOG));
        let columns = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body]
            .map(|kind| TextLogColumn(datatypes::TextLogColumn { visible: true.into(), kind }));
        self.properties.set(&view, "TextLogColumns", TextLogColumns::update_fields().with_text_log_columns(columns));
        view
    }

    fn scale(&mut self) -> ContainerLike {
        let view = Spatial2DView::new("Colours: queue fill, link rate").with_origin(legend::SCALE);
        let view = ContainerLike::from(view);
        let [[left, right], [top, bottom]] = legend::SCALE_BOUNDS;
        let bounds = rerun::datatypes::Range2D { x_range: [left, right].into(), y_range: [top, bottom].into() };
        self.properties.set(&view, "VisualBounds2D", VisualBounds2D::new(components::VisualBounds2D(bounds)));
        self.properties.set(&view, "Background", background());
        view
    }
}

fn background() -> Background {
    Background::new(BackgroundKind::SolidColor).with_color(color(colour::BACKGROUND))
}
