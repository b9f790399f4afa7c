//! The library that is played, in AXI SRAM.
#![expect(unsafe_code, reason = "a memory that the linker reserves is one array")]

use core::ptr::addr_of_mut;
use core::slice;

use model_format::limits::MAX_LIBRARY_BYTES;
use model_format::{Decoder, Library};
use static_cell::StaticCell;
use stylus_app::control::LoadFault;

unsafe extern "C" {
    static mut _axisram_start: u8;
    static _axisram_end: u8;
}

/// Bytes that one step copies.
const COPY_BYTES: usize = 8 * 1024;

/// The content. It lies in SRAM 4 because it takes some kilobytes, which the tick does not touch.
#[unsafe(link_section = ".sram4.library")]
static CONTENT: StaticCell<Content> = StaticCell::new();

/// The memory, and the library in it.
pub struct LibraryRam {
    content: &'static mut Content,
}

/// Content of the memory.
#[expect(
    clippy::large_enum_variant,
    reason = "there is one, and it is reserved for the largest"
)]
enum Content {
    /// Nothing usable.
    Nothing,
    /// A library in part: the number of bytes that have been copied.
    Copied(usize),
    /// All bytes of a library, which are being decoded.
    Decoding(Decoder<'static>),
    /// A library.
    Library(Library<'static>),
}

impl LibraryRam {
    /// Memory without a library.
    ///
    /// # Safety
    /// Called once, because the value owns the AXI SRAM, in which the linker puts nothing.
    pub unsafe fn new() -> Self {
        Self {
            content: CONTENT.init(Content::Nothing),
        }
    }

    /// Forgets the library, so that [`LibraryRam::load`] can begin.
    ///
    /// # Safety
    /// No library, texture or scene that [`LibraryRam::library`] returned is used any longer.
    pub unsafe fn begin(&mut self) {
        *self.content = Content::Copied(0);
    }

    /// Copies the next part of `bytes`, or decodes the next part of the copy. Every call must get the same `bytes`.
    /// Returns true after the last step; only then is there a library.
    ///
    /// # Errors
    /// There are too many bytes, or they are not a library, or nothing was begun. Then the memory has no library.
    pub fn load(&mut self, bytes: &[u8]) -> Result<bool, LoadFault> {
        let stepped = match self.content {
            Content::Copied(at) => copy(bytes, *at).map(Some),
            // Decoded in place, because a decoder takes some kilobytes.
            Content::Decoding(decoder) => match decoder.step() {
                Ok(library) => Ok(library.map(Content::Library)),
                Err(_) => Err(LoadFault),
            },
            Content::Nothing | Content::Library(_) => Err(LoadFault),
        };
        match stepped {
            Ok(None) => {}
            Ok(Some(next)) => *self.content = next,
            Err(fault) => {
                *self.content = Content::Nothing;
                return Err(fault);
            }
        }
        Ok(matches!(self.content, Content::Library(_)))
    }

    /// The library, if there is one.
    pub fn library(&self) -> Option<Library<'static>> {
        match *self.content {
            Content::Library(library) => Some(library),
            _ => None,
        }
    }
}

/// Copies the next part of `bytes`, from offset `at`, to RAM. Only [`LibraryRam::load`], which owns that memory, calls
/// this.
fn copy(bytes: &[u8], at: usize) -> Result<Content, LoadFault> {
    if bytes.len() > MAX_LIBRARY_BYTES || at > bytes.len() {
        return Err(LoadFault);
    }
    let start = addr_of_mut!(_axisram_start);
    let end = bytes.len().min(at + COPY_BYTES);
    let piece = &bytes[at..end];
    // SAFETY: `memory.x` gives the memory 512 KB, which `tests/memory_map.rs` compares with MAX_LIBRARY_BYTES, and the
    // copied part ends within that. By the contract of `begin` nothing of the previous library is used, and nothing of
    // this one is used before its last byte was copied.
    unsafe {
        start.add(at).copy_from_nonoverlapping(piece.as_ptr(), piece.len());
    }
    if end < bytes.len() {
        return Ok(Content::Copied(end));
    }
    // SAFETY: as above. All these bytes have been written, and they change only after the next `begin`.
    let memory: &'static [u8] = unsafe { slice::from_raw_parts(start, bytes.len()) };
    Ok(Content::Decoding(Decoder::new(memory)))
}
