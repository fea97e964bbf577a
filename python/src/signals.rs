//! Runs long work without the interpreter lock, interruptible by Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, LazyLock, Once};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use signal_hook::consts::SIGTERM;
use signal_hook::flag::register_conditional_default;
use skysink_common::stop::Stop;
use skysink_ring::wait::stop_on_signals;

/// Time between two checks for signals in Python.
const POLL: Duration = Duration::from_millis(50);

/// SIGINT, as which a stop by an exception counts.
pub const INTERRUPT: usize = 2;

/// Runs `work` on a separate thread, without the interpreter lock. If a signal handler in Python raises an exception,
/// `work` is stopped and the exception is raised.
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

/// Requests a stop on SIGINT and SIGTERM beside Python's own handlers.
pub struct StopOnSignals {
    /// The request.
    pub stop: Stop,
}

/// Whether no process of a ring runs in this process: SIGTERM then ends it, as it does by default.
static IS_FREE: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

impl StopOnSignals {
    /// Installs the handlers.
    pub fn new(py: Python<'_>) -> PyResult<Self> {
        static DEFAULT: Once = Once::new();
        let signal = py.import("signal")?;
        let handler = signal.call_method1("getsignal", (SIGTERM,))?;
        if handler.eq(signal.getattr("SIG_DFL")?)? {
            DEFAULT.call_once(|| {
                let _ = register_conditional_default(SIGTERM, Arc::clone(&IS_FREE)); // it can be caught
            });
        }
        IS_FREE.store(false, Ordering::Relaxed);
        Ok(Self { stop: stop_on_signals() })
    }
}

impl Drop for StopOnSignals {
    fn drop(&mut self) {
        IS_FREE.store(true, Ordering::Relaxed);
    }
}
