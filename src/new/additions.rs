//! What a plan adds to a new scenario: files beside it, lines, and what stands for the files until they are written.

use skysink_common::scenario::Overrides;

/// The additions.
#[derive(Default)]
pub struct Additions {
    /// Names and texts of the files.
    pub files: Vec<(&'static str, String)>,
    /// What replaces the files in the check before they are written.
    pub overrides: Overrides,
    pub notes: Vec<String>,
    /// What is probably unintended.
    pub warnings: Vec<String>,
}
