//! Why a ring cannot be used, and why one of its processes ends early.

use std::fmt::{Debug, Display};
use std::io;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::stop::Stopped;

/// Why a ring cannot be used; the display is one line that names the remedy where there is one.
#[derive(Debug, thiserror::Error)]
pub enum RingError {
    /// The folder is not that of a running ring, the ring flies something else, or another process has the seat.
    #[error(transparent)]
    Folder(#[from] InputError),
    /// A signal asked for the end while a full buffer was waited for.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A process cannot save its state, or restore it.
    #[error("journal {}: {source}", path.display())]
    Journal {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A reader is stuck.
    #[error(
        "topic {topic}: a reader has not taken its samples for {seconds:.1} s: is one stopped, or the viewer too slow?"
    )]
    Full {
        /// The topic.
        topic: &'static str,
        /// How long it was waited for.
        seconds: f64,
    },
    /// iceoryx2 refuses.
    #[error("topic {topic}: cannot {action}: {detail}")]
    Topic {
        /// The topic, or `ring`.
        topic: &'static str,
        /// What was tried.
        action: &'static str,
        /// What iceoryx2 says.
        detail: String,
    },
}

impl RingError {
    /// Exit code of a process that ends with this error.
    #[must_use]
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

    pub(crate) fn topic(topic: &'static str, action: &'static str, error: &dyn Debug) -> Self {
        Self::Topic { topic, action, detail: format!("{error:?}") }
    }
}

/// Why a process of the ring ends before the mission does.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// A signal asked for it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A process does not send what is due; everybody else waits for it.
    #[error("{from} has not sent {what} for {seconds} s: is it running? If it is slow, raise --timeout")]
    TimedOut {
        /// What did not come.
        what: String,
        /// Who should have sent it.
        from: &'static str,
        /// How long it was waited for.
        seconds: f64,
    },
    /// Nobody supervises the ring any more.
    #[error("skysink run has ended")]
    Orphaned,
    /// The viewer cannot record.
    #[error(transparent)]
    Recording(Box<dyn std::error::Error + Send + Sync>),
    /// A peer sent what cannot be.
    #[error("{0}")]
    Peer(String),
    /// The ring cannot be used.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The scenario or the sensor list is refused.
    #[error(transparent)]
    Input(#[from] InputError),
}

impl NodeError {
    /// Exit code of a process that ends with this error.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Ring(error) => error.exit_code(),
            Self::Input(_) | Self::Peer(_) => 2,
            Self::TimedOut { .. } | Self::Orphaned | Self::Recording(_) => 1,
        }
    }
}
