//! Where a mission is drawn: below a root of its own, so that one recording can hold several.

use re_sdk::{AsComponents, RecordingStream, RecordingStreamResult};

/// A recording's stream, seen from a root.
#[derive(Clone)]
pub(crate) struct Canvas {
    stream: RecordingStream,
    root: String,
}

impl Canvas {
    /// The stream from its own root.
    pub(crate) fn whole(stream: &RecordingStream) -> Self {
        Self { stream: stream.clone(), root: String::new() }
    }

    /// The stream from the entity `root`.
    pub(crate) fn below(stream: &RecordingStream, root: &str) -> Self {
        Self { stream: stream.clone(), root: format!("{root}/") }
    }

    /// The full name of an entity.
    pub(crate) fn name(&self, entity: &str) -> String {
        format!("{}{entity}", self.root)
    }

    /// Logs an entity at the time that the recording is set to.
    pub(crate) fn log(&self, entity: impl AsRef<str>, shape: &impl AsComponents) -> RecordingStreamResult<()> {
        self.stream.log(self.name(entity.as_ref()), shape)
    }

    /// Logs what an entity is at all times.
    pub(crate) fn log_static(&self, entity: impl AsRef<str>, shape: &impl AsComponents) -> RecordingStreamResult<()> {
        self.stream.log_static(self.name(entity.as_ref()), shape)
    }
}
