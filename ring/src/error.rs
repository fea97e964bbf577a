//! Errors of a ring and of its processes.

use std::fmt::{Debug, Display};
use std::io;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::stop::Stopped;

/// Why a ring cannot be used; the display is one line that names the remedy where there is one.
#[derive(Debug, thiserror::Error)]
pub enum RingError {
    /// The folder is not that of a running ring, the ring flies another mission, or another process has the role.
    #[error(transparent)]
    Folder(#[from] InputError),
    /// A signal requested the stop during a wait for a full buffer.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A process cannot save its state, or restore it.
    #[error("journal {}: {source}", path.display())]
    Journal {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A reader does not take its samples.
    #[error(
        "topic {topic}: a reader has not taken its samples for {seconds:.1} s: is one stopped, or the viewer too slow?"
    )]
    Full {
        /// The topic.
        topic: &'static str,
        /// Time waited [s].
        seconds: f64,
    },
    /// An operation of iceoryx2 failed.
    #[error("topic {topic}: cannot {action}: {detail}")]
    Topic {
        /// The topic, or `ring`.
        topic: &'static str,
        /// The operation.
        action: &'static str,
        /// The error of iceoryx2.
        detail: String,
    },
}

impl RingError {
    /// Exit code of a process that ends with this error.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Folder(_) => 2,
            Self::Journal { .. } | Self::Full { .. } | Self::Topic { .. } => 1,
        }
    }

    pub(crate) fn folder(folder: &Path, message: impl Display) -> Self {
        InputError::new("ring", folder, message).into()
    }

    /// The error of a failed `action` on `topic`, with that of iceoryx2.
    #[must_use]
    pub fn topic(topic: &'static str, action: &'static str, error: &dyn Debug) -> Self {
        Self::Topic { topic, action, detail: format!("{error:?}") }
    }
}

/// Why a process of the ring ends before the mission does.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// A signal requested the stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A process does not send the sample that the others wait for.
    #[error("{from} has not sent {what} for {seconds} s: is it running? If it is slow, raise --timeout")]
    TimedOut {
        /// The sample.
        what: String,
        /// The process that should have sent it.
        from: &'static str,
        /// Time waited [s].
        seconds: f64,
    },
    /// The launcher has ended.
    #[error("skysink run has ended")]
    Orphaned,
    /// The viewer cannot record.
    #[error(transparent)]
    Recording(Box<dyn std::error::Error + Send + Sync>),
    /// A peer has left out the sample of a slot.
    #[error("{topic}({slot}): expected every slot")]
    MissingSlot {
        /// The topic.
        topic: &'static str,
        /// The slot.
        slot: u64,
    },
    /// A peer sent an impossible sample.
    #[error(transparent)]
    ImpossibleSample(Box<dyn std::error::Error + Send + Sync>),
    /// A replayed trace does not have the slot.
    #[error("slot {0}: not in the trace")]
    NotRecorded(u64),
    /// The ring cannot be used.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The scenario or the sensor list is refused.
    #[error(transparent)]
    Input(#[from] InputError),
}

impl NodeError {
    /// Exit code of a process that ends with this error.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Ring(error) => error.exit_code(),
            Self::Input(_) | Self::MissingSlot { .. } | Self::ImpossibleSample(_) | Self::NotRecorded(_) => 2,
            Self::TimedOut { .. } | Self::Orphaned | Self::Recording(_) => 1,
        }
    }
}
