use std::f64::consts::TAU;

use proptest::prelude::*;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use test_helpers::near;

const RATE_HZ: f64 = 5000.0;

/// Makes samples with taps of one frequency and decay in noise; `taps` holds the onset (s) and amplitude of each.
fn made(frequency_hz: f64, decay_s: f64, taps: &[(f64, f64)], noise_rms: f64, seed: u64) -> Vec<f64> {
    let end_s = taps.last().unwrap().0 + 0.5;
    let generator = rand_pcg::Pcg64::seed_from_u64(seed);
    let noise: Vec<f64> = StandardNormal
        .sample_iter(generator)
        .take((end_s * RATE_HZ) as usize)
        .collect();
    let at = |time_s: f64| -> f64 {
        taps.iter()
            .filter(|(begin_s, _)| time_s >= *begin_s)
            .map(|(begin_s, amplitude)| {
                let t = time_s - begin_s;
                amplitude * (-t / decay_s).exp() * (TAU * frequency_hz * t).sin()
            })
            .sum()
    };
    noise
        .iter()
        .enumerate()
        .map(|(n, e): (usize, &f64)| at(n as f64 / RATE_HZ) + noise_rms * e)
        .collect()
}

fn recording(samples_m_s2: Vec<f64>) -> Taps {
    Taps {
        name: "made".into(),
        samples_m_s2,
        rate_hz: RATE_HZ,
        force_n: None,
        is_outlier: Vec::new(),
        force_rate_n_s: None,
        is_simulated: true,
        notes: Vec::new(),
    }
}

/// Noise just before the onset is above the threshold, so that the onset seems one sample earlier.
#[test]
fn noise_at_the_onset_does_not_spoil_the_fit() {
    let (frequency_hz, decay_s) = (673.002_495_331_562_7, 0.003);
    let samples = made(frequency_hz, decay_s, &[(0.2, 1.0)], 0.01, 6_106_194_692_089_818_276);
    assert_eq!(onsets(&samples, RATE_HZ), [999]);
    let found = TapFit::new(&[recording(samples)]).unwrap();
    assert_eq!(found.impacts[0].time_s, 0.2);
    near(found.decay_s / decay_s, 1.0, 0.03);
    near(found.impacts[0].amplitude_m_s2, 1.0, 0.03);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn a_tap_in_noise_is_found_with_its_frequency_decay_and_amplitude(
        frequency_hz in 60.0..900.0f64, cycles in 1.5..12.0f64, amplitude in 1.0..100.0f64, seed: u64,
    ) {
        let decay_s = (cycles / frequency_hz).clamp(0.003, 0.06);
        // 40 dB below the amplitude.
        let samples = made(frequency_hz, decay_s, &[(0.2, amplitude)], 0.01 * amplitude, seed);
        let found = TapFit::new(&[recording(samples)]).unwrap();
        prop_assert_eq!(found.impacts.len(), 1);
        prop_assert!((found.impacts[0].time_s - 0.2).abs() < 0.0025, "{:?}", found);
        prop_assert!((found.frequency_hz / frequency_hz - 1.0).abs() < 0.03, "{:?}", found);
        prop_assert!((found.decay_s / decay_s - 1.0).abs() < 0.12, "{:?}", found);
        let amplitude_found = found.impacts[0].amplitude_m_s2;
        prop_assert!((amplitude_found / amplitude - 1.0).abs() < 0.15, "{:?}", found);
        prop_assert!(found.impacts[0].residual < 0.05, "{:?}", found);
    }

    #[test]
    fn any_signal_is_fitted_or_left_out(samples in prop::collection::vec(-1e3..1e3f64, 0..400)) {
        if let Ok(found) = TapFit::new(&[recording(samples)]) {
            prop_assert!(found.frequency_hz.is_finite() && found.decay_s.is_finite());
            prop_assert!(found.limit_m_s2.is_finite() && found.limit_m_s2 > 0.0);
        }
    }
}

#[test]
fn a_decaying_sine_without_noise_is_found_exactly() {
    let window: Vec<f64> = (0..1000)
        .map(|n| {
            let t = f64::from(n) / RATE_HZ;
            20.0 * (-t / 0.011).exp() * (TAU * 237.0 * t + 0.4).sin()
        })
        .collect();
    let found = fit(&window, RATE_HZ);
    near(found.frequency_hz, 237.0, 1e-6);
    near(found.decay_s, 0.011, 1e-9);
    near(found.amplitude, 20.0, 1e-6);
    near(found.phase_rad, 0.4, 1e-6);
    assert!(found.residual < 1e-12, "{found:?}");
}

