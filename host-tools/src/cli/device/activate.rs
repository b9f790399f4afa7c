//! `stylus activate`

use host_tools::support::error::{Error, Result};
use serde::Serialize;

use super::connection::Link;
use super::slot::Slot;
use crate::cli::output::{print, print_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// Slot to activate [default: the one uploaded last]
    #[arg(value_enum, ignore_case = true)]
    slot: Option<Slot>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct ActivationReport {
    slot: String,
    crc32: u32,
    sequence: u32,
    textures: u16,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let slot = match arguments.slot {
        Some(slot) => slot.into(),
        None => device
            .newest_slot()?
            .ok_or_else(|| Error::Request("no slot holds a library; upload one".to_owned()))?,
    };
    let activated = device.activate(slot)?;
    let library = activated.library;
    if arguments.json {
        return print_json(&ActivationReport {
            slot: activated.slot.to_string(),
            crc32: library.crc32,
            sequence: library.sequence,
            textures: library.textures,
        });
    }
    print(&format!(
        "slot {} is active: {} texture(s), checksum {:08x}",
        activated.slot, library.textures, library.crc32
    ))
}
