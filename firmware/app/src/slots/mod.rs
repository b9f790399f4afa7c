//! The two library slots in flash. An upload overwrites one and leaves the other as it is.
//!
//! A slot holds the library's bytes from its start and, in its last [`SLOT_HEADER_BYTES`], a header of one flash word,
//! with copies. An upload erases the header's sector first, and writes the header last, after the bytes have been read
//! back and found valid. So after a power loss at any time, a slot is as it was, or it has no valid header.
//!
//! The boot activates the newest valid slot. A flash word that was being programmed when power was lost may fault when
//! it is read (RM0433 section 4.3.16, double ECC error); such a slot counts as faulty. Each word is therefore read by
//! [`ReadNorFlash::read`], which reports a fault, before the bytes are read in place.
//!
//! Nothing is erased without a `Claim` on its slot, which is refused for the last library that can be read.

mod claim;
mod header;

use core::ops::Range;

use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES, SLOT_HEADER_BYTES};
use model_format::link::{
    FlashOperation, LIBRARY_CRC, ListError, SceneInfo, SlotFault, SlotId, SlotInfo, SlotState, Slots, TextureInfo,
};
use model_format::scene::{MotionOfScene, Scene, Surface};
use model_format::{Decoder, Library, NodeFlags, Outline, Texture, Workspace};
use stylus_boot::record::is_newer;

use crate::words::in_words;

pub use crate::flash::WORD_BYTES;
pub(crate) use claim::{Claim, LastLibrary};
pub use header::HEADER_VERSION;
use header::{Copies, HEADER_OFFSET, Header, HeaderWord};

#[cfg(doc)]
use embedded_storage_async::nor_flash::ReadNorFlash;

/// Bytes read between two yields to other tasks.
const STRIDE_BYTES: usize = 4096;

/// Flash that can also be read in place.
///
/// Slot A starts at offset 0, and slot B at [`SLOT_BYTES`]. `read` must report a word that faults as an error, and not
/// as a bus fault.
pub trait MappedFlash: NorFlash {
    /// The bytes of `range`, each word of which has been read without error since it was last written.
    fn bytes(&self, range: Range<u32>) -> Result<&[u8], Self::Error>;
}

impl<F: MappedFlash> MappedFlash for &mut F {
    fn bytes(&self, range: Range<u32>) -> Result<&[u8], Self::Error> {
        F::bytes(self, range)
    }
}

/// The two slots, their contents, and the active one.
///
/// Of each library, the store keeps only where its textures and scenes are. A library may have 256 textures, too many
/// to keep in RAM what a listing reports about each.
pub struct SlotStore<F> {
    flash: F,
    states: [SlotState; 2],
    /// Outline of each slot's library, as long as its state is valid.
    outlines: [Option<Outline>; 2],
    active: Option<SlotId>,
    /// Memory for decoding, which waits between its steps. It is kept here, because the memory of tasks is faster and
    /// scarce.
    workspace: Workspace,
    /// Highest number of all headers that were seen, including those of libraries that could not be read.
    highest: Option<u32>,
    is_scanned: bool,
}

/// A fault of the flash, with its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashFault {
    /// The slot.
    pub slot: SlotId,
    /// The operation that failed.
    pub operation: FlashOperation,
    /// Offset in the slot.
    pub offset: u32,
}

/// Failure of a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteFault {
    /// The flash reported a fault.
    Flash(FlashFault),
    /// The flash reported no fault, but the bytes read back are different.
    ReadBack {
        /// The slot.
        slot: SlotId,
        /// Offset of the word in the slot.
        offset: u32,
    },
}

impl<F: MappedFlash> SlotStore<F> {
    const FITS: () = {
        assert!(F::WRITE_SIZE == WORD_BYTES, "the flash has words of another length");
        assert!(
            WORD_BYTES.is_multiple_of(F::READ_SIZE),
            "a word is not a whole number of reads"
        );
        assert!(
            SLOT_BYTES.is_multiple_of(F::ERASE_SIZE),
            "a slot is not a whole number of sectors"
        );
        assert!(F::ERASE_SIZE >= SLOT_HEADER_BYTES, "the header does not fit one sector");
    };

    /// Reads and validates both slots of `flash`; none is active yet.
    pub async fn open(flash: F) -> Self {
        let mut store = Self::unread(flash);
        store.scan_once().await;
        store
    }

