//! Lines that are locked to place.

use std::f64::consts::TAU;

use model_format::{
    Library, LineSpec, LinesSpec, OutputSample, SAMPLE_RATE_HZ, Structure, Texture, encode,
};
use stylus_kernel::position::Position;
use stylus_kernel::{Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::models::{motion, silent_node, spec};

const RATE: f64 = SAMPLE_RATE_HZ as f64;
const BLOCK: usize = UPDATE_INTERVAL_SAMPLES as usize;

/// A library of one texture that is silent but for `lines`: wavelength, mm, phase, turns, and the amplitude, m/s².
///
/// The grid is one node at 10 mm/s and 0.5 N, so that all speeds of a hand lie above it.
fn silent_but_for(lines: &[(f32, f64, f32)]) -> Vec<u8> {
    let silent = vec![silent_node(Structure::NormalisedLattice)];
    let mut spec = spec(Structure::NormalisedLattice, &[10.0], &[0.5], silent);
    let line = |&(wavelength_mm, phase, amplitude): &(f32, f64, f32)| LineSpec {
        wavelength_mm,
        phase: (phase * 65_536.0) as u16,
        amplitudes: vec![amplitude],
    };
    spec.parts.lines = Some(LinesSpec {
        lines: lines.iter().map(line).collect(),
    });
    encode(&[spec]).expect("a valid library")
}

fn only_texture(bytes: &[u8]) -> Texture<'_> {
    let library = Library::decode(bytes).expect("a valid library");
    library.textures().next().expect("one was written")
}

fn m_s2(sample: OutputSample) -> f64 {
    f64::from(sample.0) / f64::from(1u32 << OutputSample::FRACTION_BITS)
}

/// The samples of `texture` as the tool goes to `position_mm(t)`, told at the end of each block, at the speed that it
/// has at the beginning.
fn played(texture: Texture<'_>, seconds: f64, position_mm: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture, 1);
    let mut samples = Vec::new();
    for block in 0..(seconds * RATE) as usize / BLOCK {
        let (begin, end) = (
            (block * BLOCK) as f64 / RATE,
            ((block + 1) * BLOCK - 1) as f64 / RATE,
        );
        let speed = (position_mm(begin + 1e-4) - position_mm(begin - 1e-4)) / 2e-4;
        let position = Position::from_exact_mm(position_mm(end));
        synthesis.follow_to(
            motion(speed as f32, 1.0),
            Some(position),
            UPDATE_INTERVAL_SAMPLES,
        );
        samples.extend((0..BLOCK).map(|_| m_s2(synthesis.next_sample())));
    }
    samples
}

/// The definition in floats, with the position linear within a block.
#[test]
fn lines_are_the_sines_of_the_position() {
    let lines = [(0.61, 0.25, 1.5), (2.0, 0.9, 0.3), (731.0, 0.0, 4.0)];
    let bytes = silent_but_for(&lines);
    let position_mm = |t: f64| 1000.0 + 120.0 * t + 30.0 * (3.0 * t).sin();
    let samples = played(only_texture(&bytes), 4.0, position_mm);
    for (n, sample) in samples.iter().enumerate().skip(2 * BLOCK) {
        let block = n / BLOCK;
        let time = |last: usize| (last as f64 - 1.0) / RATE;
        let (from, to) = (
            position_mm(time(block * BLOCK)),
            position_mm(time((block + 1) * BLOCK)),
        );
        let x = from + (to - from) * (n % BLOCK + 1) as f64 / BLOCK as f64;
        let exact: f64 = lines
            .iter()
            .map(|&(wavelength, phase, amplitude)| {
                let turns = x / f64::from(wavelength) + (phase * 65_536.0).floor() / 65_536.0;
                f64::from(amplitude) * (turns * TAU).sin()
            })
            .sum();
        assert!(
            (sample - exact).abs() < 2e-5,
            "sample {n}: {sample}, not {exact}"
        );
    }
}
