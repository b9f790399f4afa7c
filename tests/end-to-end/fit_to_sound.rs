//! A known process recorded, fitted, stored and played by the device's kernel comes back as the same process.

mod support;

use host_tools::dsp::spectrum::{band_edges_hz, band_powers};
use host_tools::fit;
use host_tools::fit::Order;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::render;
use host_tools::recording::RecordingSet;
use host_tools::texture::quantise::StructureChoice;
use model_format::{Library, MillimetresPerSecond, Newton};
use support::{Bench, RATE_HZ, all_pole, noise, wav};

const SECONDS: f64 = 60.0;

/// A process given by its poles: (frequency in Hz, radius), each with its conjugate.
fn predictor(poles: &[(f64, f64)]) -> Vec<f64> {
    let mut polynomial = vec![1.0];
    for &(frequency_hz, radius) in poles {
        let angle = core::f64::consts::TAU * frequency_hz / f64::from(RATE_HZ);
        let factor = [1.0, -2.0 * radius * angle.cos(), radius * radius];
        let mut product = vec![0.0; polynomial.len() + 2];
        for (i, p) in polynomial.iter().enumerate() {
            for (j, f) in factor.iter().enumerate() {
                product[i + j] += p * f;
            }
        }
        polynomial = product;
    }
    polynomial.split_off(1)
}

/// Power of the process between two frequencies, for excitation of unit variance.
fn power_between(a: &[f64], low_hz: f64, high_hz: f64) -> f64 {
    const STEPS: usize = 2000;
    let step_hz = (high_hz - low_hz) / STEPS as f64;
    let density = |frequency_hz: f64| {
        let angle = core::f64::consts::TAU * frequency_hz / f64::from(RATE_HZ);
        let (mut re, mut im) = (1.0, 0.0);
        for (i, a) in a.iter().enumerate() {
            re += a * (angle * (i + 1) as f64).cos();
            im -= a * (angle * (i + 1) as f64).sin();
        }
        2.0 / f64::from(RATE_HZ) / (re * re + im * im)
    };
    let middles = (0..STEPS).map(|n| low_hz + (n as f64 + 0.5) * step_hz);
    middles.map(density).sum::<f64>() * step_hz
}

fn decibels(ratio: f64) -> f64 {
    10.0 * ratio.log10()
}

#[test]
fn bands_come_back_within_one_decibel_and_the_level_within_a_fifth() {
    // No band is weaker than the leakage of a rectangular window from the strongest line; see `Autocorrelation`.
    let processes = [
        ("broad", vec![(200.0, 0.6), (900.0, 0.5)]),
        ("resonant", vec![(70.0, 0.98), (420.0, 0.95), (1200.0, 0.8)]),
        ("woven", vec![(120.0, 0.97), (480.0, 0.95), (1000.0, 0.9)]),
    ];
    for (seed, (name, poles)) in (1..).zip(processes) {
        let a = predictor(&poles);
        let samples = (SECONDS * f64::from(RATE_HZ)) as usize;
        let signal: Vec<f64> = all_pole(&a, &noise(seed, samples))
            .iter()
            .map(|x| 0.05 * x)
            .collect();
        let bench = Bench::new();
        bench.write("process.wav", wav(&[&signal], RATE_HZ));
        let mut set = RecordingSet::open(&[bench.path("process.wav")]).unwrap();
        set.trials[0].duration_s = Some(SECONDS);
        for structure in [StructureChoice::Lattice, StructureChoice::Direct] {
            for order in [Order::Auto, Order::Fixed(400)] {
                let options = fit::Options {
                    order,
                    structure,
                    ..fit::Options::default()
                };
                let fit = fit::fit(&set, &options, || ()).unwrap();
                let bytes = model_format::encode(&fit.specs).unwrap();
                let library = Library::decode(&bytes).unwrap();
                let texture = library.textures().next().unwrap();
                let motion =
                    MotionPath::constant(MillimetresPerSecond(100.0), Newton(1.0)).unwrap();
                let rendered = render(texture, &motion, SECONDS + 1.0, 7).unwrap();
                assert_eq!(rendered.saturations, 0);
                let played = rendered.accelerations_m_s2().split_off(RATE_HZ as usize);
                let case = format!("{name}, {structure:?}, {order:?}");

                let mean_square = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
                let level = decibels(mean_square(&played) / mean_square(&signal));
                assert!(level.abs() < 0.2, "{case}: level {level} dB");

                let bands = band_powers(&played, f64::from(RATE_HZ));
                for (band, power) in bands.into_iter().enumerate() {
                    let (low_hz, high_hz) = band_edges_hz(band);
                    let expected = 0.05f64.powi(2) * power_between(&a, low_hz, high_hz);
                    let error = decibels(power / expected);
                    assert!(error.abs() < 1.0, "{case}: {low_hz:.0} Hz band {error} dB");
                }
            }
        }
    }
}
