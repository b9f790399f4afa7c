//! The kernel on an emulated Cortex-M: plays the test vectors, prints every sample, and counts instructions. If the
//! emulator has put a job into memory, the image does that job instead; see [`kernel_vectors::job`].
//!
//! All output goes to the host by semihosting, in the lines of [`kernel_vectors::report`]. Every failure is printed and
//! ends the emulator with a code other than zero, so a failure never hangs.
#![no_std]
#![no_main]

mod counts;
mod failure;
mod job;
mod output;

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hio};
use kernel_vectors::job::Job;
use kernel_vectors::{
    COST_BUDGETS, COUNTED_UPDATES, CostBudget, PATH_UPDATES, VECTORS, counted_motion, edges, motion, report, run,
};
use model_format::{Library, OutputSample, Texture};
use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::digest::of_plan;
use stylus_kernel::scene::Plan;
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};
use stylus_realtime::CortexM;

use crate::counts::{Counter, Range};
use crate::output::{Output, Words};

/// The library of test textures that `build.rs` writes.
static LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/library.bin"));

#[entry]
fn main() -> ! {
    let mut output = Output::new(hio::hstdout().expect("the emulator opens its output"));
    let peripherals = cortex_m::Peripherals::take().expect("nobody else takes them");
    let counter = Counter::new(peripherals.SYST);
    match job::read() {
        Some(Job::Count { library }) => {
            let library = Library::decode(library).expect("the host wrote a library");
            let textures = library.textures();
            measure(textures, COUNTED_UPDATES, counted_motion, &counter, &mut output);
        }
        Some(Job::Hard { cases }) => counts::hard_cases(cases, &counter, &mut output),
        Some(Job::Bounds { libraries }) => counts::bounds(libraries, &counter, &mut output),
        Some(Job::Digest { library }) => digest(library, &mut output),
        None => {
            play::<Portable>(report::PORTABLE, &mut output);
            play::<CortexM>(report::CORTEX_M, &mut output);
            let library = Library::decode(LIBRARY).expect("the library is valid");
            let texture = |measured: &CostBudget| library.texture(measured.texture);
            let textures = COST_BUDGETS
                .iter()
                .map(|measured| texture(measured).expect("it is there"));
            measure(textures, PATH_UPDATES, motion, &counter, &mut output);
        }
    }
    output.line(format_args!("{}", report::END));
    loop {
        debug::exit(debug::EXIT_SUCCESS);
    }
}

/// Prints the samples that the kernel plays with the arithmetic `M`, called `name`.
fn play<M: Arithmetic>(name: &str, output: &mut Output) {
    for vector in &VECTORS {
        output.line(format_args!("{} {name} {}", report::VECTOR, vector.texture));
        let mut words = Words::new(output);
        let sink = |sample: OutputSample| words.push(sample.0.cast_unsigned());
        let played = run::<M>(LIBRARY, vector, sink);
        words.finish();
        let full_scale = played.expect("the library holds every vector");
        output.line(format_args!("{} {full_scale}", report::FULL_SCALE));
    }
    output.line(format_args!("{} {name}", report::EDGES));
    let mut words = Words::new(output);
    edges::<M>(|word| words.push(word));
    words.finish();
}

/// Prints the digest of the first texture of `library` with each arithmetic.
fn digest(library: &[u8], output: &mut Output) {
    fn played<M: Arithmetic>(library: &[u8], name: &str, output: &mut Output) {
        let library = Library::decode(library).expect("the library is valid");
        let texture = library.texture_at(0).expect("a library has one");
        let digest = of_plan::<M>(Plan::of_texture(texture)).value();
        output.line(format_args!("{} {digest:08x} {name}", report::DIGEST));
    }
    played::<Portable>(library, report::PORTABLE, output);
    played::<CortexM>(library, report::CORTEX_M, output);
}

#[inline(never)]
fn update(synthesis: &mut Synthesis<'_, CortexM>, motion: Motion) {
    synthesis.follow(motion, UPDATE_INTERVAL_SAMPLES);
}

#[inline(never)]
fn next(synthesis: &mut Synthesis<'_, CortexM>) -> OutputSample {
    synthesis.next_sample()
}

/// Prints the costs of a sample and of an update of each of `textures`, over the first `updates` updates of a motion.
fn measure<'a>(
    textures: impl Iterator<Item = Texture<'a>>,
    updates: u32,
    motion: fn(u32) -> Motion,
    counter: &Counter,
    output: &mut Output,
) {
    for texture in textures {
        let name = texture.name();
        let mut synthesis = Synthesis::<CortexM>::from_rest(texture, 0);
        let (mut sample, mut follow) = (Range::default(), Range::default());
        for motion in (0..updates).map(motion) {
            follow.add(counter.instructions(&mut || update(&mut synthesis, motion)));
            for _ in 0..UPDATE_INTERVAL_SAMPLES {
                let mut played = OutputSample::SILENCE;
                sample.add(counter.instructions(&mut || played = next(&mut synthesis)));
                core::hint::black_box(played);
            }
        }
        output.line(format_args!("{} {sample} {name}", report::SAMPLE_COST));
        output.line(format_args!("{} {follow} {name}", report::FOLLOW_COST));
    }
}
