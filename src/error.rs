//! What can go wrong in the program, and the exit code that says so.

use std::io;
use std::path::{Path, PathBuf};

use skysink_common::journal::JournalError;
use skysink_common::node::NodeError;
use skysink_common::ring::RingError;
use skysink_common::scenario::ScenarioError;
use skysink_common::sensors::SensorListError;

/// Why a command fails; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The sensor list is refused.
    #[error(transparent)]
    Sensors(#[from] SensorListError),
    /// The output folder is there already.
    #[error("output folder {}: it exists: choose another --out, or pass --force to replace the run in it", .0.display())]
    OutputExists(PathBuf),
    /// There is nothing to resume.
    #[error("run folder {}: {missing} is missing: expected the folder of a run that has ended early", path.display())]
    NotARun {
        /// The folder.
        path: PathBuf,
        /// The file that is not there.
        missing: String,
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
    /// A file cannot be written.
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
        /// The books.
        totals: skysink_common::ledger::Totals,
    },
    /// An executable is not where it should be.
    #[error("{}: not found beside skysink: build all executables with `cargo build --release`", .0.display())]
    ExecutableMissing(PathBuf),
    /// A process of the ring has ended before the mission.
    #[error("{role} ended with {status} in slot {slot}: {whole}")]
    WorkerEnded {
        /// Its name.
        role: &'static str,
        /// How it ended.
        status: String,
        /// The slot under way.
        slot: u64,
        /// What is left of the run.
        whole: String,
    },
    /// The shared memory of the machine would not do.
    #[error("/dev/shm: {free_mib} MiB free: expected {needed_mib} MiB for this run: {remedy}")]
    SharedMemory {
        /// Free [MiB].
        free_mib: u64,
        /// Needed [MiB].
        needed_mib: u64,
        /// What to do.
        remedy: &'static str,
    },
    /// This build cannot record.
    #[error("this build has no viewer: build with the default features, or leave the recording out")]
    NoViewer,
    /// The recording cannot be made.
    #[cfg(feature = "viewer")]
    #[error(transparent)]
    Scene(#[from] skysink_viewer::SceneError),
    /// A soak has found something.
    #[error("soak: {0}")]
    Soak(String),
    /// A benchmark fails.
    #[error("bench: {0}")]
    Bench(String),
    /// A sweep is refused.
    #[error(transparent)]
    Sweep(#[from] crate::sweep::SweepError),
    /// A figure cannot be drawn.
    #[error(transparent)]
    Figure(#[from] crate::figures::FigureError),
    /// The ring fails, or a signal asks for the end.
    #[error(transparent)]
    Node(#[from] NodeError),
}

impl From<RingError> for Error {
    fn from(error: RingError) -> Self {
        Self::Node(error.into())
    }
}

impl Error {
    /// A failure to write `path`.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::File { path, source }
    }

    /// A failure to write a journal.
    pub(crate) fn journal(error: JournalError) -> Self {
        RingError::from(error).into()
    }

    /// Exit code: 1 failed while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Scenario(_)
            | Self::Sensors(_)
            | Self::Sweep(_)
            | Self::OutputExists(_)
            | Self::NotARun { .. }
            | Self::RunUnderWay(_)
            | Self::Trace { .. }
            | Self::NoViewer => 2,
            Self::Node(error) => error.exit_code(),
            _ => 1,
        }
    }
}
