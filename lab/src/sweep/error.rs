//! Why a sweep is refused.

use std::path::{Path, PathBuf};

/// Why a sweep is refused; the display is one line.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The file cannot be read.
    #[error("sweep {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The file is not a sweep.
    #[error("sweep {}: {message}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong where.
        message: String,
    },
    /// A value is none.
    #[error("sweep {}: {key}: expected {expected}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// What would be accepted.
        expected: String,
    },
    /// A swept key lies inside a value.
    #[error("axes: {key}: expected a dotted key of the scenario")]
    NoKey {
        /// The key.
        key: String,
    },
    /// A point of the grid is no scenario.
    #[error("sweep {}: at {point}: {source}", path.display())]
    Point {
        /// The file.
        path: PathBuf,
        /// The point.
        point: String,
        /// What is wrong with it.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The folder holds another sweep.
    #[error("sweep folder {}: it holds {what}: choose another --out", path.display())]
    Other {
        /// The folder.
        path: PathBuf,
        /// What it holds.
        what: String,
    },
    /// Another process flies the sweep.
    #[error("sweep folder {}: another process is flying this sweep", .0.display())]
    Busy(PathBuf),
    /// A journal is none.
    #[error("{}: line {line}: {message}", path.display())]
    Journal {
        /// The file.
        path: PathBuf,
        /// The line.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A shard is not whole, or of another sweep.
    #[error("shard {}: {message}", path.display())]
    Shard {
        /// Its folder.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
}

impl SweepError {
    pub(crate) fn malformed(path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let line = error.span().map_or(String::new(), |span| {
            format!("line {}: ", text[..span.start.min(text.len())].matches('\n').count() + 1)
        });
        Self::Malformed { path: path.to_owned(), message: line + &error.message().trim().replace('\n', ", ") }
    }
}
