//! Where a mission is drawn: below a root of its own, so that one recording can hold several.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use re_sdk::{AsComponents, RecordingStream, RecordingStreamResult};
use re_sdk_types::SerializedComponentBatch;
use re_sdk_types::archetypes::Clear;

/// A recording's stream, seen from a root.
#[derive(Clone)]
pub(crate) struct Canvas {
    stream: RecordingStream,
    root: String,
    /// What each entity shows: its components as they were logged last in this file, none if it was taken away. Of others
    /// an earlier file may show anything.
    shown: Rc<RefCell<HashMap<String, Vec<SerializedComponentBatch>>>>,
}

impl Canvas {
    /// The stream from its own root.
    pub(crate) fn whole(stream: &RecordingStream) -> Self {
        Self { stream: stream.clone(), root: String::new(), shown: Rc::default() }
    }

    /// The stream from the entity `root`.
    pub(crate) fn below(stream: &RecordingStream, root: &str) -> Self {
        Self { root: format!("{root}/"), ..Self::whole(stream) }
    }

    /// The full name of an entity.
    pub(crate) fn name(&self, entity: &str) -> String {
        format!("{}{entity}", self.root)
    }

    /// Shows an entity as `shape` from the time on that the recording is set to: logs those components that differ from
    /// what it shows. None of them may have been logged statically, which hides what has a time; and a transform is logged
    /// by one component, because rerun takes the others back when any of them is logged.
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

    /// Takes an entity away, from the time on that the recording is set to.
    pub(crate) fn clear(&self, entity: impl AsRef<str>) -> RecordingStreamResult<()> {
        let name = self.name(entity.as_ref());
        let before = self.shown.borrow_mut().insert(name.clone(), Vec::new());
        if before.is_some_and(|before| before.is_empty()) {
            return Ok(());
        }
        self.stream.log(name, &Clear::flat())
    }

    /// Adds to an entity that is seen over a span of time, such as a curve or a path, at the time that the recording is
    /// set to.
    pub(crate) fn append(&self, entity: impl AsRef<str>, shape: &impl AsComponents) -> RecordingStreamResult<()> {
        self.stream.log(self.name(entity.as_ref()), shape)
    }

    /// Logs what an entity is at all times.
    pub(crate) fn log_static(&self, entity: impl AsRef<str>, shape: &impl AsComponents) -> RecordingStreamResult<()> {
        self.stream.log_static(self.name(entity.as_ref()), shape)
    }
}
