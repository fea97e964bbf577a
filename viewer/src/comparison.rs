//! A recording of several missions side by side: one scene per mission on a common timeline, and common plots.

use std::sync::Arc;

use re_sdk::{ApplicationId, RecordingStreamResult};
use re_sdk_types::archetypes::{Scalars, TextDocument};
use re_sdk_types::blueprint::archetypes::PlotLegend;
use re_sdk_types::blueprint::components::{ContainerKind, Corner2D};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::blueprint::{Blueprint, class};
use crate::cameras::{TOP, field_frame, overview};
use crate::canvas::Canvas;
use crate::colour::{self, Rgb};
use crate::layout::{SLOTS_PER_S, TRACK_SLOTS, flown, from_above};
use crate::picture::Picture;
use crate::queues::Fill;
use crate::recording::{Recording, SceneError, Sinks};
use crate::shapes::curve_style;
use crate::sizes::Sizes;
use crate::slot::SlotView;
use crate::views::{film, lock_axis, select, select_all};
use crate::{path, queues, uav};

/// The page with the comparison table.
const PAGE: &str = "comparison";

/// A plot with a curve per mission: its root entity, title, value in a slot, and axis range.
struct Plot {
    root: &'static str,
    title: &'static str,
    value: fn(&SlotView, Fill) -> f64,
    range: Option<[f64; 2]>,
}

const PLOTS: [Plot; 3] = [
    Plot {
        root: "compare/loss_rate",
        title: "Loss rate so far: lost ÷ sampled",
        value: |_, fill| fill.loss_rate,
        range: None,
    },
    Plot {
        root: "compare/queue_fill",
        title: "Mean queue fill",
        value: |_, fill| fill.mean,
        range: Some([-0.04, 1.1]),
    },
    Plot {
        root: "compare/delivered",
        title: "Delivered so far [Mbit]",
        value: |view, _| view.header.totals.delivered_bits as f64 / 1e6,
        range: None,
    },
];

/// A mission of a comparison.
#[derive(Debug, Clone)]
pub struct ComparedMission<'a> {
    /// Name of its curves, such as the strategy.
    pub label: String,
    /// Title of its scene.
    pub title: String,
    /// Its scenario.
    pub scenario: &'a Scenario,
    /// Its sensor nodes.
    pub sensors: &'a Arc<Sensors>,
}

/// A recording of several missions.
pub struct Comparison {
    recording: Recording,
    canvas: Canvas,
    missions: Vec<Drawn>,
}

/// The drawing state of a mission.
struct Drawn {
    root: String,
    title: String,
    sizes: Sizes,
    picture: Picture,
    slot_s: f64,
}

