//! Tests of the kernel on emulated processors: that its output equals the host's bit for bit, that its instructions
//! agree with its budgets and the table of costs, and that it keeps its bounds.
//!
//! The tests are in `tests/`, and the image that they run is in `guest/`.
