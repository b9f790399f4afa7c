use std::f64::consts::TAU;

use proptest::prelude::*;

use super::*;

const RATE_HZ: f64 = 5000.0;

/// Uniform numbers in [0, 1) by `SplitMix64` (Steele, Lea and Flood, 2014), which takes one line in any language.
fn uniform(seed: u64) -> impl Iterator<Item = f64> {
    let mut state = seed;
    std::iter::repeat_with(move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    })
}

/// Gaussian noise by the method of Box and Muller, one number from each pair of uniform numbers. SciPy judged the same
/// numbers, so that they are not those of the other tests.
fn portable_noise(seed: u64, len: usize) -> Vec<f64> {
    let mut uniform = uniform(seed);
    std::iter::repeat_with(|| {
        let (a, b) = (uniform.next().unwrap(), uniform.next().unwrap());
        (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
    })
    .take(len)
    .collect()
}

fn turn(hz: f64, n: usize) -> f64 {
    TAU * hz * n as f64 / RATE_HZ
}

fn made(len: usize, sample: impl Fn(usize) -> f64) -> Vec<f64> {
    (0..len).map(sample).collect()
}

fn measures(signal: &[f64]) -> Liveliness {
    Liveliness::of(&[signal], RATE_HZ, None)
}

fn near(found: Option<f64>, expected: f64, tolerance: f64) {
    let found = found.unwrap();
    test_helpers::near(found, expected, tolerance * expected.abs());
}

/// Noise, a resonance, modulated noise, and noise with an impulse of 26 dB every 25 ms; 4 s each.
fn synthetic() -> [Vec<f64>; 4] {
    let len = 20_000;
    let resonance = test_helpers::resonant(portable_noise(2, len), TAU * 90.0 / RATE_HZ, 0.97);
    let carrier = portable_noise(3, len);
    let modulated = made(len, |n| {
        carrier[n] * (0.5 * turn(3.0, n).sin() + 0.4 * turn(20.0, n).sin()).exp()
    });
    let (impulses, ground) = (portable_noise(4, len), portable_noise(5, len));
    let impulsive = made(len, |n| if n % 125 == 0 { 20.0 * impulses[n] } else { ground[n] });
    [portable_noise(1, len), resonance, modulated, impulsive]
}

/// Computed with SciPy 1.17 and NumPy: `stats.kurtosis`, `linalg.solve_toeplitz` and `signal.lfilter` for the residual,
/// `fft.rfft` and `signal.hilbert` for the band, `signal.welch` for the envelope's spectrum.
#[test]
fn measures_are_those_that_scipy_finds() {
    let expected = [
        (3.004_063, 3.859_443, 2.959_859, 0.353_217, 0.173_734),
        (2.893_078, 3.624_720, 2.955_298, 1.547_631, 0.394_141),
        (5.979_585, 7.398_674, 3.838_743, 2.984_425, 0.361_515),
        (189.737_821, 25.761_308, 80.568_718, 2.897_770, 0.579_612),
    ];
    for (signal, (kurtosis, crest, residual, spread, modulation)) in synthetic().iter().zip(expected) {
        let found = measures(signal);
        near(found.kurtosis, kurtosis, 1e-5);
        near(found.crest_factor, crest, 1e-5);
        near(found.residual_kurtosis, residual, 1e-4);
        near(found.level_spread_db, spread, 1e-5);
        // The last segments of the two estimates differ: here one more segment ends with the signal.
        near(found.modulation, modulation, 0.03);
    }
}

#[test]
fn noise_has_no_line() {
    let noise = portable_noise(11, 100_000);
    assert_eq!(measures(&noise).line_range_db, None);
    assert_eq!(strongest_line_hz(&[&noise], RATE_HZ), None);
}

/// For a carrier whose amplitude is 1 + m sin, the RMS of the envelope's variation is m/√2 times its mean.
#[test]
fn the_modulation_of_a_modulated_tone_is_what_it_was_modulated_by() {
    let tone = |depth: f64, hz: f64| {
        let tone = made(50_000, |n| (1.0 + depth * turn(hz, n).sin()) * turn(300.0, n).sin());
        measures(&tone).modulation
    };
    near(tone(0.5, 20.0), 0.5 / 2f64.sqrt(), 0.01);
    near(tone(0.2, 50.0), 0.2 / 2f64.sqrt(), 0.01);
    assert!(tone(0.5, 2.0).unwrap() < 0.05);
    assert!(tone(0.5, 150.0).unwrap() < 0.02);
}

#[test]
fn the_line_is_the_strongest_and_its_range_that_of_its_amplitude() {
    let ground = portable_noise(51, 30_000);
    let stepped = made(ground.len(), |n| {
        let amplitude = if n < 15_000 { 4.0 } else { 2.0 };
        0.05 * ground[n] + amplitude * turn(171.0, n).sin() + 0.8 * turn(412.0, n).sin()
    });
    let line_hz = strongest_line_hz(&[&stepped], RATE_HZ);
    near(line_hz, 171.0, 2e-3);
    let of = |near_hz| Liveliness::of(&[&stepped], RATE_HZ, Some(near_hz)).line_range_db;
    near(of(171.0), 20.0 * 2f64.log10(), 0.02);
    // The line of another signal is sought near the same frequency.
    near(of(168.0), 20.0 * 2f64.log10(), 0.02);
    assert!(of(412.0).unwrap() < 0.2);
    // A tone that is made from filtered noise fluctuates.
    let tone = test_helpers::resonant(ground, TAU * 171.0 / RATE_HZ, 0.9998);
    let found = Liveliness::of(&[&tone], RATE_HZ, strongest_line_hz(&[&tone], RATE_HZ));
    assert!(found.line_range_db.unwrap() > 3.0, "{found:?}");
}

#[test]
fn nothing_is_measured_of_silence_of_one_value_and_of_too_few_samples() {
    for signal in [
        vec![],
        vec![0.0; 10_000],
        vec![3.7; 10_000],
        vec![-1e300; 300],
        vec![5.0],
    ] {
        assert_eq!(measures(&signal), Liveliness::default());
        assert_eq!(strongest_line_hz(&[&signal], RATE_HZ), None);
    }
    assert_eq!(Liveliness::of(&[], RATE_HZ, Some(100.0)), Liveliness::default());
    let short = measures(&portable_noise(1, 400));
    assert!(short.kurtosis.is_some(), "{short:?}");
    assert!(short.modulation.is_none(), "{short:?}");
    assert_eq!(short.level_spread_db, None);
}

#[test]
fn a_dropout_counts_for_sixty_decibels_and_not_for_infinity() {
    let noise = portable_noise(61, 10_000);
    // This noise has a mean of zero, so that the silent part stays silent.
    let mut signal = made(10_000, |n| noise[n / 2] * if n % 2 == 0 { 1.0 } else { -1.0 });
    signal[2500..5000].fill(0.0);
    let found = measures(&signal);
    let spread_db = found.level_spread_db.unwrap();
    // A quarter of all windows is 60 dB below the mean of all windows.
    let expected = (0.25f64 * 0.75).sqrt() * (60.0 + 10.0 * (4.0f64 / 3.0).log10());
    test_helpers::near(spread_db, expected, 0.3);
}

#[test]
fn blocks_are_measured_together_and_no_window_crosses_a_join() {
    let (low, high) = (portable_noise(81, 10_000), portable_noise(82, 10_000));
    let high: Vec<f64> = high.iter().map(|x| 10.0 * x).collect();
    let found = Liveliness::of(&[&low, &high], RATE_HZ, None);
    near(found.level_spread_db, 10.0, 0.01);
    // The samples are Gaussian with variances 1 and 100, in equal numbers.
    near(found.kurtosis, 3.0 * 0.5 * (1.0 + 1e4) / 50.5f64.powi(2), 0.05);
}

proptest! {
    #[test]
    fn measures_do_not_depend_on_gain_sign_or_offset(
        seed in 0u64..10_000,
        log_gain in -6.0..6.0f64,
        offset in -3.0..3.0f64,
    ) {
        let signal = portable_noise(seed, 5000);
        let gain = 10f64.powf(log_gain);
        let other: Vec<f64> = signal.iter().map(|x| -gain * (x + offset)).collect();
        let (a, b) = (measures(&signal), measures(&other));
        for (a, b) in [
            (a.kurtosis, b.kurtosis),
            (a.residual_kurtosis, b.residual_kurtosis),
            (a.crest_factor, b.crest_factor),
            (a.modulation, b.modulation),
            (a.level_spread_db, b.level_spread_db),
        ] {
            prop_assert!((a.unwrap() / b.unwrap() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn any_signal_has_finite_measures_or_none(
        values in prop::collection::vec(prop::sample::select(vec![0.0, 1.0, -1.0, 1e-9, 1e9, 1e-200, 1e150]), 0..6000),
        cut in 0usize..6000,
    ) {
        let (a, b) = values.split_at(cut.min(values.len()));
        let line_hz = strongest_line_hz(&[a, b], RATE_HZ);
        let found = Liveliness::of(&[a, b], RATE_HZ, line_hz.or(Some(100.0)));
        let all = [
            found.kurtosis, found.residual_kurtosis, found.crest_factor,
            found.modulation, found.level_spread_db, found.line_range_db, line_hz,
        ];
        prop_assert!(all.iter().flatten().all(|value| value.is_finite()), "{:?}", found);
    }
}
