//! The `stylus` command: it turns recordings of a surface into a library of texture models, and the library into the
//! samples that the stylus plays.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    // First of all, so that the blocks of every recording that is read later are reused.
    keep_freed_memory();
    cli::run()
}

/// Size of a block, bytes. Once a block of this size is freed, glibc keeps up to twice as much free memory. Two seconds
/// of three axes at 48 kHz take 2.3 MB, and some copies of them exist while they are converted.
const KEPT: usize = 16 << 20;

/// Makes the allocator keep freed memory instead of returning it to the system at once.
///
/// By default, glibc returns memory when 128 KB are free at the end of the heap, and requests each block of at least
/// that size directly from the kernel. The work on a recording needs several megabytes of such blocks and frees them
/// before the next recording, so each page would be returned and requested again for every recording. glibc raises the
/// second threshold to the size of the largest such block that it has freed, up to 32 MB, and the first to twice that
/// size (`M_MMAP_THRESHOLD` in mallopt(3)). With other allocators, this function has no effect.
fn keep_freed_memory() {
    drop(std::hint::black_box(Vec::<u8>::with_capacity(KEPT)));
}