    /// The slots of `flash`, before [`SlotStore::scan_once`] has read anything; none is active.
    pub const fn unread(flash: F) -> Self {
        const { Self::FITS };
        Self {
            flash,
            states: [SlotState::Empty, SlotState::Empty],
            outlines: [None; 2],
            active: None,
            workspace: Workspace::new(),
            highest: None,
            is_scanned: false,
        }
    }

    /// Reads and validates both slots, unless that was done before.
    pub async fn scan_once(&mut self) {
        if self.is_scanned {
            return;
        }
        for slot in SlotId::ALL {
            self.scan(slot).await;
        }
        self.is_scanned = true;
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.flash
    }

    /// Contents of both slots, and the active one.
    pub fn slots(&self) -> Slots {
        Slots {
            slots: self.states.clone(),
            active: self.active,
        }
    }

    /// Content of `slot`.
    pub fn state(&self, slot: SlotId) -> &SlotState {
        &self.states[slot.index()]
    }

    /// The library in `slot`, if there is a valid one.
    pub fn library(&self, slot: SlotId) -> Option<SlotInfo> {
        match self.states[slot.index()] {
            SlotState::Valid(info) => Some(info),
            _ => None,
        }
    }

    /// The slot with the library that was uploaded last.
    pub fn newest(&self) -> Option<SlotId> {
        match SlotId::ALL.map(|slot| self.library(slot)) {
            [Some(first), Some(second)] if is_newer(first.sequence, second.sequence) => Some(SlotId::A),
            [_, Some(_)] => Some(SlotId::B),
            [Some(_), None] => Some(SlotId::A),
            [None, None] => None,
        }
    }

    /// The active slot: the one whose library is in RAM.
    pub fn active(&self) -> Option<SlotId> {
        self.active
    }

    /// Sets the active slot. An upload goes to the other slot.
    pub fn set_active(&mut self, slot: Option<SlotId>) {
        self.active = slot;
    }

    /// The slot that an upload tries to claim: the slot that is not active, or the slot that is worth less while none
    /// is active.
    pub fn spare(&self) -> SlotId {
        self.active.map_or_else(|| self.lesser(), SlotId::other)
    }

    /// Texture `index` of `slot`, after reading each word of the library again.
    ///
    /// # Errors
    /// The slot has no library, or has a fault, or the library has fewer textures.
    pub async fn texture(&mut self, slot: SlotId, index: u8) -> Result<TextureInfo, ListError> {
        let library = self.listed(slot).await?;
        let found = library.texture_at(usize::from(index));
        found.map(|texture| texture_info(&texture)).ok_or(ListError::Index {
            slot,
            index,
            textures: library.len() as u16,
        })
    }

    /// Scene `index` of `slot`, after reading each word of the library again.
    ///
    /// # Errors
    /// The slot has no library, or has a fault, or the library has fewer scenes.
    pub async fn scene(&mut self, slot: SlotId, index: u8) -> Result<SceneInfo, ListError> {
        let library = self.listed(slot).await?;
        let found = library.scene_at(usize::from(index));
        found.map(|scene| scene_info(&scene)).ok_or(ListError::SceneIndex {
            slot,
            index,
            scenes: library.scene_count() as u8,
        })
    }

