//! Writes a blueprint, which is rerun's name for a screen layout, entity by entity into its own store.
//!
//! rerun's own builder does not support view properties (cameras, axes), draws random ids, and panics with `RERUN=off`
//! in the environment. The entities here are those that it would write.

use std::num::NonZeroU64;

use re_log_types::BlueprintActivationCommand;
use re_sdk::sink::MemorySinkStorage;
use re_sdk::{
    Archetype, AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder, RecordingStreamResult, StoreId,
    StoreKind,
};
use re_sdk_types::blueprint::archetypes::{
    ContainerBlueprint, EntityBehavior, PanelBlueprint, TimePanelBlueprint, ViewBlueprint, ViewContents,
    ViewportBlueprint, VisibleTimeRanges,
};
use re_sdk_types::blueprint::components::{
    ContainerKind, Fps, PanelState, RootContainer, TimelineName, VisibleTimeRange,
};
use re_types_core::datatypes::{TimeInt, TimeRange, TimeRangeBoundary, VisibleTimeRange as Range};

use crate::recording::Recording;
use crate::slot::{SIM_TIME, SLOT};

/// rerun's names of the view classes.
pub(crate) mod class {
    pub(crate) const SCENE: &str = "3D";
    pub(crate) const PICTURE: &str = "2D";
    pub(crate) const CURVES: &str = "TimeSeries";
    pub(crate) const STATES: &str = "StateTimeline";
    pub(crate) const TEXT: &str = "TextDocument";
    pub(crate) const LOG: &str = "TextLog";
    pub(crate) const MAP: &str = "Map";
}

/// A view or a container in the blueprint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tile {
    kind: &'static str,
    /// Fixed bytes and the tile's number, so that equal layouts are equal.
    id: [u8; 16],
}

impl Tile {
    fn path(self) -> EntityPath {
        let hex: String = self.id.iter().map(|byte| format!("{byte:02x}")).collect();
        let id = [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..]].join("-");
        EntityPath::from(format!("{}/{id}", self.kind))
    }
}

/// A blueprint under construction.
pub(crate) struct Blueprint {
    store: StoreId,
    recorder: RecordingStream,
    messages: MemorySinkStorage,
    tiles: u8,
    /// K of the recording, which contains every K-th slot.
    every: NonZeroU64,
}

impl Blueprint {
    /// An empty blueprint for a recording.
    pub(crate) fn new(recording: &Recording) -> RecordingStreamResult<Self> {
        let Recording { application, name, .. } = recording;
        let store = StoreId::new(StoreKind::Blueprint, application.clone(), format!("{name}-layout"));
        let builder = RecordingStreamBuilder::from_store_id(&store);
        let (recorder, messages) = builder.send_properties(false).enabled(true).memory()?;
        recorder.set_log_time_enabled(false);
        recorder.set_time_sequence("blueprint", 0);
        Ok(Self { store, recorder, messages, tiles: 0, every: recording.every })
    }

    /// Adds a view of the entities that `contents` selects, in the frame of `origin`.
    pub(crate) fn view(
        &mut self,
        class: &'static str,
        name: &str,
        origin: &str,
        contents: &[String],
    ) -> RecordingStreamResult<Tile> {
        let tile = self.next("view");
        let view = ViewBlueprint::new(class).with_display_name(name).with_space_origin(format!("/{origin}"));
        self.recorder.log(tile.path(), &view)?;
        self.set(tile, &ViewContents::new(contents.iter().map(String::as_str)))?;
        Ok(tile)
    }

    /// Adds a container of tiles, each with its weight in height or width.
    pub(crate) fn container(&mut self, kind: ContainerKind, tiles: &[(f32, Tile)]) -> RecordingStreamResult<Tile> {
        let fractions = tiles.iter().map(|&(fraction, _)| fraction);
        let container =
            ContainerBlueprint::new(kind).with_contents(tiles.iter().map(|(_, tile)| tile.path().to_string()));
        let container = match kind {
            ContainerKind::Horizontal => container.with_col_shares(fractions),
            ContainerKind::Vertical => container.with_row_shares(fractions),
            ContainerKind::Tabs | ContainerKind::Grid => container,
        };
        let tile = self.next("container");
        self.recorder.log(tile.path(), &container)?;
        Ok(tile)
    }

