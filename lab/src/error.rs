//! Why a piece of research fails.

use std::io;
use std::path::Path;

use skysink_common::scenario::ScenarioError;
use skysink_common::sensors::SensorListError;
use skysink_common::stop::Stopped;
use skysink_mission::MissionError;

use crate::figures::FigureError;
use crate::sweep::SweepError;

/// Why a sweep, a figure or a search fails; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A mission is refused, or a file cannot be written.
    #[error(transparent)]
    Mission(#[from] MissionError),
    /// A sweep is refused.
    #[error(transparent)]
    Sweep(#[from] SweepError),
    /// A figure cannot be drawn.
    #[error(transparent)]
    Figure(#[from] FigureError),
}

impl LabError {
    /// A failure to write `path`.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let failed = MissionError::file(path);
        move |source| failed(source).into()
    }

    /// Exit code: 1 failed while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Mission(error) => error.exit_code(),
            Self::Sweep(_) => 2,
            Self::Figure(_) => 1,
        }
    }
}

impl From<ScenarioError> for LabError {
    fn from(error: ScenarioError) -> Self {
        MissionError::from(error).into()
    }
}

impl From<SensorListError> for LabError {
    fn from(error: SensorListError) -> Self {
        MissionError::from(error).into()
    }
}

impl From<Stopped> for LabError {
    fn from(stopped: Stopped) -> Self {
        MissionError::from(stopped).into()
    }
}
