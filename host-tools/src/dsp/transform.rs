//! Plans of Fourier transforms, made once a thread: a grid has hundreds of recordings of one length.

use std::cell::RefCell;

use realfft::RealFftPlanner;

thread_local! {
    static PLANNER: RefCell<RealFftPlanner<f64>> = RefCell::new(RealFftPlanner::new());
}

/// Lets `work` plan transforms of real signals.
pub(crate) fn with_planner<T>(work: impl FnOnce(&mut RealFftPlanner<f64>) -> T) -> T {
    PLANNER.with_borrow_mut(work)
}
