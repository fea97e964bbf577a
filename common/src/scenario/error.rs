//! Why a scenario is refused.

use std::path::PathBuf;

/// Why a scenario is refused; the display is one line that names the file, the key, the value and what was expected.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("scenario {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The file is not the TOML of a scenario.
    #[error("scenario {}: {place}{message}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line and text or key, where known.
        place: String,
        /// What is wrong there.
        message: String,
    },
    /// A key is unknown or a value is out of its range.
    #[error("scenario {}: {key} = {value}: expected {expected}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Dotted key.
        key: String,
        /// The value found.
        value: String,
        /// What would be accepted.
        expected: String,
    },
}
