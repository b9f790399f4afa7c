//! Linker arguments for the memory map of the image.

use std::{env, error::Error, fs, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    // Only the image is linked here; the emulator's guest has its own memory map.
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
    println!("cargo::rerun-if-changed={}", package.join("tick.x").display());
    println!("cargo::rerun-if-changed={}", root.join("memory.x").display());
    // `tick.x` comes first, because the other scripts would place the sections that it names.
    for argument in ["-Ttick.x", "-Tlink.x", "-Tdefmt.x", "--nmagic", "--emit-relocs"] {
        println!("cargo::rustc-link-arg-bin=stylus-firmware={argument}");
    }
    // The file that is flashed holds image and bootloader. Without the bootloader the image is linked only for checks.
    println!("cargo::rerun-if-env-changed=STYLUS_BOOTLOADER");
    if let Some(file) = env::var_os("STYLUS_BOOTLOADER") {
        println!("cargo::rerun-if-changed={}", Path::new(&file).display());
        let out = env::var("OUT_DIR")?;
        fs::write(Path::new(&out).join("both.x"), both(&fs::read(file)?))?;
        println!("cargo::rustc-link-search={out}");
        println!("cargo::rustc-link-arg-bin=stylus-firmware=-Tboth.x");
    }
    Ok(())
}

/// Returns a linker script for everything that is flashed in addition to the image: the bootloader, and a word of ones
/// in each sector of the record of updates. Because of these words, the flashing tool erases the sectors, so the
/// bootloader has nothing to do at the first start. The word is the sector's last and lies far from the first places
/// for records. The reason: a debug probe fills up its page with programmed ones, and the manual does not say that such
/// a word can be programmed again (RM0433 section 4.3.9).
fn both(bootloader: &[u8]) -> String {
    let words = bootloader.chunks(4).map(|part| {
        let mut word = [0xFF; 4];
        word[..part.len()].copy_from_slice(part);
        format!("LONG({:#x})\n", u32::from_le_bytes(word))
    });
    let erased = "LONG(0xffffffff) ".repeat(8);
    let [end_1, end_2] = ["RECORDS_1", "RECORDS_2"].map(|region| format!("ORIGIN({region}) + LENGTH({region}) - 32"));
    format!(
        "SECTIONS {{\n.bootloader : {{\n{}}} > BOOTLOADER\n\
         .records_1 {end_1} : {{ {erased} }} > RECORDS_1\n\
         .records_2 {end_2} : {{ {erased} }} > RECORDS_2\n}}\nINSERT BEFORE .text;\n",
        words.collect::<String>()
    )
}
