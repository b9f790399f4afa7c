//! Tests of the kernel on emulated processors. They are one program, because each test program links the whole product.

mod bounds;
mod costs;
mod kernel;

use std::path::PathBuf;

use tasks::qemu::{self, Processor};
use tasks::toolchain::Toolchain;

/// Builds the image for `processor`.
fn image(processor: Processor) -> PathBuf {
    held(Toolchain::find().and_then(|toolchain| qemu::build_guest(&toolchain, processor)))
}

/// Returns the value, or panics with the whole message of the failure.
#[track_caller]
fn held<T>(checked: anyhow::Result<T>) -> T {
    checked.unwrap_or_else(|error| panic!("{error:#}"))
}
