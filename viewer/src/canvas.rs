//! Logs the entities of a mission below a root, so that one recording can contain several missions.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use re_sdk::{AsComponents, RecordingStream, RecordingStreamResult};
use re_sdk_types::SerializedComponentBatch;
use re_sdk_types::archetypes::Clear;

/// The stream of a recording, relative to a root entity.
#[derive(Clone)]
pub(crate) struct Canvas {
    stream: RecordingStream,
    root: String,
    /// The components of each entity as last logged in this file; `None` if it was cleared. The state of other entities
    /// is unknown, because an earlier file may contain them.
    shown: Rc<RefCell<HashMap<String, Vec<SerializedComponentBatch>>>>,
}

impl Canvas {
    /// The stream with its own root.
    pub(crate) fn whole(stream: &RecordingStream) -> Self {
        Self { stream: stream.clone(), root: String::new(), shown: Rc::default() }
    }

    /// The stream below the entity `root`.
    pub(crate) fn below(stream: &RecordingStream, root: &str) -> Self {
        Self { root: format!("{root}/"), ..Self::whole(stream) }
    }

    /// The full name of an entity.
    pub(crate) fn name(&self, entity: &str) -> String {
        format!("{}{entity}", self.root)
    }

    /// Sets an entity to `shape` at the current time of the recording: logs the components that have changed. None of
    /// them may have been logged statically, because static data override temporal data. A transform must have a single
    /// component, because rerun resets the others when any of them is logged.
    pub(crate) fn show(&self, entity: impl AsRef<str>, shape: &impl AsComponents) -> RecordingStreamResult<()> {
        let name = self.name(entity.as_ref());
        let mut shown = self.shown.borrow_mut();
        let shown = shown.entry(name.clone()).or_default();
        let mut changed = shape.as_serialized_batches();
        changed.retain(|batch| !shown.contains(batch));
        if changed.is_empty() {
            return Ok(());
        }
        shown.retain(|batch| changed.iter().all(|new| new.descriptor != batch.descriptor));
        shown.extend(changed.iter().cloned());
        self.stream.log_serialized_batches(name, false, changed)
    }

    /// Clears an entity at the current time of the recording.
    pub(crate) fn clear(&self, entity: impl AsRef<str>) -> RecordingStreamResult<()> {
        let name = self.name(entity.as_ref());
        let before = self.shown.borrow_mut().insert(name.clone(), Vec::new());
        if before.is_some_and(|before| before.is_empty()) {
            return Ok(());
        }
        self.stream.log(name, &Clear::flat())
    }

    /// Logs `shape` at the current time of the recording, for entities that are shown over a time range, such as curves
    /// and paths.
    pub(crate) fn append(&self, entity: impl AsRef<str>, shape: &impl AsComponents) -> RecordingStreamResult<()> {
        self.stream.log(self.name(entity.as_ref()), shape)
    }

    /// Logs static components of an entity.
    pub(crate) fn log_static(&self, entity: impl AsRef<str>, shape: &impl AsComponents) -> RecordingStreamResult<()> {
        self.stream.log_static(self.name(entity.as_ref()), shape)
    }
}
