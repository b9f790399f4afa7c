//! A part to be written.

/// Kind and content of a part to be written.
pub(crate) type PartSpec = (u32, alloc::vec::Vec<u8>);
