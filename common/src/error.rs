//! Input that is refused.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// A file or folder that is refused; the display is one line that names it, the key or line, the value, and what was
/// expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} {}: {message}", path.display())]
pub struct InputError {
    /// What it is, such as `scenario`.
    pub what: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// What is wrong where, and what was expected; on one line.
    pub message: String,
}

impl InputError {
    /// Refuses `path`. Line breaks in the message, which a file's text may bring in, become spaces.
    #[must_use]
    pub fn new(what: &'static str, path: &Path, message: impl Display) -> Self {
        let message = message.to_string().replace(['\n', '\r'], " ");
        Self { what, path: path.to_owned(), message }
    }

    /// Refuses `path`, whose `text` is not the TOML that was expected: says the line, the text there, and why.
    #[must_use]
    pub fn toml(what: &'static str, path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let place = error.span().map_or_else(String::new, |span| {
            let before = &text[..span.start.min(text.len())];
            let number = before.matches('\n').count() + 1;
            let line = text.lines().nth(number - 1).unwrap_or_default().trim();
            format!("line {number}: `{line}`: ")
        });
        Self::new(what, path, place + &error.message().trim().replace('\n', ", "))
    }
}
