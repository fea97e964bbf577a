//! Why a piece of research fails.

use skysink_mission::MissionError;

/// Why a sweep, a figure or a search fails; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A sweep or a mission is refused, a file cannot be read or written, or a signal asks for the end.
    #[error(transparent)]
    Mission(MissionError),
    /// A figure cannot be drawn: a number without a place, or a character without a glyph.
    #[error("figure {0}")]
    Figure(String),
}

impl LabError {
    /// Exit code: 1 failed while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Mission(error) => error.exit_code(),
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
