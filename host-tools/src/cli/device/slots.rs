//! `stylus slots`: the libraries in the stylus, and which of them is active.

use model_format::link::{SceneInfo, SlotId, SlotState};
use serde::Serialize;
use stylus_link::link::Device;
use stylus_link::link::{SlotContent, TextureEntry};
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::Link;
use crate::cli::output::{print, print_json};
use crate::cli::table::{headed, table};

/// A slot on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
#[value(rename_all = "UPPER")]
pub enum Slot {
    A,
    B,
    // Stands for `--activate` without a slot. Nobody types it.
    #[value(hide = true)]
    Newest,
}

impl Slot {
    /// Returns the slot if one is named, `None` for the newest.
    pub fn id(self) -> Option<SlotId> {
        match self {
            Self::A => Some(SlotId::A),
            Self::B => Some(SlotId::B),
            Self::Newest => None,
        }
    }
}

#[derive(clap::Args)]
pub struct Arguments {
    /// Make the library of this slot the active one [without a slot: the one uploaded last]
    #[arg(
        long,
        value_name = "SLOT",
        value_enum,
        ignore_case = true,
        num_args = 0..=1,
        default_missing_value = "NEWEST"
    )]
    activate: Option<Slot>,
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    if let Some(slot) = arguments.activate {
        return activate(&device, slot, arguments.json);
    }
    let slots = device.contents()?;
    if arguments.json {
        return print_json(&slots);
    }
    let texts: Vec<String> = slots.iter().map(text).collect();
    print(&texts.join("\n\n"))
}

#[derive(Serialize)]
struct ActivationReport {
    slot: String,
    crc32: u32,
    sequence: u32,
    textures: u16,
}

fn activate(device: &Device, slot: Slot, is_json: bool) -> Result<()> {
    let slot = match slot.id() {
        Some(slot) => slot,
        None => device
            .newest()?
            .map(|(slot, _)| slot)
            .ok_or_else(|| Error::Request("no slot holds a library; upload one".to_owned()))?,
    };
    let activated = device.activate(slot)?;
    let library = activated.library;
    if is_json {
        return print_json(&ActivationReport {
            slot: activated.slot.to_string(),
            crc32: library.crc32,
            sequence: library.sequence,
            textures: library.textures,
        });
    }
    print(&format!(
        "slot {} is active: {}, checksum {:08x}",
        activated.slot,
        counted(library.textures, "texture"),
        library.crc32
    ))
}

fn text(slot: &SlotContent) -> String {
    let active = if slot.active { " (active)" } else { "" };
    let state = match &slot.state {
        SlotState::Empty => "empty".to_owned(),
        SlotState::Receiving => {
            "an upload has begun and is not complete: `stylus upload LIB` goes on with it".to_owned()
        }
        SlotState::Faulty(fault) => fault.to_string(),
        SlotState::Valid(library) => format!(
            "{}, {}, {}, checksum {:08x}, upload {}\n\n{}{}",
            counted(library.textures, "texture"),
            counted(library.scenes, "scene"),
            counted(library.length, "byte"),
            library.crc32,
            library.sequence,
            textures(&slot.textures),
            scenes(&slot.scenes)
        ),
    };
    format!("slot {}{active}: {state}", slot.name)
}

fn textures(textures: &[TextureEntry]) -> String {
    let range = |[low, high]: [f32; 2]| {
        if low == high {
            low.to_string()
        } else {
            format!("{low} to {high}")
        }
    };
    let (header, rows) = headed(textures.iter().map(|texture| {
        [
            ("texture", texture.name.clone()),
            ("from", texture.provenance.clone()),
            ("Hz", texture.sample_rate_hz.to_string()),
            ("grid", format!("{} x {}", texture.speeds, texture.forces)),
            ("mm/s", range(texture.speed_range_mm_s)),
            ("N", range(texture.force_range_n)),
            ("order", texture.max_order.to_string()),
            ("silent", texture.silent_nodes.to_string()),
            ("filled", texture.filled_nodes.to_string()),
            ("doubtful", texture.doubtful_nodes.to_string()),
        ]
    }));
    table(&header, &rows)
}

/// Returns a table of scenes; empty without scenes.
fn scenes(scenes: &[SceneInfo]) -> String {
    if scenes.is_empty() {
        return String::new();
    }
    let (header, rows) = headed(scenes.iter().map(|scene| {
        let motion = if scene.constant_motion { "constant" } else { "followed" };
        [
            ("scene", scene.name.to_string()),
            ("surfaces", scene.surfaces.to_string()),
            ("regions", scene.regions.to_string()),
            ("taps", scene.taps.to_string()),
            ("stick-slip", scene.stick_slips.to_string()),
            ("equaliser", scene.sections.to_string()),
            ("motion", motion.to_owned()),
        ]
    }));
    format!("\n\n{}", table(&header, &rows))
}
