//! What leaves a player at most: the table of its page.

use proptest::prelude::*;
use stylus_player::{BlockMotion, Filler, player};

use crate::{LIBRARIES, choose, playing, playing_as_rendered, rubbed};

/// Seconds of samples. `tell` is called before each block of 2 ms with its number.
fn filled(filler: &mut Filler, seconds: usize, mut tell: impl FnMut(usize)) -> Vec<f32> {
    let rate_hz = filler.output_rate_hz() as usize;
    let mut samples = vec![0.0; seconds * rate_hz];
    for (block, samples) in samples.chunks_mut(rate_hz / 500).enumerate() {
        tell(block);
        filler.fill(samples);
    }
    samples
}

fn mean(samples: &[f32]) -> f64 {
    samples.iter().copied().map(f64::from).sum::<f64>() / samples.len() as f64
}

fn mean_square(samples: &[f32]) -> f64 {
    samples.iter().map(|sample| f64::from(*sample).powi(2)).sum::<f64>() / samples.len() as f64
}

proptest! {
    #[test]
    fn every_sample_is_a_number_within_the_limit_and_the_coils_whatever_is_told(
        rate_hz in prop_oneof![Just(1000), Just(5000), Just(10_000), Just(44_100)],
        // Any bits, and the ends of single precision, whose difference it does not hold.
        calls in prop::collection::vec((0..5, prop::array::uniform3(prop_oneof![
            prop::num::f32::ANY, Just(3e38f32), Just(-3e38f32), Just(f32::INFINITY), -1e3..1e3f32, 0.0..1.0f32,
        ])), 1..20),
    ) {
        let (mover, mut filler) = playing(&LIBRARIES[0], 1, rate_hz);
        let (mut limit, mut peak) = (f64::INFINITY, f64::INFINITY);
        for (call, [one, other, third]) in calls {
            let [a, b, c] = [one, other, third].map(f64::from);
            // Whether it is refused or not.
            match call {
                0 => if mover.set_gain(one, other).is_ok() {
                    limit = b;
                },
                1 => if mover.set_coil(one, other, third).is_ok() {
                    peak = 4.0 * f64::from(one * third).sqrt();
                },
                2 => drop(mover.rub(a, b)),
                3 => drop(mover.reach(a, b, c)),
                _ => drop(mover.follow(BlockMotion { begin_mm: b, end_mm: c, ..BlockMotion::new(a, 1.0) })),
            }
            let within = limit.min(peak * (1.0 + 1e-6));
            let mut samples = [0.0f32; 150];
            filler.fill(&mut samples);
            for sample in samples {
                prop_assert!(sample.is_finite() && f64::from(sample.abs()) <= within, "{sample} {within}");
            }
        }
    }
}

/// A position that stands gives lines a constant phase, which is a constant acceleration.
#[test]
fn nothing_steady_leaves_where_a_position_stands_at_any_rate_of_moves() {
    let mut steady = 0.0f64;
    for (library, rate_hz) in LIBRARIES.iter().zip([5000, 10_000]) {
        for (index, every) in (0..library.library().len()).flat_map(|index| [(index, 1), (index, 33)]) {
            let motion = BlockMotion {
                begin_mm: 3.3,
                end_mm: 3.3,
                ..BlockMotion::new(100.0, 1.0)
            };
            let run = |(mover, mut filler): (stylus_player::Mover, Filler)| {
                let told = |block: usize| {
                    if block.is_multiple_of(every) {
                        mover.follow(motion).expect("it is finite");
                    }
                };
                filled(&mut filler, 4, told)
            };
            let raw = run(playing_as_rendered(library, index, rate_hz));
            let blocked = run(playing(library, index, rate_hz));
            let last = |samples: &[f32]| samples[samples.len() / 2..].to_vec();
            let (raw, blocked) = (last(&raw), last(&blocked));
            steady = steady.max(mean(&raw).abs() / mean_square(&raw).sqrt().max(1e-9));
            let rms = mean_square(&blocked).sqrt();
            assert!(
                mean(&blocked).abs() <= 0.01 * rms + 1e-4,
                "{rate_hz} {index} {every}: {} of {rms}",
                mean(&blocked)
            );
        }
    }
    assert!(steady > 0.3, "the kernel has such textures: {steady}");
}

#[test]
fn a_coil_gets_its_peak_slew_and_power_at_most_and_what_it_can_bear_unchanged() {
    const RATE_HZ: u32 = 8000;
    let (ohms, watts) = (8.0f32, 0.1f32);
    let (square, mut warmest) = (f64::from(ohms * watts), 0.0f64);
    let peak = 4.0 * square.sqrt();
    for volts_per_m_s2 in [1e-3f32, 1.0, 1e3] {
        let (mover, mut filler) = playing(&LIBRARIES[0], 1, RATE_HZ);
        let (plain_mover, mut plain) = playing(&LIBRARIES[0], 1, RATE_HZ);
        mover.set_coil(ohms, volts_per_m_s2, watts).expect("it is a coil");
        plain_mover
            .set_gain(volts_per_m_s2, f32::INFINITY)
            .expect("it is finite");
        let move_both = |_| {
            mover.rub(150.0, 1.5).expect("it is finite");
            plain_mover.rub(150.0, 1.5).expect("it is finite");
        };
        let volts = filled(&mut filler, 40, move_both);
        let wanted = rubbed(&plain_mover, &mut plain, 2000, (150.0, 1.5));
        if volts_per_m_s2 == 1e-3 {
            assert_eq!(volts[..wanted.len()], wanted);
        }
        let (mut before, mut warmth) = (0.0, 0.75);
        for volt in volts.iter().copied().map(f64::from) {
            assert!(volt.abs() <= peak * (1.0 + 1e-6));
            assert!((volt - before).abs() <= 2500.0 * peak / f64::from(RATE_HZ) * (1.0 + 1e-5));
            warmth += (volt * volt / square - warmth) / (10.0 * f64::from(RATE_HZ));
            assert!(warmth <= 1.0, "{volts_per_m_s2}: {warmth}");
            (before, warmest) = (volt, warmest.max(warmth));
        }
        // A gain that is set later changes nothing about it.
        mover.set_gain(1e6, f32::INFINITY).expect("it is finite");
        let later = filled(&mut filler, 1, move_both);
        assert!(later.iter().all(|volt| f64::from(volt.abs()) <= peak * (1.0 + 1e-6)));
    }
    assert!(warmest > 0.9, "the limiter was needed: {warmest}");
}

#[test]
fn a_tool_at_rest_or_in_the_air_is_silent() {
    for index in 0..LIBRARIES[0].library().len() {
        for rest in [(0.0, 1.0), (100.0, 0.0)] {
            let (mover, mut filler) = playing(&LIBRARIES[0], index, 5000);
            rubbed(&mover, &mut filler, 200, (100.0, 1.0));
            let samples = rubbed(&mover, &mut filler, 2000, rest);
            // What the DC blocker held decays with 80 ms.
            let peak = |samples: &[f32]| samples.iter().fold(0.0f32, |peak, sample| peak.max(sample.abs()));
            let late = &samples[samples.len() - 500..];
            assert!(peak(late) <= 2e-6, "{index} {rest:?}: {}", peak(late));
        }
    }
}

#[test]
fn a_player_that_was_told_nothing_is_silent() {
    let (mover, mut filler) = player(48_000).expect("the rate is played");
    let silence = filled(&mut filler, 1, |_| {});
    choose(&mover, &LIBRARIES[0], 1);
    let untold = filled(&mut filler, 1, |_| {});
    assert!(silence.into_iter().chain(untold).all(|sample| sample == 0.0));
}
