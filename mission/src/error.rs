//! Why a mission is refused or cannot be put on record.

use std::io;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::ledger::Totals;
use skysink_common::stop::Stopped;

/// Why a mission is refused or cannot be put on record; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum MissionError {
    /// The scenario, the sensor list, or a run's folder or trace is refused.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A signal asks for the end.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// Bits have appeared or vanished.
    #[error("slot {slot}: initial + sampled is not delivered + lost + queued: {totals:?}")]
    Unbalanced {
        /// The slot.
        slot: u64,
        /// The ledger's totals.
        totals: Totals,
    },
}

impl MissionError {
    /// Exit code: 1 failed while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Input(_) => 2,
            Self::File { .. } | Self::Unbalanced { .. } => 1,
        }
    }
}

/// Names the file in a failure to read or write it.
pub trait FileContext<T> {
    /// The value, or [`MissionError::File`] about `path`.
    ///
    /// # Errors
    /// That of the file system.
    fn at(self, path: &Path) -> Result<T, MissionError>;
}

impl<T> FileContext<T> for io::Result<T> {
    fn at(self, path: &Path) -> Result<T, MissionError> {
        self.map_err(|source| MissionError::File { path: path.to_owned(), source })
    }
}
