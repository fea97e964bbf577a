//! The error type of this crate.

use skysink_mission::MissionError;

/// The error of a sweep, a figure or a search. Its `Display` is one line.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A sweep or a mission is refused, a file cannot be read or written, or a signal has requested the end.
    #[error(transparent)]
    Mission(MissionError),
    /// A figure cannot be drawn: a number is not on the axis, or a character has no glyph.
    #[error("figure {0}")]
    Figure(String),
}

impl LabError {
    /// The exit code: 1 failure while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Mission(error) => error.exit_code(),
            Self::Figure(_) => 1,
        }
    }
}

/// Every error of a mission is an error of the sweep or search.
impl<E: Into<MissionError>> From<E> for LabError {
    fn from(error: E) -> Self {
        Self::Mission(error.into())
    }
}
