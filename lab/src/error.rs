//! Why a piece of research fails.

use skysink_mission::MissionError;

use crate::figures::error::FigureError;
use crate::sweep::error::SweepError;

/// Why a sweep, a figure or a search fails; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A mission is refused, a file cannot be read or written, or a signal asks for the end.
    #[error(transparent)]
    Mission(MissionError),
    /// A sweep is refused.
    #[error(transparent)]
    Sweep(#[from] SweepError),
    /// A figure cannot be drawn.
    #[error(transparent)]
    Figure(#[from] FigureError),
}

impl LabError {
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

/// Whatever refuses a mission ends the research with it.
impl<E: Into<MissionError>> From<E> for LabError {
    fn from(error: E) -> Self {
        Self::Mission(error.into())
    }
}
