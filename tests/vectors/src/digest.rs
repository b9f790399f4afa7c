//! The library of which every platform must have one digest: host, emulated processors, emulated board and browser.

use alloc::vec::Vec;

use crate::library::digest_spec;

/// Digest of the words that the texture of [`digest_library`] plays along the fixed stroke; see
/// [`stylus_kernel::digest`].
pub const DIGESTED: u32 = 0xf6ad_99d6;

/// The bytes of a library of one texture, with codebooks, a level track and lines.
///
/// # Panics
/// Never, unless this crate is wrong: the texture that it encodes is valid.
pub fn digest_library() -> Vec<u8> {
    model_format::encode(&[digest_spec()]).expect("the texture is valid")
}
