//! Counts of instructions, by the timer: for decoding libraries, for the longest step of decoding, for plans, and for
//! every sample of hard cases.
//!
//! With `-icount shift=8` QEMU advances virtual time by 256 ns per instruction. SysTick runs at 25 MHz on the MPS2
//! board, 6.4 ticks per instruction, so a count is exact although a tick may be lost at its beginning and at its end.

use core::fmt;
use core::hint::black_box;

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use kernel_vectors::{HardCase, Libraries, Way, report};
use model_format::{Decoder, Library, OutputSample, Texture};
use stylus_kernel::scene::Plan;
use stylus_realtime::CortexM;

use crate::output::{Output, Words};

/// Decodes each of `libraries`. Plans each of its scenes and its first and last texture, all found by name. Prints the
/// costs.
pub fn bounds(libraries: &[u8], counter: &Counter, output: &mut Output) {
    for bytes in Libraries(libraries) {
        let (mut all, mut longest, mut steps) = (0u64, 0, 0u32);
        let mut decoder = Decoder::new(bytes);
        let library = loop {
            let mut stepped = Ok(None);
            let cost = counter.instructions(&mut || stepped = black_box(&mut decoder).step());
            all += u64::from(cost);
            longest = cost.max(longest);
            steps += 1;
            if let Some(library) = stepped.expect("the host wrote libraries") {
                break library;
            }
        };
        let plan = plans(&library, counter);
        output.line(format_args!(
            "{} {} {all} {steps} {longest} {plan}",
            report::LIBRARY_COST,
            bytes.len()
        ));
    }
}

/// Largest number of instructions of a plan, from looking up the name that a host requests to the check of the plan's
/// cost.
fn plans(library: &Library<'_>, counter: &Counter) -> u32 {
    let mut most = 0;
    for scene in library.scenes() {
        let cost = counter.instructions(&mut || {
            let found = black_box(library).scene(&scene.name);
            let plan = found.map(|scene| Plan::new(&scene, library));
            let plan = plan.and_then(Result::ok).expect("it is valid");
            black_box(plan.worst_case().instructions());
            black_box(&plan);
        });
        most = cost.max(most);
    }
    let ends = [library.textures().next(), library.textures().last()];
    for name in ends.iter().flatten().map(Texture::name) {
        let cost = counter.instructions(&mut || {
            let texture = black_box(library).texture(name).expect("it is there");
            let plan = Plan::of_texture(texture);
            black_box(plan.worst_case().instructions());
            black_box(&plan);
        });
        most = cost.max(most);
    }
    most
}

/// Plays all of `cases`, and prints for each the digest and the cost of its samples.
pub fn hard_cases(mut cases: &[u8], counter: &Counter, output: &mut Output) {
    while let Some((case, rest)) = HardCase::take(cases).expect("the host wrote cases") {
        cases = rest;
        let (mut synthesis, mut filter) = (Range::default(), Range::default());
        let mut measure = |way, sample: &mut dyn FnMut() -> OutputSample| {
            let mut played = OutputSample::SILENCE;
            let cost = counter.instructions(&mut || played = black_box(&mut *sample)());
            match way {
                Way::Synthesis => synthesis.add(cost),
                Way::Filter => filter.add(cost),
            }
            played
        };
        let digest = case.play::<CortexM>(&mut measure).expect("the host wrote libraries");
        let name = case.name;
        output.line(format_args!("{} {} {name}", report::VECTOR, report::CORTEX_M));
        let mut words = Words::new(output);
        words.push(digest);
        words.finish();
        for (way, range) in [(report::SYNTHESIS, synthesis), (report::FILTER, filter)] {
            output.line(format_args!("{} {range} {way} {name}", report::SAMPLE_COST));
        }
    }
}

/// The largest count of SysTick, which counts down in 24 bits.
const MASK: u32 = 0x00ff_ffff;

/// Counts the instructions of calls.
pub struct Counter {
    /// The cost of reading the timer and making an empty call, ticks.
    empty_ticks: u32,
}

impl Counter {
    /// Starts the timer, and measures the cost of counting itself.
    pub fn new(mut systick: SYST) -> Self {
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(MASK);
        systick.clear_current();
        systick.enable_counter();
        Self {
            empty_ticks: ticks(&mut || ()),
        }
    }

    /// Returns the number of instructions of `call` beyond those of an empty call. It must be below 2.6 million.
    pub fn instructions(&self, call: &mut dyn FnMut()) -> u32 {
        let ticks = ticks(call) - self.empty_ticks;
        // 32 ticks correspond to 5 instructions.
        (ticks * 5 + 16) / 32
    }
}

/// Returns the ticks of `call`, including those of counting. All calls share this function, so the cost of counting is
/// the same for each.
#[inline(never)]
fn ticks(call: &mut dyn FnMut()) -> u32 {
    let before = SYST::get_current();
    black_box(call)();
    before.wrapping_sub(SYST::get_current()) & MASK
}

/// The smallest and the largest of several counts.
pub struct Range {
    fewest: u32,
    most: u32,
    count: u32,
}

impl Default for Range {
    fn default() -> Self {
        Self {
            fewest: u32::MAX,
            most: 0,
            count: 0,
        }
    }
}

impl Range {
    pub fn add(&mut self, value: u32) {
        self.fewest = self.fewest.min(value);
        self.most = self.most.max(value);
        self.count += 1;
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", self.fewest, self.most, self.count)
    }
}
