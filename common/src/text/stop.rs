//! A stop request, set by a signal handler or a caller, and polled by long computations.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A stop request, shared by its clones.
#[derive(Debug, Clone, Default)]
pub struct Stop {
    signal: Arc<AtomicUsize>,
    /// Whether it was polled since [`Stop::take_polled`].
    is_polled: Arc<AtomicBool>,
}

/// The signal that requested the stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped by signal {0}")]
pub struct Stopped(pub i32);

impl Stop {
    /// The signal number, to be set by a signal handler or a caller; 0 without a request.
    pub fn flag(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.signal)
    }

    /// The signal that requested the stop, if one has.
    pub fn requested(&self) -> Option<i32> {
        if !self.is_polled.load(Ordering::Relaxed) {
            self.is_polled.store(true, Ordering::Relaxed); // rarely, so that threads do not wait for each other
        }
        i32::try_from(self.signal.load(Ordering::Relaxed)).ok().filter(|&signal| signal != 0)
    }

    /// Whether it was polled since the last call: a computation goes on.
    pub fn take_polled(&self) -> bool {
        self.is_polled.swap(false, Ordering::Relaxed)
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
