//! `stylus list`

use host_tools::link::Device;
use host_tools::support::error::Result;
use model_format::link::{SceneInfo, SlotId, SlotState, TextureInfo};
use serde::Serialize;

use super::connection::Link;
use crate::cli::output::{print, print_json};
use crate::cli::table::table;

#[derive(clap::Args)]
pub struct Arguments {
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

/// A slot with its content.
#[derive(Serialize)]
struct Slot {
    #[serde(rename = "slot")]
    name: String,
    active: bool,
    state: SlotState,
    textures: Vec<Texture>,
    scenes: Vec<SceneInfo>,
}

/// A texture in the device, with its enums in words.
#[derive(Serialize)]
struct Texture {
    name: String,
    structure: String,
    provenance: String,
    sample_rate_hz: u32,
    max_order: u16,
    speeds: u8,
    forces: u8,
    speed_range_mm_s: [f32; 2],
    force_range_n: [f32; 2],
    silent_nodes: u16,
    filled_nodes: u16,
    doubtful_nodes: u16,
}

impl From<TextureInfo> for Texture {
    fn from(info: TextureInfo) -> Self {
        Self {
            name: info.name.to_string(),
            structure: info.structure.to_string(),
            provenance: info.provenance.to_string(),
            sample_rate_hz: info.sample_rate_hz,
            max_order: info.max_order,
            speeds: info.speeds,
            forces: info.forces,
            speed_range_mm_s: info.speed_range.map(|speed| speed.0),
            force_range_n: info.force_range.map(|force| force.0),
            silent_nodes: info.silent_nodes,
            filled_nodes: info.filled_nodes,
            doubtful_nodes: info.doubtful_nodes,
        }
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let slots = read(&device)?;
    if arguments.json {
        return print_json(&slots);
    }
    let texts: Vec<String> = slots.iter().map(text).collect();
    print(&texts.join("\n\n"))
}

fn read(device: &Device) -> Result<Vec<Slot>> {
    let both = device.slots()?;
    let of_slot = |(id, state): (SlotId, SlotState)| {
        let (textures, scenes) = match &state {
            SlotState::Valid(_) => (device.textures(id)?, device.scenes(id)?),
            _ => (Vec::new(), Vec::new()),
        };
        Ok(Slot {
            name: id.to_string(),
            active: both.active == Some(id),
            state,
            textures: textures.into_iter().map(Texture::from).collect(),
            scenes,
        })
    };
    SlotId::ALL
        .into_iter()
        .zip(both.slots.clone())
        .map(of_slot)
        .collect()
}

fn text(slot: &Slot) -> String {
    let active = if slot.active { " (active)" } else { "" };
    let state = match &slot.state {
        SlotState::Empty => "empty".to_owned(),
        SlotState::Receiving => "an upload is under way".to_owned(),
        SlotState::Faulty(fault) => fault.to_string(),
        SlotState::Valid(library) => format!(
            "{} texture(s), {} scene(s), {} bytes, checksum {:08x}, upload {}\n\n{}{}",
            library.textures,
            library.scenes,
            library.length,
            library.crc32,
            library.sequence,
            textures(&slot.textures),
            scenes(&slot.scenes)
        ),
    };
    format!("slot {}{active}: {state}", slot.name)
}

fn textures(textures: &[Texture]) -> String {
    let header = [
        "texture",
        "from",
        "structure",
        "Hz",
        "grid",
        "mm/s",
        "N",
        "order",
        "silent",
        "filled",
        "doubtful",
    ];
    let range = |[low, high]: [f32; 2]| {
        if low == high {
            low.to_string()
        } else {
            format!("{low} to {high}")
        }
    };
    let rows: Vec<Vec<String>> = textures
        .iter()
        .map(|texture| {
            vec![
                texture.name.clone(),
                texture.provenance.clone(),
                texture.structure.clone(),
                texture.sample_rate_hz.to_string(),
                format!("{} x {}", texture.speeds, texture.forces),
                range(texture.speed_range_mm_s),
                range(texture.force_range_n),
                texture.max_order.to_string(),
                texture.silent_nodes.to_string(),
                texture.filled_nodes.to_string(),
                texture.doubtful_nodes.to_string(),
            ]
        })
        .collect();
    table(&header, &rows)
}

/// Table of scenes; empty without scenes.
fn scenes(scenes: &[SceneInfo]) -> String {
    if scenes.is_empty() {
        return String::new();
    }
    let header = [
        "scene",
        "surfaces",
        "regions",
        "taps",
        "stick-slip",
        "equaliser",
        "motion",
    ];
    let rows: Vec<Vec<String>> = scenes
        .iter()
        .map(|scene| {
            vec![
                scene.name.to_string(),
                scene.surfaces.to_string(),
                scene.regions.to_string(),
                scene.taps.to_string(),
                scene.stick_slips.to_string(),
                scene.sections.to_string(),
                if scene.constant_motion {
                    "constant".to_owned()
                } else {
                    "followed".to_owned()
                },
            ]
        })
        .collect();
    format!("\n\n{}", table(&header, &rows))
}
