//! `stylus upload`

use std::path::PathBuf;

use host_tools::link::upload::upload_over;
use host_tools::support::error::{Error, Result};
use host_tools::support::progress;
use host_tools::texture::certificate;
use serde::Serialize;

use super::connection::Link;
use crate::cli::library_file::{decode_library, read_library};
use crate::cli::output::{note, print, print_json, warn};

#[derive(clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a flag of the command line"
)]
pub struct Arguments {
    /// Library to upload
    library: PathBuf,
    /// Activate the library
    #[arg(long)]
    activate: bool,
    /// Allow the upload to erase the last library that the device can read
    #[arg(long)]
    replace_last: bool,
    /// Skip the check on this computer; the device still checks the library
    #[arg(long)]
    unchecked: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct UploadReport<'a> {
    library: String,
    bytes: u32,
    crc32: u32,
    slot: String,
    sequence: u32,
    textures: &'a [String],
    resumed_from: u32,
    retries: u32,
    active: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let bytes = read_library(&arguments.library)?;
    if !arguments.unchecked {
        let library = decode_library(&arguments.library, &bytes)?;
        certificate::prove_as_device(&library)
            .map_err(|refusal| Error::file(&arguments.library, refusal.to_string()))?;
    }
    let mut device = arguments.link.connect()?;
    if !arguments.unchecked {
        device.check_library_format()?;
    }
    if arguments.replace_last {
        eprintln!(
            "warning: with --replace-last the last library that the device can read may be erased: until the upload is \
             done, a restart would leave it without one"
        );
    }
    let bar = progress::bar(bytes.len() as u64, "uploading");
    let uploaded = upload_over(&mut device, &bytes, arguments.replace_last, |there| {
        bar.set_position(there as u64);
    })?;
    bar.finish_and_clear();
    if arguments.activate {
        device.activate(uploaded.slot)?;
    }
    if arguments.json {
        return print_json(&UploadReport {
            library: arguments.library.display().to_string(),
            bytes: uploaded.library.length,
            crc32: uploaded.library.crc32,
            slot: uploaded.slot.to_string(),
            sequence: uploaded.library.sequence,
            textures: &uploaded.textures,
            resumed_from: uploaded.resumed_from,
            retries: uploaded.retries,
            active: arguments.activate,
        });
    }
    if uploaded.resumed_from > 0 {
        note(&format!(
            "resumed: {} bytes were uploaded before",
            uploaded.resumed_from
        ));
    }
    if uploaded.retries > 0 {
        warn(&format!(
            "the upload was resumed {} time(s), because the link failed",
            uploaded.retries
        ));
    }
    print(&format!(
        "{} -> slot {} ({} bytes, read back): {}{}",
        arguments.library.display(),
        uploaded.slot,
        uploaded.library.length,
        uploaded.textures.join(", "),
        if arguments.activate {
            "; active".to_owned()
        } else {
            format!(
                "; `stylus activate {}` makes it the active one",
                uploaded.slot
            )
        }
    ))
}
