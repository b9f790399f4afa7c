//! The library that is played, in AXI SRAM.
#![expect(unsafe_code, reason = "a memory that the linker reserves is one array")]

use core::ptr::addr_of_mut;
use core::slice;

use model_format::Library;
use model_format::limits::MAX_LIBRARY_BYTES;
use stylus_app::storage::LoadFault;

unsafe extern "C" {
    static mut _axisram_start: u8;
    static _axisram_end: u8;
}

/// The memory, and the library in it.
pub struct LibraryRam {
    library: Option<Library<'static>>,
}

impl LibraryRam {
    /// Memory without a library.
    ///
    /// # Safety
    /// Called once, because this owns the AXI SRAM, in which the linker puts nothing.
    pub const unsafe fn new() -> Self {
        Self { library: None }
    }

    /// Copies `bytes` and decodes them.
    ///
    /// # Errors
    /// There are too many bytes, or they are not a library; the memory has none then.
    ///
    /// # Safety
    /// No library, texture or scene that [`LibraryRam::library`] returned is used any longer.
    pub unsafe fn load(&mut self, bytes: &[u8]) -> Result<(), LoadFault> {
        self.library = None;
        if bytes.len() > MAX_LIBRARY_BYTES {
            return Err(LoadFault);
        }
        // SAFETY: `memory.x` gives it 512 KB, which `tests/memory_map.rs` compares with MAX_LIBRARY_BYTES. By the
        // caller's contract nothing of the library before is used. The bytes are written before they are read.
        let memory: &'static mut [u8] = unsafe {
            let start = addr_of_mut!(_axisram_start);
            start.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
            slice::from_raw_parts_mut(start, bytes.len())
        };
        let library = Library::decode(memory).map_err(|_| LoadFault)?;
        self.library = Some(library);
        Ok(())
    }

    /// The library, if there is one.
    pub fn library(&self) -> Option<Library<'static>> {
        self.library
    }
}
