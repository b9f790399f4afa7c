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

/// The memory and what is in it.
pub struct LibraryRam {
    library: Option<Library<'static>>,
}

impl LibraryRam {
    /// Empty.
    ///
    /// # Safety
    /// Called once: this owns the AXI SRAM, in which the linker puts nothing.
    pub const unsafe fn new() -> Self {
        Self { library: None }
    }

    /// Copies `bytes` and decodes them.
    ///
    /// # Errors
    /// Too many bytes, or what was copied is no library; there is none then.
    ///
    /// # Safety
    /// Nothing of what [`LibraryRam::library`] gave is used any longer.
    pub unsafe fn load(&mut self, bytes: &[u8]) -> Result<(), LoadFault> {
        self.library = None;
        if bytes.len() > MAX_LIBRARY_BYTES {
            return Err(LoadFault);
        }
        // SAFETY: `memory.x` gives it 512 KB, which `tests/memory_map.rs` holds against MAX_LIBRARY_BYTES; the library before
        // is gone and its textures are not used, by the caller's word. It is written before it is read.
        let memory: &'static mut [u8] = unsafe {
            let start = addr_of_mut!(_axisram_start);
            start.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
            slice::from_raw_parts_mut(start, bytes.len())
        };
        let library = Library::decode(memory).map_err(|_| LoadFault)?;
        self.library = Some(library);
        Ok(())
    }

    /// The library.
    pub fn library(&self) -> Option<Library<'static>> {
        self.library
    }
}
