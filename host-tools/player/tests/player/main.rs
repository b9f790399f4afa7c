//! A player compared with `stylus render`, and its behaviour when something changes.

mod changes;
mod safety;
mod same_bits;
mod timing;

use std::sync::LazyLock;

use kernel_vectors::scenes::with_all_effects;
use kernel_vectors::specs;
use model_format::{TextureSpec, encode_with_scenes};
use stylus_player::{Filler, Mover, Selection, SharedLibrary, Without, player, player_as_rendered};

/// The textures that every processor must play to the same bits, and a scene with all effects, at each rate.
static LIBRARIES: LazyLock<[SharedLibrary; 2]> =
    LazyLock::new(|| [5000, 10_000].map(|rate_hz| library(&specs(), rate_hz)));

/// A library of `specs`, as textures of `rate_hz`, with a scene of its first two.
fn library(specs: &[TextureSpec], rate_hz: u32) -> SharedLibrary {
    let textures: Vec<TextureSpec> = specs.to_vec();
    let textures: Vec<TextureSpec> = textures
        .into_iter()
        .map(|spec| TextureSpec {
            sample_rate_hz: rate_hz,
            ..spec
        })
        .collect();
    let bytes = encode_with_scenes(&textures, &[with_all_effects(rate_hz)]).expect("within the limits");
    SharedLibrary::decode(bytes).expect("it is valid")
}

/// A player at `output_rate_hz` of the texture `index` of a library.
fn playing(library: &SharedLibrary, index: usize, output_rate_hz: u32) -> (Mover, Filler) {
    let (mover, filler) = player(output_rate_hz).expect("the rate is played");
    choose(&mover, library, index);
    (mover, filler)
}

/// The same without the DC blocker.
fn playing_as_rendered(library: &SharedLibrary, index: usize, output_rate_hz: u32) -> (Mover, Filler) {
    let (mover, filler) = player_as_rendered(output_rate_hz).expect("the rate is played");
    choose(&mover, library, index);
    (mover, filler)
}

fn choose(mover: &Mover, library: &SharedLibrary, index: usize) {
    let selection = Selection::Texture(index);
    mover
        .choose(library, selection, Without::default(), 5)
        .expect("it is there");
}

/// Returns the samples of `blocks` blocks of 2 ms. The motion is sent before each.
fn rubbed(mover: &Mover, filler: &mut Filler, blocks: usize, motion: (f64, f64)) -> Vec<f32> {
    let mut samples = vec![0.0; blocks * filler.output_rate_hz() as usize / 500];
    for block in samples.chunks_mut(filler.output_rate_hz() as usize / 500) {
        mover.rub(motion.0, motion.1).expect("it is finite");
        filler.fill(block);
    }
    samples
}

/// The largest difference of neighbouring samples.
fn largest_step(samples: &[f32]) -> f32 {
    samples
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .fold(0.0, f32::max)
}
