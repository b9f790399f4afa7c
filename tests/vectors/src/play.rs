//! Playback of a texture along the path of the hand.

use model_format::scene::Surface;
use model_format::{DecodeError, Library, OutputSample};
use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::scene::{Interaction, Plan, ScenePlayer};
use stylus_kernel::{Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::scenes::side_by_side;
use crate::textures::{Vector, motion};

/// The reason why a texture cannot be played.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlayError {
    /// The bytes are not a library.
    #[error("the test library: {0}")]
    Library(#[from] DecodeError),
    /// The library has no texture of this name.
    #[error("the test library has no texture of the name asked for")]
    NoTexture,
}

/// Plays `vector` of `library` into `sink` along [`motion`]. Returns the number of samples at full scale.
pub fn run<M: Arithmetic>(library: &[u8], vector: &Vector, sink: impl FnMut(OutputSample)) -> Result<u32, PlayError> {
    let library = Library::decode(library)?;
    match vector.beside {
        None => run_one::<M>(&library, vector, sink),
        Some(textures) => run_beside::<M>(&library, textures, vector, sink),
    }
}

fn run_one<M: Arithmetic>(
    library: &Library<'_>,
    vector: &Vector,
    mut sink: impl FnMut(OutputSample),
) -> Result<u32, PlayError> {
    let texture = library.texture(vector.texture);
    let mut synthesis = Synthesis::<M>::new(texture.ok_or(PlayError::NoTexture)?, vector.seed);
    for n in 0..vector.samples {
        if n.is_multiple_of(UPDATE_INTERVAL_SAMPLES) {
            synthesis.follow(motion(n / UPDATE_INTERVAL_SAMPLES), UPDATE_INTERVAL_SAMPLES);
        }
        sink(synthesis.next_sample());
    }
    Ok(synthesis.saturations())
}

/// Plays `textures` side by side, while the tool moves back and forth over the transition between them.
fn run_beside<M: Arithmetic>(
    library: &Library<'_>,
    textures: [&str; 2],
    vector: &Vector,
    mut sink: impl FnMut(OutputSample),
) -> Result<u32, PlayError> {
    /// Width of the transition, and distance from its middle to each turning point, mm.
    const TRANSITION_MM: f32 = 64.0;
    const WAY_MM: u32 = 48;
    let surface = |name: &str| {
        let index = library
            .textures()
            .position(|one| one.name() == name)
            .ok_or(PlayError::NoTexture)?;
        Ok::<_, PlayError>(Surface::of_texture(index as u8))
    };
    let surfaces = [surface(textures[0])?, surface(textures[1])?];
    let scene = side_by_side("beside", surfaces, [-1000.0, 0.0, 1000.0], TRANSITION_MM);
    let plan = Plan::new(&scene, library).map_err(|_| PlayError::NoTexture)?;
    let mut player = ScenePlayer::<M>::new(plan, vector.seed);
    for n in 0..vector.samples {
        if n.is_multiple_of(UPDATE_INTERVAL_SAMPLES) {
            let update = n / UPDATE_INTERVAL_SAMPLES;
            // A triangle wave with 1 mm per update, which begins at the right turning point.
            let place = (update % (4 * WAY_MM)).abs_diff(2 * WAY_MM) as f32 - WAY_MM as f32;
            let interaction = Interaction::new(motion(update), place, true).expect("the place is finite");
            player.follow(interaction, UPDATE_INTERVAL_SAMPLES);
        }
        sink(player.next_sample());
    }
    Ok(player.saturations())
}
