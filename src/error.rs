//! What can go wrong in the program, and the exit code that says so.

use std::borrow::Cow;
use std::io;
use std::path::PathBuf;

use skysink_common::error::InputError;
use skysink_common::stop::Stopped;
use skysink_mission::MissionError;
use skysink_mission::record::RunFolder;
use skysink_ring::error::{NodeError, RingError};

/// Version of the rerun viewer whose recordings these are.
pub const RERUN: &str = "0.36.3";

/// Why a command fails; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scenario, the sensor list or a folder is refused.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A signal asks for the end.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A mission is refused, stopped, or cannot be put on record.
    #[error(transparent)]
    Mission(#[from] MissionError),
    /// A process of the ring cannot take part.
    #[error(transparent)]
    Node(#[from] NodeError),
    /// The ring cannot be used.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// A sweep, a figure or a search fails.
    #[cfg(feature = "lab")]
    #[error(transparent)]
    Lab(#[from] skysink_lab::LabError),
    /// The recording cannot be made.
    #[cfg(feature = "viewer")]
    #[error(transparent)]
    Scene(#[from] skysink_viewer::SceneError),
    /// Options contradict each other.
    #[error("{0}")]
    Usage(String),
    /// This build cannot record.
    #[error("this build has no viewer: pass --no-viewer, leave the recording out, or build with the default features")]
    NoViewer,
    /// This build cannot show recordings in a browser; what opens them without it.
    #[error(
        "this build has no web viewer: build with the default features, or `pip install rerun-sdk=={RERUN}` and `{0}`"
    )]
    NoWebViewer(String),
    /// The server of a page has failed.
    #[cfg(feature = "viewer")]
    #[error(
        "the page is served no longer: {0}: start `skysink view` again, by a higher `ulimit -n` if files are short"
    )]
    NotServed(String),
    /// A page of recordings cannot be left.
    #[cfg(feature = "viewer")]
    #[error(transparent)]
    Page(#[from] skysink_web::PageError),
    /// An executable is not where it should be.
    #[error("{}: not found beside skysink: build all executables with `cargo build --release`", .0.display())]
    ExecutableMissing(PathBuf),
    /// A process of the ring has ended before the mission.
    #[error("{role} ended with {status} in slot {slot}")]
    WorkerEnded {
        /// Its name.
        role: &'static str,
        /// How it ended.
        status: String,
        /// The slot under way.
        slot: u64,
    },
    /// The link to other hosts has ended as soon as it was started.
    #[error("link: {program} ended with {status}: expected a zenoh configuration that it takes, and a free port")]
    LinkEnded {
        /// The executable.
        program: &'static str,
        /// How it ended.
        status: String,
    },
    /// The launcher, on another host, shows no sign of life.
    #[error("no sign of life of the launcher for {seconds} s after slot {slot}: does it run, and is the link up?")]
    LauncherSilent {
        /// For how long.
        seconds: f64,
        /// The last slot that was put on record.
        slot: u64,
    },
    /// A replay has left its record.
    #[error("slot {0} was not flown as recorded: was the run recorded by another version?")]
    NotAsRecorded(u64),
    /// The viewer does not end after the mission.
    #[error("viewer did not end within {seconds} s after slot {slot}, the last: is its disk slow? Raise --timeout")]
    ViewerStays {
        /// How long it was waited for.
        seconds: f64,
        /// The last slot.
        slot: u64,
    },
    /// A run has ended before its mission.
    #[error("{cause}: {left}")]
    EndedEarly {
        /// Why.
        cause: Box<Error>,
        /// What is left of it.
        left: String,
    },
    /// What a command has to say cannot be written.
    #[error("standard output: {0}")]
    Output(io::Error),
    /// The machine has too little of something.
    #[error("{what}: {found}: expected {expected}: {remedy}")]
    Short {
        /// What is short.
        what: String,
        /// How much of it there is.
        found: String,
        /// How much is needed.
        expected: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A soak has found something.
    #[error("soak: {0}")]
    Soak(String),
    /// A benchmark fails.
    #[error("bench: {0}")]
    Bench(String),
}

impl Error {
    /// The early end of a run after its first `slots`, which `skysink run --resume` with the options `by` flies on.
    #[must_use]
    pub fn ended_early(self, folder: &RunFolder, slots: u64, by: &str) -> Self {
        let left = match slots {
            0 => "nothing was flown".to_owned(),
            slots => {
                let folder = folder.path().to_string_lossy();
                let folder = shlex::try_quote(&folder).unwrap_or(Cow::Borrowed(&folder));
                format!(
                    "the run folder is whole up to slot {slots}, and `skysink run --resume {folder}{by}` flies the rest"
                )
            }
        };
        Self::EndedEarly { cause: Box::new(self), left }
    }

    /// Exit code: 1 failed while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Mission(error) => error.exit_code(),
            Self::Node(error) => error.exit_code(),
            #[cfg(feature = "lab")]
            Self::Lab(error) => error.exit_code(),
            Self::EndedEarly { cause, .. } => cause.exit_code(),
            Self::Ring(error) => error.exit_code(),
            Self::Input(_) | Self::Usage(_) | Self::NoViewer | Self::NoWebViewer(_) => 2,
            #[cfg(feature = "viewer")]
            Self::Page(skysink_web::PageError::Taken { .. }) => 2,
            _ => 1,
        }
    }
}

/// What is left in the folder of a stopped sweep.
#[cfg(feature = "lab")]
pub(crate) fn flown_in(out: &std::path::Path) -> String {
    format!("the missions flown are in {}: the same command flies the rest", out.display())
}

/// A stop with what is `left`; any other error as it is.
#[cfg(feature = "lab")]
pub(crate) fn ended_early(error: skysink_lab::LabError, left: &str) -> Error {
    let is_stop = matches!(error, skysink_lab::LabError::Mission(MissionError::Stopped(_)));
    let cause = Error::from(error);
    if is_stop { Error::EndedEarly { cause: Box::new(cause), left: left.to_owned() } } else { cause }
}
