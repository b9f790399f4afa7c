//! `stylus update`

use std::path::PathBuf;

use stylus_link::link::update::{Step, UpdateFile, update};
use stylus_support::Result;
use stylus_support::progress;

use super::connection::Link;
use crate::cli::output::{note, print, print_json, warn};

#[derive(clap::Args)]
pub struct Arguments {
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

pub fn run(arguments: &Arguments) -> Result<()> {
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
