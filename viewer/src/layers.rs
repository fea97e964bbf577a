//! The optional layers of the scene: what only some missions have.
//!
//! A layer is a file with its drawing and its row ([`crate::layer`]), and a line of the list in this file.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::TextDocument;
use skysink_common::scenario::Scenario;

use crate::blueprint::{Blueprint, Tile};
use crate::canvas::Canvas;
use crate::layer::{Layer, LayerRow, LayerSetup};
use crate::sizes::Sizes;
use crate::slot::SlotView;
use crate::{energy, heard, los};

/// All layers, in the order in which they are drawn.
const LAYERS: [LayerRow; 3] = [heard::LAYER, energy::LAYER, los::LAYER];

/// The layers of a scene.
pub(crate) struct Layers(Vec<Box<dyn Layer>>);

impl Layers {
    /// Styles the entities of the layers that the mission has.
    pub(crate) fn open(canvas: &Canvas, setup: LayerSetup<'_>) -> RecordingStreamResult<Self> {
        let open = |row: &LayerRow| (row.open)(canvas, setup).transpose();
        Ok(Self(LAYERS.iter().filter_map(open).collect::<Result<_, _>>()?))
    }

    /// Shows a slot.
    pub(crate) fn log_slot(&mut self, canvas: &Canvas, view: &SlotView) -> RecordingStreamResult<()> {
        self.0.iter_mut().try_for_each(|layer| layer.log_slot(canvas, view))
    }

    /// Clears what is outdated in a missed slot.
    pub(crate) fn log_missed(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        self.0.iter_mut().try_for_each(|layer| layer.log_missed(canvas))
    }
}

/// The rows of the legend of all layers that the mission has.
pub(crate) fn legend(scenario: &Scenario) -> String {
    LAYERS.iter().filter_map(|row| (row.legend)(scenario)).collect()
}

/// Writes the pages of all layers that the mission has.
pub(crate) fn log_pages(canvas: &Canvas, scenario: &Scenario) -> RecordingStreamResult<()> {
    let mut pages = LAYERS.iter().filter_map(|row| (row.page)(scenario));
    pages.try_for_each(|(entity, text)| canvas.log_static(entity, &TextDocument::from_markdown(text)))
}

/// The tabs of all layers that the mission has.
pub(crate) fn tabs(layout: &mut Blueprint, scenario: &Scenario, sizes: &Sizes) -> RecordingStreamResult<Vec<Tile>> {
    LAYERS.iter().filter_map(|row| (row.tab)(layout, scenario, sizes).transpose()).collect()
}

/// The plots of all layers that a mission with `count` sensor nodes has.
pub(crate) fn plots(layout: &mut Blueprint, scenario: &Scenario, count: usize) -> RecordingStreamResult<Vec<Tile>> {
    LAYERS.iter().filter_map(|row| (row.plot)(layout, scenario, count).transpose()).collect()
}
