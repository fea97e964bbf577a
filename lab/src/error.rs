//! The error type of this crate.

use skysink_mission::MissionError;

/// The error of a sweep, a figure or a search. Its `Display` is one line.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A sweep or a mission is refused, a file cannot be read or written, or a signal has requested the end.
    #[error(transparent)]
    Mission(MissionError),
    /// A mean is not on the axis of a figure.
    #[error("figure {title:?}: mean {mean} at {x}: expected a finite number, not below 0 on a logarithmic scale")]
    FigureMean {
        /// Title of the figure.
        title: String,
        /// Value on the x axis.
        x: f64,
        /// The mean.
        mean: f64,
    },
    /// Nothing is on the logarithmic axis of a figure.
    #[error("figure {title:?}: all means are 0: expected one above it on a logarithmic scale")]
    FigureZeros {
        /// Title of the figure.
        title: String,
    },
    /// A text of a figure has a character without a glyph.
    #[error("figure text {text:?}: {missing}")]
    FigureText {
        /// The text.
        text: String,
        /// The character.
        missing: MissingGlyph,
    },
}

/// A character that the embedded font lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not in the embedded font: expected Latin, Greek or common symbols")]
pub struct MissingGlyph(pub char);

impl LabError {
    /// The exit code: 1 failure while running, 2 bad input or usage, 130 and 143 after a signal.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Mission(error) => error.exit_code(),
            Self::FigureMean { .. } | Self::FigureZeros { .. } | Self::FigureText { .. } => 1,
        }
    }
}

/// Every error of a mission is an error of the sweep or search.
impl<E: Into<MissionError>> From<E> for LabError {
    fn from(error: E) -> Self {
        Self::Mission(error.into())
    }
}