    /// Returns the library in `slot`, after reading its bytes again. They are not decoded again: their checksum shows
    /// that they have not changed.
    async fn listed(&mut self, slot: SlotId) -> Result<Library<'_>, ListError> {
        match &self.states[slot.index()] {
            SlotState::Valid(_) => {}
            SlotState::Faulty(fault) => {
                let fault = fault.clone();
                return Err(ListError::Faulty { slot, fault });
            }
            SlotState::Empty | SlotState::Receiving => return Err(ListError::NoLibrary { slot }),
        }
        let outline = self.outlines[slot.index()];
        let bytes = self.library_bytes(slot).await;
        let bytes = bytes.map_err(|fault| ListError::Faulty { slot, fault })?;
        outline
            .and_then(|outline| outline.library(bytes))
            .ok_or(ListError::NoLibrary { slot })
    }

    /// The bytes of the library in `slot`, after reading each word again and comparing the checksum.
    ///
    /// # Errors
    /// The slot has no library, or has a fault, and counts as faulty from then on.
    pub async fn library_bytes(&mut self, slot: SlotId) -> Result<&[u8], SlotFault> {
        let Some(info) = self.library(slot) else {
            return Err(SlotFault::Unfinished);
        };
        if let Err(fault) = self.check_bytes(slot, info.length, info.crc32).await {
            self.set_state(slot, SlotState::Faulty(fault.clone()));
            return Err(fault);
        }
        mapped(&self.flash, slot, info.length)
    }

    /// Notes that `slot` is being overwritten.
    pub(crate) fn set_receiving(&mut self, slot: SlotId) {
        self.set_state(slot, SlotState::Receiving);
    }

    /// Notes that an upload to `slot` has ended unfinished.
    pub(crate) fn set_unfinished(&mut self, slot: SlotId) {
        self.set_state(slot, SlotState::Faulty(SlotFault::Unfinished));
    }

    fn set_state(&mut self, slot: SlotId, state: SlotState) {
        self.states[slot.index()] = state;
        self.outlines[slot.index()] = None;
    }

    /// Notes that `slot` holds the library of `header` with this content.
    fn set_valid(&mut self, slot: SlotId, header: Header, content: Content) -> SlotInfo {
        let info = SlotInfo {
            sequence: header.sequence,
            length: header.length,
            crc32: header.crc32,
            textures: content.textures,
            scenes: content.scenes,
        };
        self.states[slot.index()] = SlotState::Valid(info);
        self.outlines[slot.index()] = Some(content.outline);
        info
    }

    /// Erases the sector of the claimed slot that holds `offset`.
    pub(crate) async fn erase_sector(&mut self, claim: &Claim, offset: u32) -> Result<(), WriteFault> {
        let slot = claim.slot();
        let length = F::ERASE_SIZE as u32;
        let from = offset / length * length;
        let at = address(slot, from);
        self.flash
            .erase(at, at + length)
            .await
            .map_err(|_| flash_fault(slot, FlashOperation::Erase, from))
    }

    /// Offset of the sector with a slot's header.
    pub(crate) const fn header_sector() -> u32 {
        (SLOT_BYTES - F::ERASE_SIZE) as u32
    }

    /// Length of a sector, bytes.
    pub(crate) const fn sector_bytes() -> u32 {
        F::ERASE_SIZE as u32
    }

    /// Programs one word at `offset` of the claimed slot, without reading it back.
    pub(crate) async fn program(
        &mut self,
        claim: &Claim,
        offset: u32,
        word: &[u8; WORD_BYTES],
    ) -> Result<(), WriteFault> {
        let slot = claim.slot();
        let written = self.flash.write(address(slot, offset), word).await;
        written.map_err(|_| flash_fault(slot, FlashOperation::Write, offset))
    }

    /// Programs `bytes` at `offset` of the claimed slot word by word, the last word padded with ones, and reads each
    /// word back.
    pub(crate) async fn write(&mut self, claim: &Claim, offset: u32, bytes: &[u8]) -> Result<(), WriteFault> {
        let slot = claim.slot();
        for (index, piece) in bytes.chunks(WORD_BYTES).enumerate() {
            let mut word = [0xff; WORD_BYTES];
            word[..piece.len()].copy_from_slice(piece);
            let offset = offset + (index * WORD_BYTES) as u32;
            let at = address(slot, offset);
            self.flash
                .write(at, &word)
                .await
                .map_err(|_| flash_fault(slot, FlashOperation::Write, offset))?;
            let back = self.word(slot, offset).await;
            let back = back.ok_or(flash_fault(slot, FlashOperation::Read, offset))?;
            if back != word {
                return Err(WriteFault::ReadBack { slot, offset });
            }
        }
        Ok(())
    }

    /// Validates `length` bytes in the claimed slot, reading each once, and makes them a library by writing its header.
    /// Ends the claim, because from then on the slot may hold the last library.
    pub(crate) async fn seal(&mut self, claim: Claim, length: u32, crc32: u32) -> Result<SlotInfo, SealFault> {
        let slot = claim.slot();
        self.check_bytes(slot, length, crc32).await.map_err(SealFault::Bytes)?;
        let content = self.check_library(slot, length).await;
        let content = content.map_err(SealFault::Bytes)?;
        let header = Header {
            // Above every header that was seen, because a library that cannot be read now may be readable later.
            sequence: self.highest.unwrap_or(0).wrapping_add(1),
            length,
            crc32,
        };
        if let Err(fault) = self.write(&claim, HEADER_OFFSET, &header.word()).await {
            // A header that reads wrongly now must not read right at a later start, because the host is told that its
            // library was not stored.
            let _ = self.erase_sector(&claim, Self::header_sector()).await;
            return Err(SealFault::Write(fault));
        }
        self.note_header(header);
        let info = self.set_valid(slot, header, content);
        let copies = self.copies(slot).await;
        self.renew(slot, header, &copies).await;
        Ok(info)
    }

    /// Reads and validates `slot`, and adds a copy of its header if a later start could read it differently.
    pub(crate) async fn scan(&mut self, slot: SlotId) {
        let copies = self.copies(slot).await;
        if let Some(header) = copies.header() {
            // Also of a library that cannot be read now, because an upload must have a higher number.
            self.note_header(header);
        }
        match self.read_slot(slot, &copies).await {
            Ok(Some((header, content))) => {
                self.set_valid(slot, header, content);
                self.renew(slot, header, &copies).await;
            }
            Ok(None) => self.set_state(slot, SlotState::Empty),
            Err(fault) => self.set_state(slot, SlotState::Faulty(fault)),
        }
    }

    /// Header and content of the library in `slot`, whose header's words are `copies`; none if the slot is empty.
    async fn read_slot(&mut self, slot: SlotId, copies: &Copies) -> Result<Option<(Header, Content)>, SlotFault> {
        let word = copies.word.ok_or(SlotFault::Unreadable { offset: HEADER_OFFSET })?;
        let header = match word {
            HeaderWord::Header(header) => header,
            HeaderWord::Blank if self.is_blank(slot).await? => return Ok(None),
            HeaderWord::Blank | HeaderWord::Damaged => return Err(SlotFault::Unfinished),
            HeaderWord::Version(found) => return Err(SlotFault::HeaderVersion { found }),
        };
        let Header { length, crc32, .. } = header;
        if length == 0 || length as usize > MAX_LIBRARY_BYTES {
            return Err(SlotFault::Length { length });
        }
        self.check_bytes(slot, length, crc32).await?;
        let content = self.check_library(slot, length).await?;
        Ok(Some((header, content)))
    }

    /// Returns true if a slot without a header is empty. An upload that has written anything has written the first
    /// word.
    async fn is_blank(&mut self, slot: SlotId) -> Result<bool, SlotFault> {
        let word = self.word(slot, 0).await.ok_or(SlotFault::Unreadable { offset: 0 })?;
        Ok(word == [0xff; WORD_BYTES])
    }

    /// Reads every word of the first `length` bytes of `slot` and compares their checksum.
    async fn check_bytes(&mut self, slot: SlotId, length: u32, expected: u32) -> Result<(), SlotFault> {
        self.compare_bytes(slot, length, expected, 1).await
    }

    /// Reads every word of the first `length` bytes of `slot` as many times as `reads`, which must all find the same,
    /// and compares the checksum of the bytes.
    async fn compare_bytes(&mut self, slot: SlotId, length: u32, expected: u32, reads: usize) -> Result<(), SlotFault> {
        let mut digest = LIBRARY_CRC.digest();
        let take = |bytes: &[u8]| digest.update(bytes);
        self.read_bytes(slot, length, reads, take).await?;
        let found = digest.finalize();
        if found == expected {
            Ok(())
        } else {
            Err(SlotFault::Checksum { expected, found })
        }
    }

    /// Passes the first `length` bytes of `slot` to `take` word by word. Reads each word as many times as `reads`; all
    /// reads must find the same.
    pub(crate) async fn read_bytes(
        &mut self,
        slot: SlotId,
        length: u32,
        reads: usize,
        mut take: impl FnMut(&[u8]),
    ) -> Result<(), SlotFault> {
        for offset in (0..length).step_by(WORD_BYTES) {
            let word = self
                .repeated_word(slot, offset, reads)
                .await
                .ok_or(SlotFault::Unreadable { offset })?;
            let left = (length - offset) as usize;
            take(&word[..left.min(WORD_BYTES)]);
            // A word that is read many times counts as many; a power of two divides the stride into whole words.
            if (offset as usize).is_multiple_of(STRIDE_BYTES / reads.next_power_of_two()) {
                yield_now().await;
            }
        }
        Ok(())
    }

    /// Decodes the library in the first `length` bytes of `slot`, each word of which has been read. Other tasks have
    /// their turn after each step.
    async fn check_library(&mut self, slot: SlotId, length: u32) -> Result<Content, SlotFault> {
        let bytes = mapped(&self.flash, slot, length)?;
        let mut decoder = Decoder::within(bytes, &mut self.workspace);
        loop {
            let decoded = decoder.step().map_err(|error| {
                let reason = in_words(&error);
                SlotFault::Invalid { reason }
            })?;
            if let Some(library) = decoded {
                return Ok(Content {
                    outline: library.outline(bytes),
                    textures: library.len() as u16,
                    scenes: library.scene_count() as u8,
                });
            }
            yield_now().await;
        }
    }

    /// The word at `offset` of `slot`; none unless as many as `reads` reads find the same word.
    async fn repeated_word(&mut self, slot: SlotId, offset: u32, reads: usize) -> Option<[u8; WORD_BYTES]> {
        let word = self.word(slot, offset).await?;
        for _ in 1..reads {
            if self.word(slot, offset).await? != word {
                return None;
            }
        }
        Some(word)
    }

    /// The word at `offset` of `slot`; none if it cannot be read.
    pub(crate) async fn word(&mut self, slot: SlotId, offset: u32) -> Option<[u8; WORD_BYTES]> {
        let mut word = [0; WORD_BYTES];
        let at = address(slot, offset);
        self.flash.read(at, &mut word).await.ok()?;
        Some(word)
    }
}