    /// Adds a container with a name, which its tab shows.
    pub(crate) fn tab(
        &mut self,
        kind: ContainerKind,
        name: &str,
        tiles: &[(f32, Tile)],
    ) -> RecordingStreamResult<Tile> {
        let tile = self.container(kind, tiles)?;
        self.recorder.log(tile.path(), &ContainerBlueprint::update_fields().with_display_name(name))?;
        Ok(tile)
    }

    /// Sets a property of a view.
    pub(crate) fn set<A: Archetype + AsComponents>(&self, view: Tile, property: &A) -> RecordingStreamResult<()> {
        self.recorder.log(view.path().join(&EntityPath::from(A::name().short_name())), property)
    }

    /// Sets the visible time range of an entity in a view: the last `slots` slots of `slot_s` [s], or all.
    pub(crate) fn show_past(
        &self,
        view: Tile,
        entity: &str,
        slots: Option<u32>,
        slot_s: f64,
    ) -> RecordingStreamResult<()> {
        let range = |timeline: &str, per_slot: f64| {
            let start = slots.map_or(TimeRangeBoundary::Infinite, |slots| {
                let slots = f64::from(slots).max(self.every.get() as f64); // at least the last recorded slot
                TimeRangeBoundary::CursorRelative(TimeInt(-(slots * per_slot).round() as i64))
            });
            let range = TimeRange { start, end: TimeRangeBoundary::AT_CURSOR };
            VisibleTimeRange(Range { timeline: timeline.into(), range })
        };
        let ranges = VisibleTimeRanges::new([range(SLOT, 1.0), range(SIM_TIME, 1e9 * slot_s)]);
        let place = EntityPath::from(format!("ViewContents/overrides/{entity}/visualizers"));
        self.recorder.log(view.path().join(&place), &ranges)
    }

    /// Hides an entity and all below it in a view, until it is switched on.
    pub(crate) fn hide(&self, view: Tile, entity: &str) -> RecordingStreamResult<()> {
        let place = EntityPath::from(format!("ViewContents/overrides/{entity}"));
        self.recorder.log(view.path().join(&place), &EntityBehavior::new().with_visible(false))
    }

    /// Sends the layout along with a recording: all panels closed, the slots played at `slots_per_s`. It becomes the
    /// application's active and default one. Without a play state a file plays and a live stream follows.
    pub(crate) fn send(self, stream: &RecordingStream, root: Tile, slots_per_s: f64) -> RecordingStreamResult<()> {
        let viewport = ViewportBlueprint::new()
            .with_root_container(RootContainer(root.id.into()))
            .with_auto_layout(false)
            .with_auto_views(false);
        self.recorder.log("viewport", &viewport)?;
        for panel in ["blueprint_panel", "selection_panel"] {
            self.recorder.log(panel, &PanelBlueprint::new().with_state(PanelState::Collapsed))?;
        }
        let time_panel = TimePanelBlueprint::new()
            .with_state(PanelState::Collapsed)
            .with_timeline(TimelineName(SLOT.into()))
            .with_fps(Fps(slots_per_s.into()));
        self.recorder.log("time_panel", &time_panel)?;
        let activation = BlueprintActivationCommand { blueprint_id: self.store, make_active: true, make_default: true };
        stream.send_blueprint(self.messages.take(), activation);
        Ok(())
    }

    fn next(&mut self, kind: &'static str) -> Tile {
        self.tiles += 1;
        let mut id = *b"skysink\0\x80layout\0";
        id[15] = self.tiles;
        Tile { kind, id }
    }
}
