//! Memory that was freed, and is soon needed again.

/// A block of this size, once freed, makes glibc keep as much; bytes.
const KEPT: usize = 4 << 20;

/// Makes the allocator keep what is freed instead of giving it back at once.
///
/// glibc gives memory back when 128 KB are free at its end, and takes blocks of that size from the kernel one by one.
/// The work on a recording needs some megabytes of such blocks, and frees them before the next recording: each page
/// would be given back and taken again for every recording. glibc raises its bounds to the size of the largest block
/// that it has freed, up to 32 MB (`M_MMAP_THRESHOLD` in mallopt(3)). Other allocators do nothing here.
pub fn keep() {
    drop(std::hint::black_box(Vec::<u8>::with_capacity(KEPT)));
}
