//! Long work: without the interpreter's lock, with progress, ended by Ctrl-C.
//!
//! The work runs in a thread of its own. The caller's thread waits for it, and every [`POLL`] lets Python handle
//! signals and call the function that is told of progress. If either raises, the work ends at its next step, by
//! unwinding. The caller has the exception at once, or with [`AfterEnd::Waits`] once the work has ended. Files and
//! folders get their names at the end, so none is left unfinished.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use host_tools::support::{Error, Result};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::error::raised;

/// Time between two looks at Python's signals.
const POLL: Duration = Duration::from_millis(20);

/// Payload of the unwinding of work that nobody waits for any more.
struct Ended;

/// Count of the steps that are done, and the wish that the work ends.
#[derive(Default)]
pub struct Steps {
    done: AtomicU64,
    is_ended: AtomicBool,
}

impl Steps {
    /// Counts a step.
    pub fn done(&self) {
        self.add(1);
    }

    /// Counts `steps` further steps, which may be zero.
    pub fn add(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
        self.between();
    }

    /// Ends the work if nobody waits for it.
    pub fn between(&self) {
        if self.is_ended.load(Ordering::Relaxed) {
            // Without the panic hook, because this is no fault.
            resume_unwind(Box::new(Ended));
        }
    }

    /// Returns true if nobody waits for the work any more. Work that must bring something in order first asks this.
    pub fn is_ended(&self) -> bool {
        self.is_ended.load(Ordering::Relaxed)
    }

    /// Sets the number of steps that are done.
    pub fn set_done(&self, done: u64) {
        self.done.store(done, Ordering::Relaxed);
    }
}

/// Runs `work` of `total` steps, and calls `progress(done, total)` as steps are done.
///
/// # Errors
/// The errors of `work`, the exception that a signal's handler or `progress` raises, or a `RuntimeError` if `work`
/// panics.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    total: u64,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Steps) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    run_until(py, total, progress, AfterEnd::Returns, work)
}

/// Starts `work` in a thread of its own, and returns where its outcome comes; none comes if it panics or was ended.
fn started<T: Send + 'static>(
    steps: Arc<Steps>,
    work: impl FnOnce(&Steps) -> Result<T> + Send + 'static,
) -> Result<Receiver<Result<T>>> {
    let (sender, receiver) = mpsc::channel();
    let run = move || {
        if let Ok(outcome) = catch_unwind(AssertUnwindSafe(|| work(&steps))) {
            // The receiver is gone if nobody waits any more.
            let _ = sender.send(outcome);
        }
    };
    let spawned = thread::Builder::new().name("stylus-work".to_owned()).spawn(run);
    match spawned {
        Ok(_) => Ok(receiver),
        Err(failure) => Err(Error::Request(format!("the system gives no thread: {failure}"))),
    }
}

/// The caller's behaviour once it has ended the work.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum AfterEnd {
    /// The caller returns at once.
    Returns,
    /// The caller waits until the work has brought a device in order.
    Waits,
}

/// Runs `work` as [`run`] does, with a choice of the caller's behaviour after it has ended the work.
pub fn run_until<T: Send + 'static>(
    py: Python<'_>,
    total: u64,
    progress: Option<&Bound<'_, PyAny>>,
    after_end: AfterEnd,
    work: impl FnOnce(&Steps) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let steps = Arc::new(Steps::default());
    let receiver = started(steps.clone(), work).map_err(raised)?;
    let mut told = 0;
    let mut tell = |all: bool| -> PyResult<()> {
        let done = steps.done.load(Ordering::Relaxed);
        match progress {
            // A call takes time of the interpreter, so it is made only if something has changed.
            Some(progress) if all || done != told => {
                told = done;
                // A play may last some milliseconds longer than its duration.
                progress.call1((done.min(total), total)).map(drop)
            }
            _ => Ok(()),
        }
    };
    // `detach` takes only what threads may share, which a receiver alone is not.
    let receiver = Mutex::new(receiver);
    loop {
        let outcome = py.detach(|| match receiver.lock() {
            Ok(receiver) => receiver.recv_timeout(POLL),
            Err(_) => Err(RecvTimeoutError::Disconnected),
        });
        match outcome {
            Ok(outcome) => {
                let outcome = outcome.map_err(raised)?;
                tell(true)?;
                return Ok(outcome);
            }
            Err(RecvTimeoutError::Timeout) => {
                if let Err(raised) = py.check_signals().and_then(|()| tell(false)) {
                    steps.is_ended.store(true, Ordering::Relaxed);
                    if after_end != AfterEnd::Returns {
                        // Without the lock of the interpreter, so that other threads of Python go on. The outcome no
                        // longer matters.
                        py.detach(|| receiver.lock().map(|ended| ended.recv().map(drop)).ok());
                    }
                    return Err(raised);
                }
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err(
                    "the work has panicked, which is a fault of stylus_haptics: report what standard error says",
                ));
            }
        }
    }
}
