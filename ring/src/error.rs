//! Why a ring cannot be used, and why one of its processes ends early.

use std::io;
use std::path::PathBuf;

use skysink_common::scenario::ScenarioError;
use skysink_common::sensors::SensorListError;
use skysink_common::stop::Stopped;

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("journal {}: {source}", path.display())]
pub struct JournalError {
    /// The file.
    pub path: PathBuf,
    /// What the system says.
    pub source: io::Error,
}

/// Why a ring cannot be used; the display is one line that names the remedy where there is one.
#[derive(Debug, thiserror::Error)]
pub enum RingError {
    /// The folder is not that of a running ring.
    #[error("ring {folder}: {message}")]
    Folder {
        /// The folder.
        folder: String,
        /// What is wrong with it.
        message: String,
    },
    /// The ring flies something else.
    #[error("ring {folder}: {what} is {theirs}, here {ours}: {remedy}")]
    Differs {
        /// The folder.
        folder: String,
        /// What differs.
        what: &'static str,
        /// As the ring has it.
        theirs: String,
        /// As this process has it.
        ours: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Another process has the seat.
    #[error("ring {folder}: there is a {role} already: end it first")]
    Taken {
        /// The folder.
        folder: String,
        /// The role.
        role: &'static str,
    },
    /// A process cannot save its state.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// A reader is stuck.
    #[error(
        "topic {topic}: a reader has not taken its samples for {seconds} s: is one stopped, or the viewer too slow?"
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
    pub(crate) fn topic(topic: &'static str, action: &'static str, error: &dyn std::fmt::Debug) -> Self {
        Self::Topic { topic, action, detail: format!("{error:?}") }
    }
}

/// Why a process of the ring ends before the mission does.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// A signal asked for it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A peer did not answer in time.
    #[error("waited {seconds} s for {what}: is {from} running?")]
    TimedOut {
        /// What did not come.
        what: String,
        /// Who should have sent it.
        from: &'static str,
        /// How long it was waited for.
        seconds: f64,
    },
    /// Nobody supervises the ring any more.
    #[error("skysink run has ended without stopping this process")]
    Orphaned,
    /// A peer sent what cannot be.
    #[error("{0}")]
    Peer(String),
    /// The ring cannot be used.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The sensor list is refused.
    #[error(transparent)]
    Sensors(#[from] SensorListError),
}

impl NodeError {
    /// Exit code of a process that ends with this error.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Scenario(_)
            | Self::Sensors(_)
            | Self::Peer(_)
            | Self::Ring(RingError::Folder { .. } | RingError::Differs { .. } | RingError::Taken { .. }) => 2,
            Self::TimedOut { .. } | Self::Orphaned | Self::Ring(_) => 1,
        }
    }
}
