//! Runs long work without the interpreter lock, interruptible by Ctrl-C.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use skysink_common::stop::Stop;

/// Time between two checks for signals in Python.
const POLL: Duration = Duration::from_millis(50);

/// SIGINT.
const INTERRUPT: usize = 2;

/// Runs `work` on a separate thread, without the interpreter lock. If a signal handler in Python raises an exception,
/// `work` is stopped and the exception is raised.
///
/// # Errors
/// The exception of a signal's handler.
pub fn interruptible<T: Send>(py: Python<'_>, work: impl FnOnce(&Stop) -> T + Send) -> PyResult<T> {
    let stop = Stop::default();
    let mut interrupt = None;
    let result = py.detach(|| {
        thread::scope(|scope| {
            let (done, is_done) = channel();
            let stop_work = stop.clone();
            let worker = scope.spawn(move || {
                let result = work(&stop_work);
                let _ = done.send(()); // the receiver also notices the end of the thread
                result
            });
            while is_done.recv_timeout(POLL) == Err(RecvTimeoutError::Timeout) {
                if let Err(error) = Python::attach(|py| py.check_signals()) {
                    interrupt.get_or_insert(error);
                    stop.flag().store(INTERRUPT, Ordering::Relaxed);
                }
            }
            worker.join()
        })
    });
    match (interrupt, result) {
        (Some(error), _) => Err(error),
        (None, Ok(result)) => Ok(result),
        (None, Err(panic)) => std::panic::resume_unwind(panic),
    }
}
