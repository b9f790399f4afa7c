//! Playback of a texture along the path.

use model_format::{DecodeError, Library, OutputSample};
use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::{Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::path::motion;

/// A texture that cannot be played.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlayError {
    /// The bytes are not a library.
    #[error("the test library: {0}")]
    Library(#[from] DecodeError),
    /// The library has no texture of this name.
    #[error("the test library has no texture of the name asked for")]
    NoTexture,
}

/// Plays `samples` samples of a texture of `library` into `sink` along [`motion`]; returns the number at full scale.
///
/// # Errors
/// Bytes that are no library, or one without the texture.
pub fn run<M: Arithmetic>(
    library: &[u8],
    texture: &str,
    seed: u64,
    samples: u32,
    mut sink: impl FnMut(OutputSample),
) -> Result<u32, PlayError> {
    let texture = Library::decode_uncertified(library)?
        .texture(texture)
        .ok_or(PlayError::NoTexture)?;
    let mut synthesis = Synthesis::<M>::new(texture, seed);
    for n in 0..samples {
        if n.is_multiple_of(UPDATE_INTERVAL_SAMPLES) {
            synthesis.follow(motion(n / UPDATE_INTERVAL_SAMPLES), UPDATE_INTERVAL_SAMPLES);
        }
        sink(synthesis.next_sample());
    }
    Ok(synthesis.saturations())
}
