//! `stylus upload` and `stylus update`: a library or an image for the stylus's flash.

use std::path::{Path, PathBuf};

use model_format::link::UploadState;
use serde::Serialize;
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_link::link::upload::{Step, UpdateFile, update};
use stylus_link::link::upload::{Uploaded, upload_over};
use stylus_support::number::counted;
use stylus_support::{Result, progress};

use super::Link;
use crate::cli::output::{note, print, print_json, warn};

#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub struct Arguments {
    /// Library to upload
    #[arg(required_unless_present = "abort")]
    library: Option<PathBuf>,
    /// End the upload that is under way
    #[arg(long, conflicts_with_all = ["library", "activate", "replace_last"])]
    abort: bool,
    /// Activate the library
    #[arg(long)]
    activate: bool,
    /// Allow the upload to erase the only library that the device can still read
    #[arg(long)]
    replace_last: bool,
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

/// State of the upload before and after an abort.
#[derive(Serialize)]
struct Aborted {
    before: UploadState,
    after: UploadState,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.library {
        Some(library) => upload(arguments, library),
        // Without a library, an abort is the only possible request.
        None => abort(arguments),
    }
}

/// Aborts the upload that is under way, and reports its state.
fn abort(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let before = device.upload_progress()?;
    let after = device.upload_abort()?;
    if arguments.json {
        return print_json(&Aborted { before, after });
    }
    print(&match before {
        UploadState::Idle => "no upload was under way".to_owned(),
        UploadState::Receiving(progress) => format!(
            "the upload to slot {} was ended; {} of {} bytes had arrived",
            progress.slot, progress.next_offset, progress.upload.length
        ),
    })
}

fn upload(arguments: &Arguments, path: &Path) -> Result<()> {
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let mut device = arguments.link.connect()?;
    // A device of another format would refuse the library only after the whole of it was sent.
    device.check_library_format()?;
    if arguments.replace_last {
        warn(
            "--replace-last may erase the last library that the device can read: until the upload is done, a restart \
             leaves it without one",
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
    super::headroom::warn_of(&device, &library);
    if arguments.json {
        return print_json(&UploadReport {
            library: path.display().to_string(),
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
    show(path, &uploaded, arguments.activate)
}

/// Prints what was uploaded from `path`, and how.
fn show(path: &Path, uploaded: &Uploaded, is_active: bool) -> Result<()> {
    if uploaded.resumed_from > 0 {
        note(&format!(
            "resumed: {} bytes were uploaded before",
            uploaded.resumed_from
        ));
    }
    if uploaded.retries > 0 {
        warn(&format!(
            "the upload was resumed {}, because the link failed",
            counted(uploaded.retries, "time")
        ));
    }
    print(&format!(
        "{} -> slot {} ({} bytes, read back): {}{}",
        path.display(),
        uploaded.slot,
        uploaded.library.length,
        uploaded.textures.join(", "),
        if is_active {
            "; active".to_owned()
        } else {
            format!("; `stylus slots --activate {}` makes it the active one", uploaded.slot)
        }
    ))
}

#[derive(clap::Args)]
pub struct UpdateArguments {
    /// The signed file that `cargo tasks image` wrote
    image: PathBuf,
    /// Allow an older version than the one that runs
    #[arg(long)]
    allow_downgrade: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

pub fn update_image(arguments: &UpdateArguments) -> Result<()> {
    let file = UpdateFile::read(&arguments.image)?;
    // The image that runs may speak another version of the protocol, which this update then ends.
    let mut device = arguments.link.connect_to_any()?;
    note(
        "note: an update gives up the library in the slot that is not active; settings and the active library stay. \
         Keep the device on its supply",
    );
    let bytes = file.header.length;
    let bar = progress::bar(u64::from(bytes), "sending");
    let updated = update(&mut device, &file, arguments.allow_downgrade, |step| match step {
        Step::Sent(there) => bar.set_position(there as u64),
        Step::Exchanging => {
            bar.finish_and_clear();
            note("the device exchanges the images, which takes some ten seconds");
        }
    })?;
    if updated.after.trusts_development_key {
        warn("the image trusts the development key, so it takes anybody's updates: `cargo tasks keys` makes a key");
    }
    if arguments.json {
        return print_json(&updated);
    }
    print(&format!(
        "{} -> {} ({bytes} bytes): sent in {:.1} s, answered after {:.1} s, confirmed",
        updated.before.image, updated.after.image, updated.sent_s, updated.exchanged_s
    ))
}
