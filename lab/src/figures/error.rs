//! Why a figure is not drawn.

use std::io;
use std::path::{Path, PathBuf};

/// Why a figure is not drawn; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// There is nothing to draw, or more than can be told apart.
    #[error("{place}: {count} {what}: expected {expected}")]
    Count {
        /// Figure or series.
        place: String,
        /// Of what.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many there may be.
        expected: &'static str,
    },
    /// A number cannot be placed.
    #[error("{place}: {key} = {value}: expected {expected}")]
    Value {
        /// Figure, series, point.
        place: String,
        /// Name of the number.
        key: &'static str,
        /// The number.
        value: f64,
        /// What would do.
        expected: &'static str,
    },
    /// A text cannot be set in the embedded font.
    #[error("figure text {text:?}: {character:?} is not in the embedded font: expected Latin, Greek or common symbols")]
    Character {
        /// The text.
        text: String,
        /// Its first character without a glyph.
        character: char,
    },
    /// A file cannot be written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
}

impl FigureError {
    /// A failure to write `path`.
    pub(super) fn file(path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::File { path, source }
    }

    /// Passes a number for which `holds`, refuses any other; a comparison with NaN does not hold.
    pub(super) fn unless(
        holds: bool,
        place: impl FnOnce() -> String,
        key: &'static str,
        value: f64,
        expected: &'static str,
    ) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self::Value { place: place(), key, value, expected }) }
    }
}
