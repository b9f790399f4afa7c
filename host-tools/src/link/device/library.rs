//! Requests about the libraries in the device: what its slots hold, and which of them is played.

use std::thread;
use std::time::Instant;

use model_format::link::{
    ActivateEndpoint, Activated, ListEndpoint, ListRequest, ListSceneEndpoint, SceneInfo, SlotId,
    SlotState, Slots, SlotsEndpoint, TextureInfo,
};

use super::connection::{Device, POLL_INTERVAL};
use crate::link::error::Result;

impl Device {
    /// Reads the content of both slots.
    ///
    /// # Errors
    /// A lost link or a missing answer.
    pub fn slots(&self) -> Result<Slots> {
        // The device may have to read and check a whole slot.
        self.request_flash::<SlotsEndpoint>("slot list", &())
    }

    /// Slot of the library that was uploaded last; none if no slot holds a library.
    ///
    /// # Errors
    /// Those of [`Self::slots`].
    pub fn newest_slot(&self) -> Result<Option<SlotId>> {
        let slots = self.slots()?.slots;
        let sequences = SlotId::ALL
            .into_iter()
            .zip(&slots)
            .filter_map(|(id, state)| match state {
                SlotState::Valid(library) => Some((library.sequence, id)),
                _ => None,
            });
        let newest = sequences.max_by_key(|&(sequence, _)| sequence);
        Ok(newest.map(|(_, id)| id))
    }

    /// Reads the list of textures in `slot`; an empty one if the slot holds no library.
    ///
    /// # Errors
    /// A lost link, a missing answer, or a texture that the device cannot list.
    pub fn textures(&self, slot: SlotId) -> Result<Vec<TextureInfo>> {
        let count = match &self.slots()?.slots[slot.index()] {
            SlotState::Valid(library) => library.textures,
            _ => 0,
        };
        (0..=u8::MAX)
            .take(usize::from(count))
            .map(|index| {
                let request = ListRequest { slot, index };
                Ok(self.request_flash::<ListEndpoint>("texture list", &request)??)
            })
            .collect()
    }

    /// Reads the list of scenes in `slot`; an empty one if the slot holds no library.
    ///
    /// # Errors
    /// A lost link, a missing answer, or a scene that the device cannot list.
    pub fn scenes(&self, slot: SlotId) -> Result<Vec<SceneInfo>> {
        let count = match &self.slots()?.slots[slot.index()] {
            SlotState::Valid(library) => library.scenes,
            _ => 0,
        };
        (0..count)
            .map(|index| {
                let request = ListRequest { slot, index };
                Ok(self.request_flash::<ListSceneEndpoint>("scene list", &request)??)
            })
            .collect()
    }

    /// Makes the library in `slot` the active one, and confirms it by the status.
    ///
    /// # Errors
    /// A refusal, or a status that names another library as active.
    pub fn activate(&self, slot: SlotId) -> Result<Activated> {
        let activated = self.request_flash::<ActivateEndpoint>("activation", &slot)??;
        let begin = Instant::now();
        loop {
            let status = self.status()?;
            let crc32 = activated.library.crc32;
            if status.active == Some(slot) && status.library_crc32 == crc32 {
                return Ok(activated);
            }
            if begin.elapsed() >= self.timeouts().answer {
                return Err(self.not_verified(format!(
                    "slot {slot} was activated, but the status reports {} as active: activate it again",
                    status
                        .active
                        .map_or("no slot".to_owned(), |slot| format!("slot {slot}"))
                )));
            }
            thread::sleep(POLL_INTERVAL);
        }
    }
}
