//! The kernel in forty lines, on any target: reads the bytes of a library and writes samples. `play` allocates nothing
//! and needs no operating system, so a firmware can use it unchanged.
//!
//!     cargo run --locked -p stylus-kernel --example forty_lines -- demo-out/textures.lib

use model_format::{DecodeError, Library, MillimetresPerSecond, Newton, OutputSample};
use stylus_kernel::{Motion, MotionError, Synthesis, UPDATE_INTERVAL_SAMPLES};

/// Plays the first texture of `library` into `output`, at the texture's sample rate, in steps of 2⁻²⁰ m/s². `motion`
/// returns the tool's motion at a sample; it is called once per update interval of ten samples.
pub fn play(library: &[u8], motion: impl Fn(usize) -> Motion, output: &mut [OutputSample]) -> Result<(), DecodeError> {
    let library = Library::decode(library)?;
    let Some(texture) = library.texture_at(0) else {
        return Ok(());
    };
    let mut synthesis: Synthesis = Synthesis::new(texture, 1);
    let interval = UPDATE_INTERVAL_SAMPLES as usize;
    for (block, samples) in output.chunks_mut(interval).enumerate() {
        synthesis.follow(motion(block * interval), samples.len() as u32);
        synthesis.next_block(samples);
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("give a library")?;
    let motion =
        Motion::new(MillimetresPerSecond(120.0), Newton(1.0)).map_err(|error: MotionError| error.to_string())?;
    let mut samples = vec![OutputSample::SILENCE; 5000];
    play(&std::fs::read(path)?, |_| motion, &mut samples)?;
    for sample in samples {
        println!("{}", sample.metres_per_second_squared().0);
    }
    Ok(())
}
