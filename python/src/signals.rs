//! Long work without the interpreter, which Ctrl-C ends all the same.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use skysink_common::stop::Stop;

/// How often Python's signals are looked for.
const POLL: Duration = Duration::from_millis(50);

/// SIGINT.
const INTERRUPT: usize = 2;

/// Does `work` on a thread of its own, without the interpreter. Where Python has a signal that ends the program, `work`
/// is stopped, and its exception raised.
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
                let _ = done.send(()); // whoever waits sees the end of the thread, too
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
