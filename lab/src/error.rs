//! Why a piece of research fails.

use skysink_mission::MissionError;

/// Why a sweep, a figure or a search fails; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A sweep or a mission is refused, a file cannot be read or written, or a signal asks for the end.
    #[error(transparent)]
    Mission(MissionError),
    /// A figure has nothing to draw, a number without a position, or a character without a glyph.
    #[error("{place}: {message}")]
    Figure {
        /// Figure, series, point, text.
        place: String,
        /// What is wrong with it.
        message: String,
    },
}

impl LabError {
    /// Exit code: 1 failed while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Mission(error) => error.exit_code(),
            Self::Figure { .. } => 1,
        }
    }

    /// Passes a number of a figure for which `holds`, refuses any other; a comparison with NaN does not hold.
    pub(crate) fn unless(
        holds: bool,
        place: impl FnOnce() -> String,
        key: &str,
        value: f64,
        expected: &str,
    ) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self::figure(place(), format!("{key} = {value}: expected {expected}"))) }
    }

    /// A figure that is not drawn.
    pub(crate) fn figure(place: String, message: impl Into<String>) -> Self {
        Self::Figure { place, message: message.into() }
    }
}

/// Whatever refuses a mission ends the research with it.
impl<E: Into<MissionError>> From<E> for LabError {
    fn from(error: E) -> Self {
        Self::Mission(error.into())
    }
}
