//! The kernel on emulated processors: one program, because each links all of the product.

mod bounds;
mod costs;
mod hard_cases;
mod kernel;

use std::path::PathBuf;

use tasks::guest::{self, Processor};
use tasks::toolchain::Toolchain;

/// The image for `processor`.
fn image(processor: Processor) -> PathBuf {
    held(Toolchain::find().and_then(|toolchain| guest::build(&toolchain, processor)))
}

/// The value; panics with the whole message of a failure.
#[track_caller]
fn held<T>(checked: anyhow::Result<T>) -> T {
    checked.unwrap_or_else(|error| panic!("{error:#}"))
}
