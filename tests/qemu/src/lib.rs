//! The kernel on emulated processors: its bits against the host's, its instructions against its budgets and the table
//! of costs, and its bounds.
//!
//! The tests are in `tests/`, and the image that they run is in `guest/`.
