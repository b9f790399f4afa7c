//! The job that the emulator writes into memory.
#![expect(unsafe_code, reason = "what another wrote into memory is read through a pointer")]

use kernel_vectors::job::{self, ADDRESS, CAPACITY, Job};

/// The job, if there is one.
pub fn read() -> Option<Job<'static>> {
    let start = core::ptr::with_exposed_provenance(ADDRESS as usize);
    // SAFETY: the bytes from ADDRESS on are RAM of both boards. `memory.x` keeps this RAM from the linker, so no
    // static, no stack and no other reference lies there. The emulator has written the bytes before reset, or they are
    // zero, and nothing writes them afterwards. Any bytes are valid.
    let memory = unsafe { core::slice::from_raw_parts(start, CAPACITY) };
    job::read(memory)
}
