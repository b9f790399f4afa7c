//! Long simulated use on the virtual stylus: two hosts act at random for hours of the device's time, with random
//! faults. The test is `tests/image/soak`.

use std::hash::{BuildHasher, RandomState};
use std::time::Duration;

use anyhow::{Context, Result};

use crate::toolchain::Toolchain;
use crate::{attack, virtual_stylus};

/// Options of `cargo tasks soak`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Time of the device that the stylus is used: a number with s, m or h
    #[arg(long = "for", value_name = "TIME", value_parser = attack::duration, default_value = "10m")]
    time: Duration,
    /// The seed from which all of it follows, which a failure has named [default: a fresh one]
    #[arg(long)]
    seed: Option<u64>,
}

/// Builds the images and runs the test as long as requested.
///
/// # Errors
/// A build fails, or an invariant does not hold. The message contains the seed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let toolchain = Toolchain::find()?;
    let seed = arguments.seed.unwrap_or_else(|| RandomState::new().hash_one(0));
    println!("soak, seed {seed}");
    let variables = [
        ("STYLUS_SOAK_SECONDS", arguments.time.as_secs()),
        ("STYLUS_SOAK_SEED", seed),
    ];
    let again = || format!("to see it again: cargo tasks soak --seed {seed}");
    virtual_stylus::soak(&toolchain, variables).with_context(again)
}
