//! Errors of missions and of their run folders.

use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::ledger::Totals;
use skysink_common::stop::Stopped;

/// A refused mission, or a failure to record it. The display is one line.
#[derive(Debug, thiserror::Error)]
pub enum MissionError {
    /// The scenario, the sensor list, or a run folder or its trace is refused.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A signal requested the stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The totals do not balance.
    #[error("slot {slot}: initial + sampled is not delivered + lost + queued: {totals:?}")]
    Unbalanced {
        /// The slot.
        slot: u64,
        /// The ledger's totals.
        totals: Totals,
    },
    /// A pilot or an observer of another crate has failed.
    #[error(transparent)]
    Foreign(Box<dyn Error + Send + Sync>),
}

impl MissionError {
    /// Exit code: 1 for a failure while running, 2 for invalid input or usage, 130 and 143 after a signal.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Input(_) => 2,
            Self::File { .. } | Self::Unbalanced { .. } | Self::Foreign(_) => 1,
        }
    }
}

/// Adds the file name to an I/O error.
pub trait FileContext<T> {
    /// The value, or [`MissionError::File`] about `path`.
    ///
    /// # Errors
    /// If the file system has refused.
    fn at(self, path: &Path) -> Result<T, MissionError>;
}

impl<T> FileContext<T> for io::Result<T> {
    fn at(self, path: &Path) -> Result<T, MissionError> {
        self.map_err(|source| MissionError::File { path: path.to_owned(), source })
    }
}
