//! A stop request, set by a signal handler or a caller, and polled by long computations.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A stop request, shared by its clones.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicUsize>);

/// The signal that requested the stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped by signal {0}")]
pub struct Stopped(pub i32);

impl Stop {
    /// The signal number, to be set by a signal handler or a caller; 0 without a request.
    pub fn flag(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.0)
    }

    /// The signal that requested the stop, if one has.
    pub fn requested(&self) -> Option<i32> {
        i32::try_from(self.0.load(Ordering::Relaxed)).ok().filter(|&signal| signal != 0)
    }

    /// Fails once a stop is requested.
    ///
    /// # Errors
    /// [`Stopped`] with the signal.
    pub fn check(&self) -> Result<(), Stopped> {
        self.requested().map_or(Ok(()), |signal| Err(Stopped(signal)))
    }
}

impl Stopped {
    /// Exit code of a process that this signal ends: 128 plus the number of the signal.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        u8::try_from(128 + self.0).unwrap_or(1)
    }
}
