//! When a motion takes effect, and for how long.

use kernel_vectors::specs;
use model_format::TextureSpec;
use proptest::prelude::*;
use stylus_player::{BlockMotion, Filler, HELD_S, Mover, latency_s};

use crate::{LIBRARIES, library, playing, playing_as_rendered, rubbed};

const RATES_HZ: [u32; 8] = [1000, 5000, 8000, 10_000, 11_025, 44_100, 48_000, 192_000];

/// The output begins to change at the latest when the current block ends. The stated latency is that of the change's
/// centre, which is later by the interpolator's delay.
#[test]
fn a_move_changes_a_sample_within_the_latency_that_is_stated() {
    for (library, sample_rate_hz) in LIBRARIES.iter().zip([5000, 10_000]) {
        for rate_hz in RATES_HZ {
            let latency = (latency_s(sample_rate_hz, rate_hz) * f64::from(rate_hz)).ceil() as usize;
            // Anywhere in a block.
            for offset in (0..rate_hz as usize / 500).step_by(3) {
                let [before, after] = [(100.0, 1.0), (250.0, 2.5)].map(|motion| {
                    let (mover, mut filler) = playing(library, 1, rate_hz);
                    rubbed(&mover, &mut filler, 20, (100.0, 1.0));
                    let mut samples = vec![0.0; offset];
                    filler.fill(&mut samples);
                    mover.rub(motion.0, motion.1).expect("it is finite");
                    let mut samples = vec![0.0f32; rate_hz as usize / 20];
                    filler.fill(&mut samples);
                    samples
                });
                let peak = before.iter().fold(0.0f32, |peak, sample| peak.max(sample.abs()));
                let changed = |by: f32| {
                    let pairs = before.iter().zip(&after);
                    pairs
                        .map(|(one, other)| (one - other).abs())
                        .position(|difference| difference > by)
                };
                let first = changed(0.0).expect("it changes");
                assert!(first <= rate_hz as usize / 500 + 1, "{rate_hz} {offset}: {first}");
                let felt = changed(0.1 * peak).expect("it changes");
                assert!(
                    felt <= latency + rate_hz as usize / 500,
                    "{rate_hz} {offset}: {felt} {latency}"
                );
            }
        }
    }
}

/// Lines where a position stands give a constant, whose steps by another position or force are seen without noise.
#[test]
fn the_middle_of_a_steps_change_comes_after_the_latency_that_is_stated_in_the_mean_and_1_ms_later_at_most() {
    assert!(latency_s(5000, 44_100) <= 0.0026 && latency_s(5000, 48_000) <= 0.0026);
    let all = specs();
    let mut lines: Vec<TextureSpec> = all
        .iter()
        .filter(|spec| spec.name.contains("four lines"))
        .cloned()
        .collect();
    for node in lines.iter_mut().flat_map(|spec| &mut spec.nodes) {
        node.output_power *= 1e-10;
        node.prediction_error_power *= 1e-10;
    }
    for sample_rate_hz in [5000, 10_000] {
        let library = library(&lines, sample_rate_hz);
        for (rate_hz, to) in RATES_HZ
            .into_iter()
            .flat_map(|rate| [(rate, (5.0, 1.0)), (rate, (3.0, 1.8))])
        {
            let block = rate_hz as usize / 500;
            let fill = |mover: &Mover, filler: &mut Filler, (at_mm, force_n): (f64, f64), count: usize| {
                let motion = BlockMotion {
                    begin_mm: at_mm,
                    end_mm: at_mm,
                    ..BlockMotion::new(100.0, force_n)
                };
                let mut samples = vec![0.0f32; count];
                for part in samples.chunks_mut(block / 2) {
                    mover.follow(motion).expect("it is finite");
                    filler.fill(part);
                }
                samples
            };
            // All over a block.
            let middles_s: Vec<f64> = (0..block)
                .step_by(block.div_ceil(20))
                .map(|offset| {
                    let (mover, mut filler) = playing_as_rendered(&library, 0, rate_hz);
                    fill(&mover, &mut filler, (3.0, 1.0), rate_hz as usize / 25 + offset);
                    let samples = fill(&mover, &mut filler, to, rate_hz as usize / 25);
                    let (before, after) = (f64::from(samples[0]), f64::from(samples[samples.len() - 1]));
                    let share = |at: usize| (f64::from(samples[at]) - before) / (after - before);
                    let first = (1..samples.len()).find(|at| share(*at) >= 0.5).expect("it changes");
                    let within = (0.5 - share(first - 1)) / (share(first) - share(first - 1));
                    ((first - 1) as f64 + within) / f64::from(rate_hz)
                })
                .collect();
            let mean_s = middles_s.iter().sum::<f64>() / middles_s.len() as f64;
            let longest_s = middles_s.iter().fold(0.0, |longest: f64, middle| longest.max(*middle));
            let stated_s = latency_s(sample_rate_hz, rate_hz);
            // Moves are between samples: on the average half of one earlier than here.
            let least_s = stated_s - 0.001 - 0.5 / f64::from(rate_hz);
            let is_held = (least_s..=stated_s).contains(&mean_s) && longest_s <= stated_s + 0.001;
            assert!(is_held, "{sample_rate_hz} {rate_hz} {to:?}: {mean_s} {longest_s}");
        }
    }
}

