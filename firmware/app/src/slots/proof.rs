//! Proof of a slot's direct forms, once per library and version of the proof.
//!
//! A certificate is a checksum: whoever can write a library can write one with nothing behind it. So the device proves
//! each cell itself, by [`stylus_kernel::proof`], before a library may be played, and keeps the result as a mark in the
//! slot. Lattices need none of this.

use core::fmt;
use core::ops::ControlFlow;

use embassy_futures::yield_now;
use model_format::link::{SlotFault, SlotId};
use model_format::{Library, Outline};
use stylus_kernel::proof::{Proof, Refusal, is_needed};

use super::mark::{MARK_OFFSETS, NotProved, Proved, mark_of};
use super::{MappedFlash, SlotStore, address};
use crate::flash::WORD_BYTES;
use crate::words::in_words;

impl<F: MappedFlash> SlotStore<F> {
    /// Proves the direct forms of the valid library in `slot`, unless a mark says that this was done. Each word of the
    /// library was read since the last write. `told` gets the progress after each step, ‰, and may call the proof off;
    /// a new mark is written if `may_write`.
    ///
    /// # Errors
    /// The slot has no library, or one that is not proved; it counts as faulty then. Or the proof was called off.
    pub(crate) async fn prove(
        &mut self,
        slot: SlotId,
        may_write: bool,
        told: impl FnMut(u16) -> ControlFlow<()>,
    ) -> Result<(), NotProved> {
        let (Some(info), Some(outline)) = (self.library(slot), self.outlines[slot.index()]) else {
            return Err(SlotFault::Unfinished.into());
        };
        let library = outline.library(self.mapped(slot, info.length)?);
        if library.is_none_or(|library| !is_needed(&library)) {
            return Ok(());
        }
        let mark = mark_of(info.length, info.crc32);
        let free = match self.place_of_mark(slot, &mark).await {
            Place::Marked => return Ok(()),
            Place::Free(offset) => Some(offset),
            Place::Full => None,
        };
        let proved = self.prove_content(slot, info.length, outline, told).await;
        if let Err(NotProved::Fault(fault)) = &proved {
            self.set_state(slot, super::SlotState::Faulty(fault.clone()));
        }
        proved?;
        if may_write && let Some(offset) = free {
            // Without a mark the library is proved again next time, so that a failure costs only that.
            let _ = self.flash.write(address(slot, offset), &mark).await;
        }
        Ok(())
    }

    /// Proves the direct forms of the library with this outline, in steps with yields in between. `told` gets the
    /// progress after each step, ‰, and may call the proof off.
    ///
    /// # Errors
    /// A cell that is not proved; bytes that cannot be read; the proof was called off.
    pub(super) async fn prove_content(
        &self,
        slot: SlotId,
        length: u32,
        outline: Outline,
        mut told: impl FnMut(u16) -> ControlFlow<()>,
    ) -> Result<Proved, NotProved> {
        let bytes = self.mapped(slot, length)?;
        let library = outline.library(bytes).ok_or(SlotFault::Unfinished)?;
        if !is_needed(&library) {
            return Ok(Proved::NotNeeded);
        }
        let mut proof = Proof::new(library);
        loop {
            match proof.step() {
                Ok(true) => {}
                Ok(false) => return Ok(Proved::Stable),
                Err(refusal) => {
                    let reason = in_words(&Unproved { library, refusal });
                    return Err(SlotFault::Unproved { reason }.into());
                }
            }
            if told(proof.permille()).is_break() {
                return Err(NotProved::CalledOff);
            }
            yield_now().await;
        }
    }

    async fn place_of_mark(&mut self, slot: SlotId, mark: &[u8; WORD_BYTES]) -> Place {
        let mut place = Place::Full;
        for offset in MARK_OFFSETS.step_by(WORD_BYTES) {
            // A word that cannot be read, as after a power cut, is neither a mark nor free.
            match self.read_word(slot, offset).await {
                Some(word) if word == *mark => return Place::Marked,
                Some(word) if word == [0xff; WORD_BYTES] && place == Place::Full => {
                    place = Place::Free(offset);
                }
                _ => {}
            }
        }
        place
    }
}

/// Place of a library's mark in its slot.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    Marked,
    /// There is none; it may be written at this offset.
    Free(u32),
    Full,
}

/// A refusal with the names and values of its library.
struct Unproved<'a> {
    library: Library<'a>,
    refusal: Refusal,
}

impl fmt::Display for Unproved<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Refusal {
            texture,
            speed,
            force,
            cause,
            ..
        } = self.refusal;
        let Some(texture) = self.library.textures().nth(texture) else {
            return Ok(());
        };
        write!(
            f,
            "texture '{}' is {cause}, in the cell from {} mm/s and {} N up, near {} Hz",
            texture.name(),
            texture.speed(speed).0,
            texture.force(force).0,
            self.refusal.frequency_hz(texture.sample_rate_hz()),
        )
    }
}
