//! Why a mission is refused or cannot be put on record.

use std::io;
use std::path::{Path, PathBuf};

use skysink_common::ledger::Totals;
use skysink_common::scenario::ScenarioError;
use skysink_common::sensors::SensorListError;
use skysink_common::stop::Stopped;

/// Why a mission is refused or cannot be put on record; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum MissionError {
    /// The scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The sensor list is refused.
    #[error(transparent)]
    Sensors(#[from] SensorListError),
    /// A signal asks for the end.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The output folder is there already.
    #[error("output folder {}: it exists: choose another --out, or pass --force to replace the run in it", .0.display())]
    OutputExists(PathBuf),
    /// There is nothing to resume.
    #[error("run folder {}: {missing} is missing: expected the folder of a run that has ended early", path.display())]
    NotARun {
        /// The folder.
        path: PathBuf,
        /// The file that is not there.
        missing: &'static str,
    },
    /// A run is still writing.
    #[error("{}: a run is writing it: end that run first, or choose another folder", .0.display())]
    RunUnderWay(PathBuf),
    /// A trace is not what the scenario leads to.
    #[error("{}:{line}: {what}", path.display())]
    Trace {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What is wrong with it.
        what: String,
    },
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
            Self::File { .. } | Self::Unbalanced { .. } => 1,
            _ => 2,
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
