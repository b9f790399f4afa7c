//! Measures idsp's cascade of second-order sections, 32-bit words and 64-bit sums, one sample per call.
//!
//! `idsp FOLDER SAMPLES`: noise and sections are those of `prepare.py`. The samples go to stdout, and the processor
//! time per sample, ns, to stderr.

use std::io::Write;
use std::path::Path;

use dsp_fixedpoint::Q32;
use dsp_process::SplitProcess;
use idsp::iir::{Biquad, Cascade, DirectForm};
use rustix::time::{ClockId, clock_gettime};

/// Number of fractional bits of the coefficients.
const FRACTION: i8 = 29;

fn words(folder: &str, name: &str) -> std::io::Result<Vec<i32>> {
    let bytes = std::fs::read(Path::new(folder).join(name))?;
    Ok(bytes
        .as_chunks()
        .0
        .iter()
        .map(|&word| i32::from_le_bytes(word))
        .collect())
}

/// Time that the processor has spent on this process, ns.
fn processor_ns() -> i64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

/// Plays `noise` through `N` sections, whose coefficients stand in `words` as b0, b1, b2, a1 and a2.
fn play<const N: usize>(words: &[i32], noise: &[i32], samples: &mut [i32]) -> i64 {
    let mut sections = words.as_chunks::<5>().0.iter();
    let cascade: Cascade<[Biquad<Q32<FRACTION>>; N]> = Cascade(std::array::from_fn(|_| Biquad {
        ba: sections.next().expect("N sections").map(Q32::from_bits),
    }));
    let mut state = DirectForm {
        x: [0; 2],
        y: [[0; 2]; N],
    };
    let begin = processor_ns();
    for (sample, &noise) in samples.iter_mut().zip(noise) {
        *sample = cascade.process(&mut state, noise);
    }
    processor_ns() - begin
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, folder, count] = &arguments[..] else {
        return Err("idsp FOLDER SAMPLES".into());
    };
    let (sections, noise) = (words(folder, "sections.i32")?, words(folder, "noise-of-sections.i32")?);
    let mut samples = vec![0; count.parse()?];
    let ns = match sections.len() / 5 {
        10 => play::<10>(&sections, &noise, &mut samples),
        50 => play::<50>(&sections, &noise, &mut samples),
        200 => play::<200>(&sections, &noise, &mut samples),
        number => return Err(format!("{number} sections").into()),
    };
    let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
    std::io::stdout().write_all(&bytes)?;
    eprintln!("{}", ns as f64 / samples.len() as f64);
    Ok(())
}
