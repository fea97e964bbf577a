//! Errors of measurements, and their exit codes.

use std::process::ExitStatus;

/// An error of a measurement. Its `Display` is one line.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// What is measured fails.
    #[error(transparent)]
    Measured(skysink::Error),
    /// A run of the ring fails.
    #[error("skysink run: {status}: {message}")]
    Run {
        /// Its exit status.
        status: ExitStatus,
        /// What it has written to standard error.
        message: String,
    },
    /// A message does not arrive.
    #[error("hop: no message within {seconds} s")]
    Hop {
        /// Time waited [s].
        seconds: u64,
    },
}

impl<E: Into<skysink::Error>> From<E> for BenchError {
    fn from(error: E) -> Self {
        Self::Measured(error.into())
    }
}

impl BenchError {
    /// The exit code, as that of `skysink`.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Measured(error) => error.exit_code(),
            Self::Run { .. } | Self::Hop { .. } => 1,
        }
    }
}
