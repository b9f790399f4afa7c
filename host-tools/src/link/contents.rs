//! The content of a device's slots: their libraries with textures and scenes.

use model_format::link::{SceneInfo, SlotId, SlotState, TextureInfo};
use serde::Serialize;

use super::device::Device;
use super::error::Result;

/// A slot with its content.
#[derive(Clone, Debug, Serialize)]
pub struct SlotContent {
    /// Name of the slot.
    #[serde(rename = "slot")]
    pub name: String,
    /// True if it is the one that is played.
    pub active: bool,
    /// Its state.
    pub state: SlotState,
    /// Textures of its library; none unless it is valid.
    pub textures: Vec<TextureEntry>,
    /// Scenes of its library.
    pub scenes: Vec<SceneInfo>,
}

/// A texture in the device, with its enums in words.
#[derive(Clone, Debug, Serialize)]
pub struct TextureEntry {
    /// Name.
    pub name: String,
    /// Origin of its recordings.
    pub provenance: String,
    /// Sample rate, Hz.
    pub sample_rate_hz: u32,
    /// Highest order of its nodes.
    pub max_order: u16,
    /// Number of speeds of its grid.
    pub speeds: u8,
    /// Number of forces of its grid.
    pub forces: u8,
    /// Lowest and highest speed, mm/s.
    pub speed_range_mm_s: [f32; 2],
    /// Lowest and highest force, N.
    pub force_range_n: [f32; 2],
    /// Number of nodes that are silent.
    pub silent_nodes: u16,
    /// Number of nodes that were filled from neighbours.
    pub filled_nodes: u16,
    /// Number of nodes with a doubtful recording.
    pub doubtful_nodes: u16,
}

impl From<TextureInfo> for TextureEntry {
    fn from(info: TextureInfo) -> Self {
        Self {
            name: info.name.to_string(),
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

impl Device {
    /// Lists both slots with their textures and scenes.
    ///
    /// # Errors
    /// A lost link, a missing answer, or a slot that cannot be listed.
    pub fn contents(&self) -> Result<Vec<SlotContent>> {
        let both = self.slots()?;
        let of_slot = |(id, state): (SlotId, SlotState)| {
            let (textures, scenes) = match &state {
                SlotState::Valid(_) => (self.textures(id)?, self.scenes(id)?),
                _ => (Vec::new(), Vec::new()),
            };
            Ok(SlotContent {
                name: id.to_string(),
                active: both.active == Some(id),
                state,
                textures: textures.into_iter().map(TextureEntry::from).collect(),
                scenes,
            })
        };
        SlotId::ALL
            .into_iter()
            .zip(both.slots.clone())
            .map(of_slot)
            .collect()
    }
}