#[test]
fn amplitudes_over_rates_of_force_give_the_gain() {
    let taps: Vec<(f64, f64)> = (1..=6).map(|n| (0.4 * f64::from(n), 5.0 * f64::from(n))).collect();
    let samples = made(240.0, 0.012, &taps, 0.05, 7);
    // The force rises over 4 ms at each impact and falls after 100 ms: 20 N/s for the first impact, 40 for the second
    // ...
    let rate = |n: usize| 20.0 * (n as f64 + 1.0);
    let force_n: Vec<f64> = (0..samples.len())
        .map(|at| {
            let time_s = at as f64 / RATE_HZ;
            taps.iter()
                .rposition(|(begin_s, _)| time_s >= *begin_s)
                .map_or(0.0, |n| {
                    let since_s = time_s - taps[n].0;
                    if since_s < 0.1 {
                        rate(n) * since_s.min(0.004)
                    } else {
                        0.0
                    }
                })
        })
        .collect();
    let taps = Taps {
        force_n: Some(force_n),
        ..recording(samples)
    };
    let found = TapFit::new(&[taps]).unwrap();
    assert_eq!(found.impacts.len(), 6, "{found:?}");
    for (n, impact) in found.impacts.iter().enumerate() {
        // A force that rises over two intervals rises over at least one whole interval.
        let share = impact.force_rate_n_s.unwrap() / rate(n);
        assert!((0.9..=1.01).contains(&share), "{impact:?}");
    }
    let gain = found.gain_m_s2_per_n_s.unwrap();
    for impact in &found.impacts {
        let played = gain * impact.force_rate_n_s.unwrap();
        near(played / impact.amplitude_m_s2, 1.0, 0.6);
    }
    assert!(found.gain_scatter.unwrap() < 0.1, "{found:?}");
    near(found.limit_m_s2 / 37.5, 1.0, 0.05);
}

#[test]
fn noise_and_silence_have_no_taps() {
    let noise = made(100.0, 0.01, &[(0.2, 0.0)], 1.0, 3);
    assert!(TapFit::new(&[recording(noise)]).is_err());
    assert!(TapFit::new(&[recording(vec![0.0; 5000])]).is_err());
    assert!(TapFit::new(&[recording(Vec::new())]).is_err());
}

/// A value out of range was read as 0, which is a click in a recording with an offset.
#[test]
fn an_impact_near_a_value_out_of_range_is_left_out() {
    let taps = [(0.2, 10.0), (0.8, 10.0), (1.4, 10.0)];
    let mut samples = made(300.0, 0.01, &taps, 0.02, 5);
    let mut is_outlier = vec![false; samples.len()];
    for at in [4010, 5500, 6985] {
        (samples[at], is_outlier[at]) = (-9.8, true);
    }
    let taps = Taps {
        is_outlier,
        ..recording(samples)
    };
    let found = TapFit::new(&[taps]).unwrap();
    let times_s: Vec<f64> = found
        .impacts
        .iter()
        .filter(|impact| impact.left_out.is_none())
        .map(|impact| impact.time_s)
        .collect();
    assert_eq!(times_s.len(), 1, "{found:?}");
    near(times_s[0], 0.2, 1e-3);
}

#[test]
fn a_click_is_left_out_and_does_not_count() {
    let mut samples = made(300.0, 0.01, &[(0.2, 10.0), (0.8, 10.0)], 0.02, 5);
    // A burst of noise, louder than the taps.
    let burst = made(300.0, 0.01, &[(0.2, 0.0)], 8.0, 9);
    for (sample, extra) in samples[2500..2900].iter_mut().zip(burst) {
        *sample += extra;
    }
    let found = TapFit::new(&[recording(samples)]).unwrap();
    let left_out: Vec<bool> = found.impacts.iter().map(|i| i.left_out.is_some()).collect();
    assert_eq!(left_out, [false, true, false], "{found:?}");
    near(found.frequency_hz, 300.0, 3.0);
}