/// The content of a library that was decoded.
#[derive(Clone, Copy)]
struct Content {
    outline: Outline,
    textures: u16,
    scenes: u8,
}

/// Reason why bytes did not become a library.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum SealFault {
    /// They are not those of the checksum, or not a valid library.
    Bytes(SlotFault),
    /// The header could not be written.
    Write(WriteFault),
}

fn address(slot: SlotId, offset: u32) -> u32 {
    (slot.index() * SLOT_BYTES) as u32 + offset
}

/// The first `length` bytes of `slot`, each word of which has been read.
fn mapped<F: MappedFlash>(flash: &F, slot: SlotId, length: u32) -> Result<&[u8], SlotFault> {
    let from = address(slot, 0);
    let bytes = flash.bytes(from..from + length);
    bytes.map_err(|_| SlotFault::Unreadable { offset: 0 })
}

fn flash_fault(slot: SlotId, operation: FlashOperation, offset: u32) -> WriteFault {
    WriteFault::Flash(FlashFault {
        slot,
        operation,
        offset,
    })
}

fn texture_info(texture: &Texture<'_>) -> TextureInfo {
    let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
    let [silent, interpolated, extrapolated, doubtful] = texture.count_flags([
        NodeFlags::SILENT,
        NodeFlags::INTERPOLATED,
        NodeFlags::EXTRAPOLATED,
        NodeFlags::DOUBTFUL,
    ]);
    TextureInfo {
        // A valid name fits.
        name: texture.name().try_into().unwrap_or_default(),
        provenance: texture.provenance(),
        sample_rate_hz: texture.sample_rate_hz(),
        max_order: texture.max_order() as u16,
        speeds: speeds.len() as u8,
        forces: forces.len() as u8,
        speed_range: [texture.speed(0), texture.speed(speeds.len() - 1)],
        force_range: [texture.force(0), texture.force(forces.len() - 1)],
        silent_nodes: silent,
        filled_nodes: interpolated + extrapolated,
        doubtful_nodes: doubtful,
    }
}

fn scene_info(scene: &Scene) -> SceneInfo {
    let count = |has: fn(&Surface) -> bool| {
        let surfaces = scene.surfaces.iter();
        surfaces.filter(|surface| has(surface)).count() as u8
    };
    SceneInfo {
        name: scene.name.clone(),
        surfaces: scene.surfaces.len() as u8,
        regions: scene.regions.len() as u8,
        taps: count(|surface| surface.tap.is_some()),
        stick_slips: count(|surface| surface.stick_slip.is_some()),
        sections: scene.equaliser.len() as u8,
        constant_motion: matches!(scene.motion, MotionOfScene::Constant { .. }),
    }
}
