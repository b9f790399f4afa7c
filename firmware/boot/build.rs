//! Linker arguments for the bootloader.

use std::{env, error::Error};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=boot.x");
    println!("cargo::rerun-if-changed=../../memory.x");
    if env::var_os("CARGO_FEATURE_IMAGE").is_some() && env::var("CARGO_CFG_TARGET_ARCH")? == "arm" {
        println!("cargo::rustc-link-search={}", env::var("CARGO_MANIFEST_DIR")?);
        for argument in ["-Tboot.x", "--nmagic"] {
            println!("cargo::rustc-link-arg-bin=stylus-boot={argument}");
        }
    }
    Ok(())
}
