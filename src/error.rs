//! Errors of the commands, and their exit codes.

use std::io;

use skysink_common::error::InputError;
use skysink_common::stop::Stopped;
use skysink_common::terminal::shell_path;
use skysink_common::written_file::FileChange;
use skysink_mission::MissionError;
use skysink_mission::record::RunFolder;
use skysink_ring::error::{NodeError, RingError};

/// Version of rerun that the recordings are written with.
pub const RERUN: &str = "0.36.3";

/// An error of a command. Its `Display` is one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scenario, the sensor list or a folder is refused.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A signal has requested the end.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A mission is refused or stopped, or its run folder cannot be written.
    #[error(transparent)]
    Mission(MissionError),
    /// A process cannot join the ring.
    #[error(transparent)]
    Node(#[from] NodeError),
    /// The ring is broken.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// A sweep, a figure or a search fails.
    #[cfg(feature = "lab")]
    #[error(transparent)]
    Lab(#[from] skysink_lab::LabError),
    /// The recording cannot be written.
    #[cfg(feature = "viewer")]
    #[error(transparent)]
    Scene(#[from] skysink_viewer::SceneError),
    /// Options contradict each other.
    #[error("{0}")]
    Usage(String),
    /// This build cannot record.
    #[error("this build has no viewer: pass --no-viewer, omit --record, or build with the default features")]
    NoViewer,
    /// This build cannot fly vehicles over MAVLink.
    #[error("this build has no bridge to vehicles: build with the default features, or pass a command to --vehicle")]
    NoBridge,
    /// This build cannot show recordings in a browser. Contains the rerun command that can.
    #[error(
        "this build has no web viewer: build with the default features, or `pip install rerun-sdk=={RERUN}` and `{0}`"
    )]
    NoWebViewer(String),
    /// The web server has failed.
    #[cfg(feature = "viewer")]
    #[error("the web server failed: {0}: restart `skysink view`, with a higher `ulimit -n` if it ran out of files")]
    NotServed(String),
    /// The web page cannot be written.
    #[cfg(feature = "viewer")]
    #[error(transparent)]
    Page(#[from] skysink_web::PageError),
    /// A process of the ring has ended before the mission and is not restarted.
    #[error("{role} ended with {status} in slot {slot}")]
    WorkerEnded {
        /// Its role.
        role: &'static str,
        /// Its exit code or signal.
        status: String,
        /// The current slot.
        slot: u64,
    },
    /// The link to other hosts has ended right after its start.
    #[error("link: {program} ended with {status}: expected a valid zenoh configuration and a free port")]
    LinkEnded {
        /// The executable.
        program: String,
        /// Its exit status.
        status: String,
    },
    /// The launcher on another host sends no heartbeat.
    #[error("no heartbeat from the launcher for {seconds} s after slot {slot}: is it running, and is the link up?")]
    LauncherSilent {
        /// Time since the last heartbeat [s].
        seconds: f64,
        /// The last committed slot.
        slot: u64,
    },
    /// A replayed slot differs from the trace.
    #[error("slot {0}: the flight differs from the recorded one: was the run recorded by another version?")]
    ReplayDiverged(u64),
    /// The viewer does not end after the mission.
    #[error("viewer did not end within {seconds} s after the last slot, {slot}: is its disk slow? Raise --timeout")]
    ViewerTimeout {
        /// The timeout [s].
        seconds: f64,
        /// The last slot.
        slot: u64,
    },
    /// A run has ended before its mission.
    #[error("{cause}: {left}")]
    EndedEarly {
        /// The error that ended it.
        cause: Box<Error>,
        /// The state of the output, and how to continue.
        left: String,
    },
    /// Standard output cannot be written.
    #[error("standard output: {0}")]
    Output(io::Error),
    /// The machine has too little of a resource.
    #[error("{what}: {found}: expected {expected}: {remedy}")]
    Insufficient {
        /// The resource.
        what: String,
        /// The available amount.
        found: String,
        /// The required amount.
        expected: String,
        /// How to get more.
        remedy: &'static str,
    },
}

/// What is left to fly of a run that has ended early.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LeftToFly {
    /// Slots, which `skysink run --resume` flies.
    Slots {
        /// Its additional options.
        options: String,
    },
    /// Nothing: all slots are recorded.
    Nothing,
    /// Slots that are not flown, as somebody else flies a vehicle.
    Overridden,
}

impl From<MissionError> for Error {
    fn from(error: MissionError) -> Self {
        match error {
            MissionError::Foreign(error) => {
                error.downcast().map_or_else(|error| Self::Mission(MissionError::Foreign(error)), |error| *error)
            }
            error => Self::Mission(error),
        }
    }
}

/// An error of an observer, which the mission hands back.
impl From<Error> for MissionError {
    fn from(error: Error) -> Self {
        match error {
            Error::Mission(error) => error,
            error => Self::Foreign(Box::new(error)),
        }
    }
}

impl Error {
    /// The error of a run that has ended early, after `slots` slots. Its message contains the command that resumes it,
    /// if there is something `left` to fly.
    #[must_use]
    pub fn ended_early(self, folder: &RunFolder, slots: u64, left: &LeftToFly) -> Self {
        let path = shell_path(folder.path());
        let left = match (left, &self) {
            _ if slots == 0 => "no slot was flown".to_owned(),
            (LeftToFly::Nothing, _) => format!("all {slots} slots are recorded"),
            (LeftToFly::Overridden, _) => {
                format!(
                    "the run is recorded up to slot {slots}; it is not resumed, as others fly a vehicle, or none flies \
                     any more"
                )
            }
            (LeftToFly::Slots { options }, Self::Mission(MissionError::File { source, .. }))
                if FileChange::is_cause_of(source) =>
            {
                format!(
                    "the run was flown up to slot {slots}; if the file can be restored, `skysink run --resume \
                     {path}{options}` continues it"
                )
            }
            (LeftToFly::Slots { options }, _) => {
                format!("the run is recorded up to slot {slots}; `skysink run --resume {path}{options}` continues it")
            }
        };
        Self::EndedEarly { cause: Box::new(self), left }
    }

    /// The exit code: 1 failure while running, 2 bad input or usage, 130 and 143 after a signal.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Mission(error) => error.exit_code(),
            Self::Node(error) => error.exit_code(),
            #[cfg(feature = "lab")]
            Self::Lab(error) => error.exit_code(),
            Self::EndedEarly { cause, .. } => cause.exit_code(),
            Self::Ring(error) => error.exit_code(),
            Self::Input(_) | Self::Usage(_) | Self::NoViewer | Self::NoBridge | Self::NoWebViewer(_) => 2,
            #[cfg(feature = "viewer")]
            Self::Page(skysink_web::PageError::Taken { .. }) => 2,
            _ => 1,
        }
    }
}

/// The state of the output folder of a stopped sweep.
#[cfg(feature = "lab")]
pub(crate) fn flown_in(out: &std::path::Path) -> String {
    format!("the finished missions are in {}; run the command again to continue", out.display())
}

/// Adds `left` to the message of a stop; converts any other error unchanged.
#[cfg(feature = "lab")]
pub(crate) fn ended_early(error: skysink_lab::LabError, left: &str) -> Error {
    let is_stop = matches!(error, skysink_lab::LabError::Mission(MissionError::Stopped(_)));
    let cause = Error::from(error);
    if is_stop { Error::EndedEarly { cause: Box::new(cause), left: left.to_owned() } } else { cause }
}
