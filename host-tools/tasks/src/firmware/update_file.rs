//! Files of updates, and the keys that sign them.

use std::path::{Path, PathBuf};
use std::{env, fs};

use anyhow::{Context, Result, bail};
use model_format::link::{BoardName, DEVELOPMENT_SEED, HEADER_BYTES, ImageVersion, UNSIGNED};
use stylus_app::update::{public_key, sign};
use stylus_board::Board;

use super::read;
use super::segments::flashed;

/// Arguments of `cargo tasks image`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The secret key that `cargo tasks keys` wrote; without it, the development key, which everybody has
    #[arg(long)]
    pub key: Option<PathBuf>,
    /// Sign with zeros: a stylus takes the file whose button was held when power came on
    #[arg(long, conflicts_with = "key")]
    pub unsigned: bool,
    /// The file to write [default: beside the image's ELF file, with the extension image]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Writes the update for the ELF file `image` of `board`, signed as `arguments` request, and returns the written file.
///
/// # Errors
/// The image or the key cannot be read, the image trusts the development key but another key is given, or the update
/// cannot be written.
pub fn write(image: &Path, board: &Board, arguments: &Arguments) -> Result<PathBuf> {
    let seed = match &arguments.key {
        Some(_) if env::var_os("STYLUS_UPDATE_KEY").is_none() => bail!(
            "this image trusts the development key, so it would take anybody's updates: set STYLUS_UPDATE_KEY to the \
             file of the public key"
        ),
        Some(path) => read_key(path)?,
        None => DEVELOPMENT_SEED,
    };
    let version = ImageVersion::read(env!("CARGO_PKG_VERSION")).context("a version has numbers")?;
    let body = flashed(&read(image)?, "FLASH")?;
    let mut signed = sign(BoardName::new(board.name), &body, version, &seed);
    if arguments.unsigned {
        // The signature follows the header.
        signed[HEADER_BYTES..].copy_from_slice(&UNSIGNED);
    }
    let out = arguments.out.clone().unwrap_or_else(|| image.with_extension("image"));
    fs::write(&out, [&signed[..], &body].concat()).with_context(|| out.display().to_string())?;
    Ok(out)
}

/// Generates a pair of keys. Writes the secret key to the new file `path`, and the public key next to it to a new file
/// with the extension pub. Returns the file of the public key.
///
/// # Errors
/// `path` has the extension pub, a file exists already or cannot be written, or the system provides no random numbers.
pub fn make_keys(path: &Path) -> Result<PathBuf> {
    let public = path.with_extension("pub");
    if public == path {
        bail!("pub is the extension of the public key's file: name another file for the secret key");
    }
    if let Some(there) = [path, &public].into_iter().find(|file| file.exists()) {
        bail!("{} is there already: name another file", there.display());
    }
    let mut seed = [0; 32];
    getrandom::fill(&mut seed).context("the system gives no random numbers")?;
    write_secret(path, &(digits(&seed) + "\n")).with_context(|| path.display().to_string())?;
    fs::write(&public, digits(&public_key(&seed)) + "\n").with_context(|| public.display().to_string())?;
    Ok(public)
}

/// Writes a new file. On Unix only its owner may read it.
fn write_secret(path: &Path, text: &str) -> std::io::Result<()> {
    let mut options = fs::OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    std::io::Write::write_all(&mut options.open(path)?, text.as_bytes())
}

fn digits(bytes: &[u8]) -> String {
    bytes
        .iter()
        .fold(String::new(), |text, byte| text + &format!("{byte:02x}"))
}

fn read_key(path: &Path) -> Result<[u8; 32]> {
    let bytes = String::from_utf8(read(path)?)
        .ok()
        .as_deref()
        .map(str::trim)
        .and_then(|digits| {
            let byte = |index: usize| u8::from_str_radix(digits.get(2 * index..2 * index + 2)?, 16).ok();
            (digits.len() == 64).then(|| (0..32).map(byte).collect::<Option<Vec<u8>>>())?
        });
    bytes
        .and_then(|bytes| bytes.try_into().ok())
        .with_context(|| format!("{}: not a key that `cargo tasks keys` wrote", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_of_keys_comes_back_and_is_never_overwritten() {
        let folder = tempfile::tempdir().expect("there is room");
        let path = folder.path().join("key");
        let public = make_keys(&path).expect("it is written");
        let seed = read_key(&path).expect("it is a key");
        let expected = digits(&public_key(&seed));
        let text = fs::read_to_string(&public).expect("it was written");
        assert_eq!(text.trim(), expected);
        assert!(make_keys(&path).is_err());
        assert_eq!(read_key(&path).ok(), Some(seed));
        assert!(read_key(Path::new("/nowhere")).is_err());
        fs::write(&public, "no key").expect("it is written");
        assert!(read_key(&public).is_err());
        fs::remove_file(&path).expect("it is there");
        assert!(make_keys(&path).is_err() && !path.exists());
        assert_eq!(fs::read_to_string(&public).ok().as_deref(), Some("no key"));
        assert!(make_keys(&folder.path().join("other.pub")).is_err());
        assert!(!folder.path().join("other.pub").exists());
    }
}