#[test]
fn a_motion_that_is_not_told_again_is_held_for_50_ms_and_the_length_of_a_buffer_and_fades() {
    assert_eq!(HELD_S, 0.05);
    for (rate_hz, buffer_s) in [5000, 10_000]
        .into_iter()
        .flat_map(|rate_hz| [0.002, 0.05, 1.0].map(|s| (rate_hz, s)))
    {
        let library = &LIBRARIES[usize::from(rate_hz == 10_000)];
        let (mover, mut filler) = playing(library, 1, rate_hz);
        rubbed(&mover, &mut filler, 20, (100.0, 1.0));
        let mut samples = vec![0.0f32; 3 * rate_hz as usize];
        for buffer in samples.chunks_mut((buffer_s * f64::from(rate_hz)) as usize) {
            filler.fill(buffer);
        }
        let last = samples.iter().rposition(|sample| *sample != 0.0).expect("it is held");
        // The block of the last move has been taken before, and the last block fades.
        let held_s = (last + 1) as f64 / f64::from(rate_hz);
        assert!(
            (held_s - HELD_S - buffer_s).abs() < 0.001,
            "{rate_hz} {buffer_s}: {held_s}"
        );
        let again = rubbed(&mover, &mut filler, 20, (100.0, 1.0));
        assert!(again.iter().any(|sample| *sample != 0.0), "{rate_hz}");
    }
}

proptest! {
    /// In the time of the samples: before each buffer the mover has told what was due by then.
    #[test]
    fn while_motions_come_20_times_per_second_or_more_no_buffer_up_to_a_second_falls_silent(
        rate in 0..RATES_HZ.len(),
        buffer_ms in prop_oneof![0.1..50.0f64, 50.0..1000.0],
        moves_hz in 20.0..2000.0f64,
        first in 0.0..1.0f64,
    ) {
        let rate_hz = RATES_HZ[rate];
        let (mover, mut filler) = playing(&LIBRARIES[0], 1, rate_hz);
        let mut samples = vec![0.0f32; 3 * rate_hz as usize];
        let frames = (buffer_ms * 1e-3 * f64::from(rate_hz)).max(1.0) as usize;
        let mut told = 0.0;
        for (index, buffer) in samples.chunks_mut(frames).enumerate() {
            let due = (index * frames) as f64 / f64::from(rate_hz) * moves_hz + first;
            if index == 0 || due.floor() > told {
                mover.rub(100.0, 1.0).expect("it is finite");
                told = due.floor();
            }
            filler.fill(buffer);
        }
        // What fades takes a block, and at the beginning the interpolator is empty.
        for (index, part) in samples.chunks(rate_hz as usize / 250).enumerate().skip(5) {
            prop_assert!(part.iter().any(|sample| *sample != 0.0), "silent after {} ms", 4 * index);
        }
    }
}

#[test]
fn samples_do_not_depend_on_how_many_are_taken_at_once() {
    for rate_hz in RATES_HZ {
        let count = rate_hz as usize / 25;
        let run = |sizes: &[usize]| {
            let (mover, mut filler) = playing(&LIBRARIES[0], 1, rate_hz);
            mover.rub(120.0, 0.8).expect("it is finite");
            let mut samples = vec![0.0f32; count];
            let mut rest = &mut samples[..];
            for size in sizes.iter().cycle() {
                let (now, later) = rest.split_at_mut((*size).min(rest.len()));
                filler.fill(now);
                rest = later;
                if rest.is_empty() {
                    break;
                }
            }
            samples
        };
        let whole = run(&[count]);
        assert!(whole.iter().any(|sample| *sample != 0.0));
        assert_eq!(run(&[1]), whole, "{rate_hz}");
        assert_eq!(run(&[7, 64, 1, 0, 500]), whole, "{rate_hz}");
    }
}
