//! Why a figure is not drawn.

/// Why a figure is not drawn; the display is one line. Files that cannot be written are a mission's error.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// There is nothing to draw.
    #[error("{place}: 0 {what}: expected at least 1")]
    Nothing {
        /// Figure or series.
        place: String,
        /// What is missing.
        what: &'static str,
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
}

impl FigureError {
    /// Passes a number for which `holds`, refuses any other; a comparison with NaN does not hold.
    pub(crate) fn unless(
        holds: bool,
        place: impl FnOnce() -> String,
        key: &'static str,
        value: f64,
        expected: &'static str,
    ) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self::Value { place: place(), key, value, expected }) }
    }
}
