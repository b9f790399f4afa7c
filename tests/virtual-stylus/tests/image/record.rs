//! Recording: no sample is lost or changed, and all are taken at exact instants.

use model_format::link::{BLOCK_SAMPLES, RecordSample};
use virtual_stylus::Options;
use virtual_stylus::model::adc::Sample;

use crate::device::{Device, MS, PERIOD_NS, SECOND, recording_s};

/// A code by which ticks and channels within a second can be told apart.
fn code(channel: u8, at_ns: u64) -> u16 {
    let tick = at_ns / PERIOD_NS;
    (tick
        .wrapping_mul(40_503)
        .wrapping_add(u64::from(channel) * 9_973)
        >> 3) as u16
}

/// The codes of the sequence that a trigger started: X, Y, Z and force in their ranks.
fn sequences(samples: &[Sample]) -> Vec<[Sample; 4]> {
    let first = samples
        .iter()
        .position(|sample| sample.rank == 0)
        .expect("a whole sequence");
    samples[first..].as_chunks().0.to_vec()
}

#[test]
fn a_recording_holds_what_was_on_the_pins_at_instants_200_microseconds_apart() {
    let mut device = Device::started(Options::default());
    device.set_pins(code);
    device.move_at(150.0);
    device.run_for(5 * MS);
    device.stylus.record_samples();
    device.run_for(5 * MS);
    device.record();
    device.run_for(recording_s() * SECOND);
    let stopped = device.stop_recording();
    assert_eq!(stopped.lost_blocks, 0);
    assert_eq!(device.status().tick.missed, 0);

    let blocks = &device.blocks;
    assert_eq!(blocks.len(), stopped.blocks as usize);
    assert!(blocks.len() as u64 * BLOCK_SAMPLES as u64 >= recording_s() * 5_000 - 100);
    device.assert_whole();
    let recorded = device.samples();

    let converted = sequences(&device.stylus.take_samples());
    let sampled = |sample: &RecordSample| {
        let [x, y, z] = sample.acceleration.map(|code| code.0);
        [x, y, z, sample.force.0]
    };
    let words = |sequence: &[Sample; 4]| sequence.map(|sample| sample.word);
    // The recording begins somewhere in the converted samples; from there on the two are equal.
    let begin = (converted.iter())
        .position(|sequence| words(sequence) == sampled(&recorded[0]))
        .expect("the first sample was on the pins");
    for (n, (sequence, sample)) in converted[begin..].iter().zip(&recorded).enumerate() {
        assert_eq!(words(sequence), sampled(sample), "sample {n}");
        for pin in sequence {
            assert_eq!(pin.word, code(pin.channel, pin.at_ns), "sample {n}");
        }
    }
    let uneven = (converted.windows(2))
        .flat_map(|pair| (0..4).map(|rank| pair[1][rank].at_ns - pair[0][rank].at_ns))
        .find(|&apart| apart != PERIOD_NS);
    assert_eq!(uneven, None);
    // 150 mm/s at 0.01 mm per count are three counts per tick.
    let counts: i64 = recorded
        .iter()
        .map(|sample| i64::from(sample.encoder_delta).abs())
        .sum();
    let expected = 3 * recorded.len() as i64;
    assert!(
        (counts - expected).abs() <= 3,
        "{counts} counts of {expected}"
    );
}
