//! Each effect separately, compared with its definition in floating point.

use std::f64::consts::PI;

use model_format::scene::limits::MAX_POLE_RADIUS_1024THS;
use model_format::scene::{Biquad, StickSlip, Tap};
use model_format::{OutputSample, SAMPLE_RATE_HZ};
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::ONE;
use stylus_kernel::scene::{Equaliser, EqualiserState, Resonance, StickSlipState, StickSlipWindow, Strike, TapState};

use crate::models::{biquad, motion};

/// Output steps in 1 m/s².
const UNIT: f64 = (1u32 << OutputSample::FRACTION_BITS) as f64;

fn any_tap() -> impl Strategy<Value = Tap> {
    (10.0f32..2250.0, 0.0005f32..1.0, 0.0f32..=256.0).prop_map(|(frequency_hz, decay_s, limit_m_s2)| Tap {
        frequency_hz,
        decay_s,
        gain_m_s2_per_n_s: 1.0,
        limit_m_s2,
    })
}

fn tap_of(frequency_hz: f32, decay_s: f32) -> Tap {
    Tap {
        frequency_hz,
        decay_s,
        gain_m_s2_per_n_s: 1.0,
        limit_m_s2: 256.0,
    }
}

#[test]
fn a_tap_is_a_decaying_sinusoid_that_begins_at_zero() {
    for (frequency, decay) in [
        (20.0, 0.3),
        (180.0, 0.02),
        (1249.0, 0.05),
        (1251.0, 0.05),
        (2200.0, 0.01),
    ] {
        let tap = tap_of(frequency, decay);
        let resonance = Resonance::new(&tap, SAMPLE_RATE_HZ);
        let mut state = TapState::new();
        state.strike(Strike::new(&tap, 10.0));
        for n in 0..1000 {
            let t = f64::from(n) / f64::from(SAMPLE_RATE_HZ);
            let exact = 10.0 * (-t / f64::from(decay)).exp() * (2.0 * PI * f64::from(frequency) * t).sin();
            let played = f64::from(state.next_sample(resonance).0) / UNIT;
            assert!((played - exact).abs() < 1e-3, "{frequency} Hz, {n}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// This holds for any rate and force of strikes, and when the resonance changes while it rings.
    #[test]
    fn no_strikes_take_the_state_beyond_the_limit(
        taps in vec(any_tap(), 1..4),
        strikes in vec((any::<proptest::sample::Index>(), 0.0f32..1e6, 0usize..30), 1..200),
    ) {
        let mut state = TapState::new();
        let limit = taps.iter().fold(0.0, |high: f64, tap| high.max(f64::from(tap.limit_m_s2)));
        let limit = (limit * UNIT * 4.0).powi(2);
        for (which, rate, samples) in strikes {
            let tap = which.get(&taps);
            let (resonance, before) = (Resonance::new(tap, SAMPLE_RATE_HZ), state.square_norm());
            state.strike(Strike::new(tap, rate));
            prop_assert!(state.square_norm() as f64 <= limit.max(before as f64));
            for _ in 0..samples {
                let before = state.square_norm();
                let output = f64::from(state.next_sample(resonance).0);
                prop_assert!(output.abs() * 4.0 <= (before as f64).sqrt());
                prop_assert!(state.square_norm() <= before);
            }
        }
    }

    /// The next sample continues from the last one, however hard the tool strikes.
    #[test]
    fn a_strike_leaves_the_sample_as_it_is(tap in any_tap(), rates in vec(0.0f32..1e4, 1..20)) {
        let resonance = Resonance::new(&tap, SAMPLE_RATE_HZ);
        let mut state = TapState::new();
        for rate in rates {
            let mut unstruck = state;
            state.strike(Strike::new(&tap, rate));
            prop_assert_eq!(state.next_sample(resonance), unstruck.next_sample(resonance));
        }
    }

    #[test]
    fn a_tap_dies_to_exact_silence(tap in any_tap()) {
        let resonance = Resonance::new(&tap, SAMPLE_RATE_HZ);
        let mut state = TapState::new();
        state.strike(Strike::new(&tap, 1e6));
        // Thirty time constants are 260 dB, more than the 181 dB from 2³⁰ steps to one.
        let limit = (30.0 * tap.decay_s * SAMPLE_RATE_HZ as f32) as usize + 100;
        let silent = (0..limit).any(|_| {
            state.next_sample(resonance);
            state.is_silent()
        });
        prop_assert!(silent, "{} samples", limit);
        prop_assert_eq!(state.next_sample(resonance), OutputSample::SILENCE);
    }

    #[test]
    fn the_envelope_has_no_step_and_is_never_above_one(
        period_mm in 0.01f32..1000.0, duty in 0.05f32..=1.0, depth in 0.0f32..=1.0,
        distances in vec((0.0f32..1e6, 0.0f32..20.0, 0.0f32..2.0), 1..40),
    ) {
        let stick_slip = StickSlip { period_mm, duty, depth, below_mm_s: 15.0, above_n: 0.2 };
        let window = StickSlipWindow::new(&stick_slip);
        let (mut state, mut amount) = (StickSlipState::new(), 0);
        let mut before: Option<f64> = None;
        for (distance, speed, force) in distances {
            let frame = window.frame(motion(speed, force), distance, amount, 10);
            let ramp = f64::from((frame.amount(0) - amount).abs()) / 10.0;
            for left in (0..10).rev() {
                let envelope = state.envelope(&frame, left);
                prop_assert!(envelope <= ONE);
                let sample = state.modulate(&frame, OutputSample(-1_000_000), left);
                prop_assert!(sample.0 <= 0 && sample.0 >= -1_000_000);
                let most = 0.2 * f64::from(depth) * f64::from(ONE) + ramp + 8.0;
                if let Some(before) = before {
                    prop_assert!((f64::from(envelope) - before).abs() <= most);
                }
                before = Some(f64::from(envelope));
            }
            amount = frame.amount(0);
        }
    }
}

/// A biquad in floating point, by its definition.
fn reference(sections: &[Biquad], input: &[f64]) -> Vec<f64> {
    let mut signal = input.to_vec();
    for section in sections {
        let ([b0, b1, b2], [a1, a2]) = (section.numerator(), section.denominator());
        let (mut x, mut y) = ([0.0; 2], [0.0; 2]);
        for sample in &mut signal {
            let output = b0 * *sample + b1 * x[0] + b2 * x[1] - a1 * y[0] - a2 * y[1];
            (x, y) = ([*sample, x[0]], [output, y[0]]);
            *sample = output;
        }
    }
    signal
}

/// Resonances and dips from the middle of the band to its ends, and poles on the real axis.
fn cascades() -> Vec<Vec<Biquad>> {
    let real = |pole: f64, other: f64| {
        let gain = (1.0 - pole.abs()) * (1.0 - other.abs());
        let denominator = [-(pole + other), pole * other];
        Biquad::from_f64([gain, 0.0, 0.0], denominator).expect("within range")
    };
    let limit = MAX_POLE_RADIUS_1024THS as f64 / 1024.0 - 1e-6;
    vec![
        vec![Biquad::IDENTITY],
        vec![biquad(120.0, 0.97, 0.93)],
        vec![biquad(60.0, limit, 0.998), biquad(60.0, 0.95, 0.98)],
        vec![
            biquad(2400.0, 0.99, 0.97),
            biquad(3.0, 0.99, 0.985),
            biquad(700.0, 0.9, 0.95),
        ],
        vec![real(limit, -0.5)],
        vec![real(-limit, 0.3), real(0.0, 0.0)],
        vec![biquad(300.0, 0.96, 0.96); 8],
    ]
}

fn noise(count: usize, rms: f64, seed: u64) -> Vec<OutputSample> {
    let mut excitation = Excitation::new(seed);
    let scale = rms * UNIT / f64::from(1u32 << 28);
    let sample = |_| OutputSample((f64::from(excitation.next_sample()) * scale) as i32);
    (0..count).map(sample).collect()
}

/// Noise of 2 m/s² RMS. A step of the converter is 80 mm/s² at the settings' default gain, and the error is below a
/// fortieth of it.
#[test]
fn the_equaliser_is_its_biquads_within_2_mm_s2_rms() {
    for (index, sections) in cascades().iter().enumerate() {
        let equaliser = Equaliser::new(sections);
        let mut state = EqualiserState::new();
        let input = noise(20_000, 2.0, 1);
        let exact = reference(
            sections,
            &input.iter().map(|x| f64::from(x.0) / UNIT).collect::<Vec<_>>(),
        );
        let mut error = 0.0;
        for (&input, exact) in input.iter().zip(exact) {
            let (output, full) = state.process(&equaliser, input);
            assert!(!full, "cascade {index}");
            error += (f64::from(output.0) / UNIT - exact).powi(2);
        }
        let rms = (error / input.len() as f64).sqrt();
        assert!(rms < 0.002, "cascade {index}: {rms} m/s²");
    }
}

/// Full-scale tones at each resonance, then silence.
#[test]
fn the_equaliser_falls_exactly_silent_whatever_was_played() {
    for (index, sections) in cascades().iter().enumerate() {
        let equaliser = Equaliser::new(sections);
        for hz in [3.0, 60.0, 300.0, 2400.0] {
            let mut state = EqualiserState::new();
            for n in 0..5000 {
                let phase = 2.0 * PI * hz * f64::from(n) / f64::from(SAMPLE_RATE_HZ);
                state.process(&equaliser, OutputSample((phase.sin() * 2e9) as i32));
            }
            assert!(!state.is_silent() || index == 0);
            let silent = (0..40_000).find(|_| {
                state.process(&equaliser, OutputSample::SILENCE);
                state.is_silent()
            });
            assert!(silent.is_some(), "cascade {index} after {hz} Hz");
            let after = state.process(&equaliser, OutputSample::SILENCE);
            assert_eq!(after, (OutputSample::SILENCE, false));
        }
    }
}

fn any_biquad() -> impl Strategy<Value = Biquad> {
    let limit = MAX_POLE_RADIUS_1024THS as f64 / 1024.0;
    let denominator = prop_oneof![
        (0.0..limit, 0.0..PI).prop_map(|(r, angle)| [-2.0 * r * angle.cos(), r * r]),
        (-limit..limit, -limit..limit).prop_map(|(p, q)| [-(p + q), p * q]),
    ];
    denominator.prop_filter_map("within the limit", |denominator| {
        // The gain of such a section is not checked here, only the recursion.
        let biquad = Biquad::from_f64([0.01, 0.0, 0.0], denominator)?;
        biquad.poles_are_within_limit().then_some(biquad)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// This holds however sections are exchanged. The input contributes its square.
    #[test]
    fn one_section_gains_no_energy_whatever_its_poles(
        sections in vec(any_biquad(), 1..6), inputs in vec(any::<i32>(), 1..300),
    ) {
        let equalisers: Vec<Equaliser> =
            sections.iter().map(|section| Equaliser::new(&[*section])).collect();
        let mut state = EqualiserState::new();
        for (n, input) in inputs.into_iter().enumerate() {
            let before = state.square_norm();
            let share = u128::from((input / 32).unsigned_abs()).pow(2);
            state.process(&equalisers[n % equalisers.len()], OutputSample(input));
            prop_assert!(state.square_norm() <= before + share);
        }
    }
}

#[test]
fn what_the_equaliser_cannot_hold_is_saturated_and_told() {
    let equaliser = Equaliser::new(&[Biquad::from_f64([4.0, 0.0, 0.0], [0.0, 0.0]).unwrap()]);
    let mut state = EqualiserState::new();
    let loud = OutputSample(1 << 30);
    assert_eq!(state.process(&equaliser, loud), (OutputSample(i32::MAX), true));
    let quiet = OutputSample(1 << 20);
    let (output, full) = state.process(&equaliser, quiet);
    // Within 16 steps of 2⁻¹⁵ m/s².
    assert!(!full, "{output:?}");
    assert!((output.0 - (4 << 20)).abs() <= 16 << 5, "{output:?}");
}
