//! Properties of views, which the library's layouts cannot hold: archetypes in the blueprint's own store, each at
//! `<view>/<archetype>`.

use rerun::blueprint::{Blueprint, BlueprintActivation, ContainerLike};
use rerun::external::re_log_types::{BlueprintActivationCommand, LogMsg};
use rerun::external::re_sdk_types::blueprint::archetypes::VisibleTimeRanges;
use rerun::external::re_sdk_types::blueprint::components::VisibleTimeRange;
use rerun::external::re_types_core::datatypes::{self, TimeInt, TimeRange, TimeRangeBoundary};
use rerun::{AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder, RecordingStreamResult, StoreKind};

use crate::recording::{APPLICATION, SIM_TIME, SLOT};

/// The properties of all views of a layout.
#[derive(Default)]
pub(crate) struct Properties(Vec<(EntityPath, Box<dyn AsComponents>)>);

impl Properties {
    /// Sets a property of a view by the name of its archetype; a container has none.
    pub(crate) fn set(&mut self, view: &ContainerLike, archetype: &str, values: impl AsComponents + 'static) {
        if let ContainerLike::View(view) = view {
            self.0.push((view.blueprint_path().join(&EntityPath::from(archetype)), Box::new(values)));
        }
    }

    /// Lets a view show what an entity logged in the last `slots` slots, or ever.
    pub(crate) fn show_past(&mut self, view: &ContainerLike, entity: &str, slots: Option<u32>, slot_s: f64) {
        let range = |timeline: &str, per_slot: f64| {
            let start = slots.map_or(TimeRangeBoundary::Infinite, |slots| {
                TimeRangeBoundary::CursorRelative(TimeInt(-(f64::from(slots) * per_slot).round() as i64))
            });
            let range = TimeRange { start, end: TimeRangeBoundary::AT_CURSOR };
            VisibleTimeRange(datatypes::VisibleTimeRange { timeline: timeline.into(), range })
        };
        let ranges = VisibleTimeRanges::new([range(SLOT, 1.0), range(SIM_TIME, 1e9 * slot_s)]);
        self.set(view, &format!("ViewContents/overrides/{entity}/visualizers"), ranges);
    }

    /// Sends a layout with its properties; it becomes the application's active and default one.
    pub(crate) fn send(self, stream: &RecordingStream, layout: &Blueprint) -> RecordingStreamResult<()> {
        let scratch = || RecordingStreamBuilder::new(APPLICATION).send_properties(false).enabled(true).memory();
        let (recorder, messages) = scratch()?;
        layout.send(&recorder, BlueprintActivation { make_active: true, make_default: true })?;
        let (mut blueprint, mut activation) = (Vec::new(), None);
        for message in messages.take() {
            match message {
                LogMsg::BlueprintActivationCommand(command) => activation = Some(command),
                message if message.store_id().kind() == StoreKind::Blueprint => blueprint.push(message),
                _ => {}
            }
        }
        let activation = activation.expect("a layout that is sent ends with its activation");
        blueprint.extend(self.messages(&activation)?);
        stream.send_blueprint(blueprint, activation);
        Ok(())
    }

    fn messages(self, activation: &BlueprintActivationCommand) -> RecordingStreamResult<Vec<LogMsg>> {
        let store = &activation.blueprint_id;
        let (recorder, messages) =
            RecordingStreamBuilder::from_store_id(store).send_properties(false).enabled(true).memory()?;
        recorder.set_time_sequence("blueprint", 0);
        for (entity, values) in self.0 {
            recorder.log(entity, values.as_ref())?;
        }
        let is_entry = |message: &LogMsg| !matches!(message, LogMsg::SetStoreInfo(_)) && message.store_id() == store;
        Ok(messages.take().into_iter().filter(is_entry).collect())
    }
}
