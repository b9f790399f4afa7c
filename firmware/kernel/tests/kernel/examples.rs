//! The examples of `examples/`, run and judged.

use model_format::{Library, OutputSample, SAMPLE_RATE_HZ, Texture};
use proptest::prelude::*;
use stylus_kernel::excitation::{Excitation, FRACTION_BITS};
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::models::motion;
use custom_structure::{CoupledFrame, CoupledState, rms};

/// A structure of one's own.
#[path = "../../examples/custom_structure.rs"]
#[allow(dead_code, reason = "its `main` is not called")]
mod custom_structure;
/// The kernel in forty lines.
#[path = "../../examples/forty_lines.rs"]
#[allow(dead_code, reason = "its `main` is not called")]
mod forty_lines;

fn bell(bytes: &[u8]) -> Texture<'_> {
    let library = Library::decode(bytes).unwrap();
    library.texture("bell").unwrap()
}

#[test]
fn forty_lines_play_what_the_kernel_plays_sample_by_sample() {
    let bytes = custom_structure::library().unwrap();
    let moving = |sample: usize| motion(50.0 + sample as f32 / 50.0, 1.0);
    let mut played = vec![OutputSample::SILENCE; 5003];
    forty_lines::play(&bytes, moving, &mut played).unwrap();
    let mut synthesis: Synthesis = Synthesis::new(bell(&bytes), 1);
    for (sample, &output) in played.iter().enumerate() {
        if sample % UPDATE_INTERVAL_SAMPLES as usize == 0 {
            let left = (played.len() - sample) as u32;
            synthesis.follow(moving(sample), left.min(UPDATE_INTERVAL_SAMPLES));
        }
        assert_eq!(output, synthesis.next_sample(), "sample {sample}");
    }
    assert!(rms(&played) > 0.5);
    forty_lines::play(&bytes, |_| Motion::REST, &mut played).unwrap();
    assert!(played.iter().all(|&output| output == OutputSample::SILENCE));
    assert!(forty_lines::play(&bytes[..9], |_| Motion::REST, &mut played).is_err());
    let text = include_str!("../../examples/forty_lines.rs");
    let code = text.lines().filter(|line| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with("//")
    });
    assert!(code.count() <= 40);
}

/// The recursion of the definition in float64, with θ as stored.
fn by_definition(texture: &Texture<'_>, speed: usize, samples: usize) -> Vec<f64> {
    let node = texture.node(speed, 0);
    let k: Vec<f64> = (node.coefficients.thetas())
        .map(|theta| (f64::from(theta) / f64::from(1 << 23) * std::f64::consts::FRAC_PI_2).sin())
        .collect();
    let (a1, a2) = (k[0] * (1.0 + k[1]), k[1]);
    let scale = (f64::from(node.output_power) * (1.0 - k[0] * k[0]) * (1.0 - a2 * a2)).sqrt();
    let mut noise = Excitation::new(1);
    let (mut last, mut before) = (0.0, 0.0);
    let next = |_| {
        let e = f64::from(noise.next_sample()) / f64::from(1u32 << FRACTION_BITS);
        let next = scale * e - a1 * last - a2 * before;
        (before, last) = (last, next);
        next
    };
    (0..samples).map(next).collect()
}

#[test]
fn a_structure_of_ones_own_plays_the_model_one_sample_later() {
    const SAMPLES: usize = 50_000;
    /// Samples while the level's ramp goes up, and until what was played in it has rung out.
    const START: usize = 500;
    let bytes = custom_structure::library().unwrap();
    let texture = bell(&bytes);
    for (index, speed) in [50.0, 150.0].into_iter().enumerate() {
        let played = custom_structure::play(&texture, 1, |_| motion(speed, 1.0), SAMPLES);
        let exact = by_definition(&texture, index, SAMPLES);
        let (mut error, mut power) = (0.0, 0.0);
        for n in START..SAMPLES {
            let sample = f64::from(played[n].metres_per_second_squared().0);
            error += (sample - exact[n - 1]).powi(2);
            power += exact[n - 1].powi(2);
        }
        let snr_db = 10.0 * (power / error).log10();
        assert!(snr_db > 80.0, "{speed} mm/s: {snr_db:.1} dB");
    }
}

#[test]
fn a_structure_of_ones_own_has_the_lattices_level_between_nodes_and_its_silence() {
    let bytes = custom_structure::library().unwrap();
    let texture = bell(&bytes);
    let seconds = 20 * SAMPLE_RATE_HZ as usize;
    for speed in [25.0, 50.0, 90.0, 150.0, 400.0] {
        let own = custom_structure::play(&texture, 3, |_| motion(speed, 1.0), seconds);
        let mut synthesis: Synthesis = Synthesis::new(texture, 4);
        let mut lattice = vec![OutputSample::SILENCE; seconds];
        for block in lattice.chunks_mut(UPDATE_INTERVAL_SAMPLES as usize) {
            synthesis.follow(motion(speed, 1.0), UPDATE_INTERVAL_SAMPLES);
            synthesis.next_block(block);
        }
        let ratio = rms(&own) / rms(&lattice);
        assert!((ratio - 1.0).abs() < 0.05, "{speed} mm/s: {ratio}");
    }
    let at_rest = custom_structure::play(&texture, 3, |_| Motion::REST, 1000);
    assert!(
        at_rest
            .iter()
            .all(|&output| output == OutputSample::SILENCE)
    );
}

proptest! {
    #[test]
    fn without_noise_its_state_never_grows_and_ends_however_the_motion_jumps(
        speeds in prop::collection::vec(1.0f32..400.0, 60),
        seed: u64,
    ) {
        let bytes = custom_structure::library().unwrap();
        let texture = bell(&bytes);
        let (mut frame, mut state) = (CoupledFrame::silent(), CoupledState::default());
        let mut noise = Excitation::new(seed);
        frame.update(&texture, motion(100.0, 1.0), 0, 1);
        for _ in 0..200 {
            state.next_sample(&frame, noise.next_sample(), 0);
        }
        let mut norm = state.norm();
        for speed in speeds {
            frame.update(&texture, motion(speed, 1.0), 0, UPDATE_INTERVAL_SAMPLES);
            for left in (0..UPDATE_INTERVAL_SAMPLES).rev() {
                state.next_sample(&frame, 0, left);
                prop_assert!(state.norm() <= norm);
                norm = state.norm();
            }
        }
        prop_assert_eq!(norm, 0.0);
    }
}
