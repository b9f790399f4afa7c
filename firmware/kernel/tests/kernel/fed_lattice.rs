//! Filters in the steps of a fed excitation: accuracy, peaks, energy.

use std::f64::consts::PI;

use model_format::limits::MAX_ORDER;
use stylus_hard_cases::{Deviation, FloatLattice};
use stylus_kernel::Synthesis;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::feed::{FED_FRACTION_BITS, FED_HEADROOM_BITS};
use stylus_kernel::lattice::LatticeState;

use crate::fed::{alternating, bare_of, encoded, excitation, impulsive, of, spikes, values};
use crate::models::{Model, fixtures, motion, rotation, texture, texture_of};

const SIGMA: f64 = (1u32 << FED_FRACTION_BITS) as f64;

/// Plays 12 s. The state begins like a texture's.
#[test]
fn noise_of_the_arithmetic_is_90_db_below_the_signal_with_a_fed_excitation() {
    for model in fixtures() {
        let rotations = model.rotations();
        let mut source = Excitation::new(2);
        let mut state = LatticeState::fed_stationary(MAX_ORDER, &mut source);
        let mut reference = FloatLattice::new(MAX_ORDER);
        reference.rotate_by(&rotations);
        reference.begin(state.backward(MAX_ORDER));
        let mut deviation = Deviation::default();
        for _ in 0..60_000 {
            let excitation = source.next_sample() >> FED_HEADROOM_BITS;
            let output = state.filter::<Portable>(&rotations, excitation);
            deviation.add(reference.filter(f64::from(excitation)), f64::from(output));
        }
        let snr_db = deviation.snr_db();
        assert!(snr_db > 90.0, "{}: SNR {snr_db} dB", model.name);
    }
}

/// The largest signal of any stage, standard deviations.
fn largest_signal(model: &Model, excitation: impl IntoIterator<Item = f64>) -> f64 {
    let rotations = model.rotations();
    let mut state = LatticeState::fed_stationary(MAX_ORDER, &mut Excitation::new(4));
    let mut largest = 0;
    for x in excitation {
        state.filter::<Portable>(&rotations, (x * SIGMA) as i32);
        let signals = state.backward(MAX_ORDER).iter().map(|g| g.unsigned_abs());
        largest = signals.fold(largest, u32::max);
    }
    f64::from(largest) / SIGMA
}

/// Full scale is 64. The lattice's signals have at most the energy of the excitation, so that an impulse adds at most
/// itself to a signal of variance 1.
#[test]
fn impulses_of_40_standard_deviations_do_not_saturate_the_fixtures() {
    for model in fixtures() {
        // Impulses of both signs, as often as a variance of 1 allows, and four times as often.
        for every in [1600, 400] {
            let impulses = (0..20_000).map(|n| match (n % every, n / every % 2) {
                (100, 0) => 40.0,
                (100, _) => -40.0,
                _ => 0.0,
            });
            let largest = largest_signal(&model, impulses);
            assert!(largest < 48.0, "{}: {largest}", model.name);
        }
        // Two impulses of the same sign, 1, 2 or 7 samples apart.
        for gap in [1, 2, 7] {
            let impulses = (0..3000).map(|n| if n == 100 || n == 100 + gap { 32.0 } else { 0.0 });
            let largest = largest_signal(&model, impulses);
            assert!(largest < 63.9, "{}: {largest} at a gap of {gap}", model.name);
        }
    }
}

/// Plays a minute of each.
#[test]
fn codebooks_with_the_highest_peaks_do_not_saturate_the_fixtures() {
    let steep = spikes();
    assert!(steep.peak > 37.0 && values(&steep).iter().any(|x| x.abs() > 37.0));
    for model in fixtures() {
        for codebook in [steep.clone(), impulsive(8192)] {
            let mut spec = texture_of("fed", &model.node(4.0));
            spec.parts = of(vec![codebook], [1; 4]);
            let bytes = encoded(spec);
            let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), 1);
            for _ in 0..30_000 {
                synthesis.follow(motion(75.0, 0.75), 10);
                for _ in 0..10 {
                    synthesis.next_sample();
                }
            }
            assert_eq!(synthesis.saturations(), 0, "{}", model.name);
        }
    }
}

/// The worst codebook that a library can have: a single spectral line, on a pole just inside the unit circle. Snippets
/// play it on for ever, and no bound of its density is below full scale. The state then reaches full scale but does not
/// exceed it, and decays afterwards. Plays ten minutes.
#[test]
fn a_tone_on_a_resonance_saturates_and_dies_away_after_it() {
    let bytes = bare_of(vec![alternating([0; 400])], [1; 4]);
    let pole = rotation((0.9999_f64.asin() / PI * 65_536.0) as i16);
    let mut state = LatticeState::fed_stationary(1, &mut Excitation::new(4));
    let (mut power, mut largest) = (0.0, 0.0f64);
    let samples = 3_000_000;
    for x in excitation(&texture(&bytes), 3).take(samples) {
        let output = f64::from(state.filter::<Portable>(&[pole], (x * SIGMA) as i32)) / SIGMA;
        power += output * output / samples as f64;
        largest = largest.max(output.abs());
    }
    assert!(power.sqrt() > 20.0, "{power}");
    assert!(largest <= 64.0, "{largest}");
    assert_eq!(
        (0..300_000).map(|_| state.filter::<Portable>(&[pole], 0)).last(),
        Some(0)
    );
}
