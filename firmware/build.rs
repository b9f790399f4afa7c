//! Profile and compiler of the image, for its answer to the identity request.

use std::{env, error::Error, process::Command};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=STYLUS_PROFILE={}", env::var("PROFILE")?);
    let compiler = Command::new(env::var("RUSTC")?).arg("--version").output()?;
    let compiler = String::from_utf8(compiler.stdout)?;
    println!("cargo::rustc-env=STYLUS_COMPILER={}", compiler.trim());
    Ok(())
}
