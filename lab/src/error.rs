//! Why a piece of research fails.

use std::path::{Path, PathBuf};

use skysink_mission::MissionError;

/// Why a sweep, a figure or a search fails; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A mission is refused, a file cannot be read or written, or a signal asks for the end.
    #[error(transparent)]
    Mission(MissionError),
    /// A sweep file, a point of its grid, a sweep's folder or a shard is refused.
    #[error("{what} {}: {message}", path.display())]
    Refused {
        /// What it is.
        what: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What is wrong where.
        message: String,
    },
    /// A swept key lies inside a value.
    #[error("axes: {key}: expected a dotted key of the scenario")]
    NoKey {
        /// The key.
        key: String,
    },
    /// A line of a sweep's journal is no mission.
    #[error("{}: line {line}: {message}", path.display())]
    Journal {
        /// The file.
        path: PathBuf,
        /// The line.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A figure has nothing to draw, or a number without a position.
    #[error("{place}: {message}")]
    Figure {
        /// Figure, series, point.
        place: String,
        /// What is wrong with it.
        message: String,
    },
    /// A text cannot be set in the embedded font.
    #[error("figure text {text:?}: {character:?} is not in the embedded font: expected Latin, Greek or common symbols")]
    Character {
        /// The text.
        text: String,
        /// Its first character without a glyph.
        character: char,
    },
}

impl LabError {
    /// Exit code: 1 failed while running, 2 bad input or usage, 130 and 143 after a signal.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Mission(error) => error.exit_code(),
            Self::Figure { .. } | Self::Character { .. } => 1,
            _ => 2,
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

    /// A file or folder that is refused.
    pub(crate) fn refused(what: &'static str, path: &Path, message: impl ToString) -> Self {
        Self::Refused { what, path: path.to_owned(), message: message.to_string() }
    }

    /// A sweep file that is not TOML, or not a sweep.
    pub(crate) fn malformed(path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let message = error.message().trim().replace('\n', ", ");
        let place = error.span().map_or(String::new(), |span| {
            let line = text[..span.start.min(text.len())].matches('\n').count() + 1;
            match text.get(span) {
                Some(value) if !value.contains('\n') && !message.contains(value) => format!("line {line}: {value}: "),
                _ => format!("line {line}: "),
            }
        });
        Self::refused("sweep", path, place + &message)
    }
}

/// Whatever refuses a mission ends the research with it.
impl<E: Into<MissionError>> From<E> for LabError {
    fn from(error: E) -> Self {
        Self::Mission(error.into())
    }
}