impl Comparison {
    /// Opens the sinks and logs everything static. `page` is shown beside the scenes, as Markdown.
    ///
    /// # Errors
    /// If there is no sink, the file cannot be created, the port is in use, or rerun fails.
    pub fn open<'a>(
        sinks: &Sinks,
        name: &str,
        missions: impl Iterator<Item = ComparedMission<'a>>,
        page: &str,
    ) -> Result<Self, SceneError> {
        let recording = Recording::open(sinks, &ApplicationId::new_or_unknown("skysink-compare"), name)?;
        let canvas = Canvas::whole(&recording.stream);
        canvas.log_static(PAGE, &TextDocument::from_markdown(page))?;
        let mut drawn = Vec::new();
        for (number, mission) in missions.enumerate() {
            let root = root(number, &mission.label);
            for plot in &PLOTS {
                canvas.log_static(curve(plot, &root), &curve_style(&mission.label, colour(number)))?;
            }
            let sizes = Sizes::of(mission.scenario, mission.sensors.count());
            let below = Canvas::below(&recording.stream, &root);
            let picture = Picture::open(below, mission.scenario, mission.sensors, &sizes, &recording)?;
            drawn.push(Drawn { root, title: mission.title, sizes, picture, slot_s: mission.scenario.slot_s });
        }
        let comparison = Self { recording, canvas, missions: drawn };
        comparison.arrange()?;
        Ok(comparison)
    }

    /// Adds a slot of the mission with this index. The slots of a mission come in ascending order.
    ///
    /// # Errors
    /// If the slot does not fit the sensor list, or rerun fails.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn log_slot(&mut self, mission: usize, view: &SlotView) -> Result<(), SceneError> {
        let Drawn { root, picture, slot_s, .. } = &mut self.missions[mission];
        self.recording.set_slot(view.slot, *slot_s);
        picture.observe(view)?;
        let fill = picture.draw(view, 0)?;
        for plot in &PLOTS {
            self.canvas.append(curve(plot, root), &Scalars::single((plot.value)(view, fill)))?;
        }
        if self.recording.is_batch_due(view.told.queues_bits.len()) {
            self.recording.send_batch();
        }
        Ok(())
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// If data could not be written, now or earlier.
    pub fn close(self) -> Result<(), SceneError> {
        self.recording.close()
    }

    /// Sends the layout: the scenes side by side, and the plots.
    fn arrange(&self) -> RecordingStreamResult<()> {
        let mut layout = Blueprint::new(&self.recording)?;
        let mut fields = Vec::new();
        let mut tops = Vec::new();
        let mut paths = Vec::new();
        for drawn in &self.missions {
            let Drawn { title, sizes, slot_s, .. } = drawn;
            let name_of = |entity: &str| drawn.name_of(entity);
            let field = drawn.world_without([uav::TRACK, path::TRACK]);
            let field = layout.view(class::SCENE, title, &name_of(field_frame(sizes)), &field)?;
            layout.show_past(field, &name_of(uav::TRAIL), Some(15), *slot_s)?;
            film(&layout, field, &overview(sizes))?;
            fields.push((1.0, field));
            let mut top = drawn.world_without([uav::TRAIL, path::PATH]);
            top.push(select_all(&name_of(TOP)));
            let top = from_above(&mut layout, title, &name_of, &top, sizes)?;
            layout.show_past(top, &name_of(uav::TRACK), Some(TRACK_SLOTS), *slot_s)?;
            tops.push((1.0, top));
            paths.push((1.0, flown(&mut layout, title, &name_of, sizes, *slot_s)?));
        }
        // Two columns would be too narrow for a perspective view of a field.
        let fields_kind = if self.missions.len() == 2 { ContainerKind::Vertical } else { ContainerKind::Grid };
        let fields = layout.tab(fields_kind, "Fields (3D)", &fields)?;
        let tops = layout.tab(ContainerKind::Grid, "Top views", &tops)?;
        let paths = layout.tab(ContainerKind::Grid, "Whole paths", &paths)?;
        let scenes = layout.container(ContainerKind::Tabs, &[(1.0, fields), (1.0, tops), (1.0, paths)])?;
        let mut rows = vec![(1.0, layout.view(class::TEXT, "Comparison", PAGE, &[select(PAGE)])?)];
        for plot in &PLOTS {
            let view = layout.view(class::CURVES, plot.title, "", &[select_all(plot.root)])?;
            layout.set(view, &PlotLegend::new().with_visible(true).with_corner(Corner2D::LeftTop))?;
            if let Some(range) = plot.range {
                lock_axis(&layout, view, range)?;
            }
            rows.push((1.0, view));
        }
        let beside = layout.container(ContainerKind::Vertical, &rows)?;
        let all = layout.container(ContainerKind::Horizontal, &[(2.1, scenes), (1.0, beside)])?;
        layout.send(&self.recording.stream, all, SLOTS_PER_S)
    }
}

impl Drawn {
    /// The full name of an entity.
    fn name_of(&self, entity: &str) -> String {
        format!("{}/{entity}", self.root)
    }

    /// The contents of a view of the scene without the `hidden` entities.
    fn world_without(&self, hidden: [&str; 2]) -> Vec<String> {
        let hidden = hidden.map(|entity| format!("- /{}/**", self.name_of(entity)));
        [&[select_all(&self.name_of(queues::WORLD))][..], &hidden].concat()
    }
}

/// The root entity of a mission: unique, without characters that need escaping.
fn root(number: usize, label: &str) -> String {
    let label = label.replace(|letter: char| !letter.is_ascii_alphanumeric(), "-");
    format!("{}-{label}", number + 1)
}

/// The curve of a mission in a plot.
fn curve(plot: &Plot, root: &str) -> String {
    format!("{}/{root}", plot.root)
}

/// The colour of a mission's curves.
fn colour(number: usize) -> Rgb {
    colour::COMPARED[number % colour::COMPARED.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_labels_get_distinct_roots() {
        assert_eq!(root(0, "uts wide/é"), "1-uts-wide--");
        assert_ne!(root(0, "uts"), root(1, "uts"));
    }
}
