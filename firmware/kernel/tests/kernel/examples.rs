//! The example, run and judged.

use model_format::{OutputSample, encode};
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::models::{motion, texture};
use crate::scenes::resonant;

/// The kernel in forty lines.
#[path = "../../examples/forty_lines.rs"]
#[allow(dead_code, reason = "its `main` is not called")]
mod forty_lines;

#[test]
fn forty_lines_play_what_the_kernel_plays_sample_by_sample() {
    let bytes = encode(&[resonant("bell", 110.0)]).unwrap();
    let moving = |sample: usize| motion(50.0 + sample as f32 / 50.0, 1.0);
    let mut played = vec![OutputSample::SILENCE; 5003];
    forty_lines::play(&bytes, moving, &mut played).unwrap();
    let mut synthesis: Synthesis = Synthesis::new(texture(&bytes), 1);
    for (sample, &output) in played.iter().enumerate() {
        if sample % UPDATE_INTERVAL_SAMPLES as usize == 0 {
            let left = (played.len() - sample) as u32;
            synthesis.follow(moving(sample), left.min(UPDATE_INTERVAL_SAMPLES));
        }
        assert_eq!(output, synthesis.next_sample(), "sample {sample}");
    }
    assert!(
        played
            .iter()
            .any(|output| output.0.abs() > 1 << OutputSample::FRACTION_BITS)
    );
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
