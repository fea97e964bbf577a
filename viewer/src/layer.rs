//! What an optional layer of the scene is: its drawing, and what it adds to legend and layout.

use std::sync::Arc;

use re_sdk::RecordingStreamResult;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::blueprint::{Blueprint, Tile};
use crate::canvas::Canvas;
use crate::sizes::Sizes;
use crate::slot::SlotView;

/// The mission of a layer.
#[derive(Clone, Copy)]
pub(crate) struct LayerSetup<'a> {
    /// Its scenario.
    pub(crate) scenario: &'a Scenario,
    /// Its sensor nodes.
    pub(crate) sensors: &'a Arc<Sensors>,
    /// The sizes of its scene.
    pub(crate) sizes: &'a Sizes,
}

/// A layer of a scene.
pub(crate) trait Layer {
    /// Shows a slot.
    fn log_slot(&mut self, canvas: &Canvas, view: &SlotView) -> RecordingStreamResult<()>;

    /// Clears what is outdated in a missed slot.
    fn log_missed(&mut self, _canvas: &Canvas) -> RecordingStreamResult<()> {
        Ok(())
    }
}

/// A layer that is open, if the mission has it.
pub(crate) type OpenLayer = RecordingStreamResult<Option<Box<dyn Layer>>>;

/// A view or a tab, if the mission has the layer.
pub(crate) type LayerTile = RecordingStreamResult<Option<Tile>>;

/// What a layer is. All but `open` are nothing by default.
pub(crate) struct LayerRow {
    /// Styles its entities; `None` if the mission does not have it.
    pub(crate) open: fn(&Canvas, LayerSetup<'_>) -> OpenLayer,
    /// Its rows of the legend.
    pub(crate) legend: fn(&Scenario) -> Option<String>,
    /// The entity of its page, and the text in Markdown.
    pub(crate) page: fn(&Scenario) -> Option<(&'static str, String)>,
    /// Its tab beside the scenes.
    pub(crate) tab: fn(&mut Blueprint, &Scenario, &Sizes) -> LayerTile,
    /// Its plot beside the curves, of a mission with so many sensor nodes.
    pub(crate) plot: fn(&mut Blueprint, &Scenario, usize) -> LayerTile,
}

impl LayerRow {
    /// A layer without legend, page, tab and plot.
    pub(crate) const fn new(open: fn(&Canvas, LayerSetup<'_>) -> OpenLayer) -> Self {
        Self { open, legend: |_| None, page: |_| None, tab: |_, _, _| Ok(None), plot: |_, _, _| Ok(None) }
    }
}
