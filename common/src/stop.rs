//! The request to end, as a value: set by a signal handler or by a caller, polled by whatever takes long.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A request to end, shared by its clones.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicUsize>);

/// The signal that asked for the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped by signal {0}")]
pub struct Stopped(pub i32);

impl Stop {
    /// The signal number, for a signal handler, or whoever asks for the end, to store into; 0 while there is no
    /// request.
    #[must_use]
    pub fn flag(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.0)
    }

    /// The signal that asked for the end, if one has.
    #[must_use]
    pub fn requested(&self) -> Option<i32> {
        i32::try_from(self.0.load(Ordering::Relaxed)).ok().filter(|&signal| signal != 0)
    }

    /// # Errors
    /// [`Stopped`] once the end was asked for.
    pub fn check(&self) -> Result<(), Stopped> {
        self.requested().map_or(Ok(()), |signal| Err(Stopped(signal)))
    }
}

impl Stopped {
    /// Exit code of a process that ends because of it: 128 and the signal's number.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        u8::try_from(128 + self.0).unwrap_or(1)
    }
}
