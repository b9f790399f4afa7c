//! Hard cases: counts the instructions of every sample.

use core::hint::black_box;

use kernel_vectors::{HardCase, Way, report};
use model_format::OutputSample;
use stylus_realtime::CortexM;

use crate::counter::{Counter, Range};
use crate::output::{Output, Words};

/// Plays all of `cases`, and prints for each the digest and the cost of its samples.
pub fn play(mut cases: &[u8], counter: &Counter, output: &mut Output) {
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
