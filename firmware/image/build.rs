//! Linker arguments for the memory map of the image.

use std::{env, error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    // Only the image is linked here; the emulator's guest has a map of its own.
    if env::var_os("CARGO_FEATURE_IMAGE").is_none() || env::var("CARGO_CFG_TARGET_ARCH")? != "arm" {
        return Ok(());
    }
    let package = env::var("CARGO_MANIFEST_DIR")?;
    let package = Path::new(&package);
    let root = package
        .ancestors()
        .nth(2)
        .ok_or("the package is not in the workspace")?;
    for folder in [package, root] {
        println!("cargo::rustc-link-search={}", folder.display());
    }
    println!(
        "cargo::rerun-if-changed={}",
        package.join("tick.x").display()
    );
    println!(
        "cargo::rerun-if-changed={}",
        root.join("memory.x").display()
    );
    // `tick.x` comes first, because the other scripts would place the sections that it names.
    for argument in [
        "-Ttick.x",
        "-Tlink.x",
        "-Tdefmt.x",
        "--nmagic",
        "--emit-relocs",
    ] {
        println!("cargo::rustc-link-arg-bin=stylus-firmware={argument}");
    }
    Ok(())
}
