//! Profile and compiler of the image, for its answer to the identity request, and the key that it trusts.

use std::{env, error::Error, fs, path::Path, process::Command};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=STYLUS_PROFILE={}", env::var("PROFILE")?);
    let compiler = Command::new(env::var("RUSTC")?).arg("--version").output()?;
    let compiler = String::from_utf8(compiler.stdout)?;
    println!("cargo::rustc-env=STYLUS_COMPILER={}", compiler.trim());
    // The public half of a pair that `cargo tasks keys` made: 64 hexadecimal digits.
    println!("cargo::rerun-if-env-changed=STYLUS_UPDATE_KEY");
    let key = match env::var_os("STYLUS_UPDATE_KEY") {
        Some(path) => {
            println!("cargo::rerun-if-changed={}", Path::new(&path).display());
            let told = format!("STYLUS_UPDATE_KEY, {}", Path::new(&path).display());
            let text = fs::read_to_string(path).map_err(|error| format!("{told}: {error}"))?;
            key(&text).ok_or_else(|| format!("{told}: no public key of `cargo tasks keys`"))?
        }
        None => "stylus_app::update::DEVELOPMENT_KEY".to_owned(),
    };
    fs::write(Path::new(&env::var("OUT_DIR")?).join("key.rs"), key)?;
    Ok(())
}

/// The key of this text as an array in Rust; none unless the text is 64 hexadecimal digits.
fn key(text: &str) -> Option<String> {
    let digits = text.trim();
    let byte = |index: usize| u8::from_str_radix(digits.get(2 * index..2 * index + 2)?, 16).ok();
    let bytes: Vec<u8> = (0..32).map(byte).collect::<Option<_>>()?;
    (digits.len() == 64).then(|| format!("{bytes:?}"))
}
