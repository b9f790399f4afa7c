//! Plans of Fourier transforms, made once per thread because a grid has hundreds of recordings of equal length.

use std::cell::RefCell;

use realfft::RealFftPlanner;

thread_local! {
    static PLANNER: RefCell<RealFftPlanner<f64>> = RefCell::new(RealFftPlanner::new());
}

/// Calls `work` with this thread's planner of transforms of real signals.
pub(crate) fn with_planner<T>(work: impl FnOnce(&mut RealFftPlanner<f64>) -> T) -> T {
    PLANNER.with_borrow_mut(work)
}
