//! Recording: no sample is lost or changed, and all are taken at exact instants.

use model_format::link::{BLOCK_SAMPLES, RecordSample, RecordStartEndpoint, RecordStopEndpoint};
use virtual_stylus::Options;
use virtual_stylus::model::adc::Sample;
use virtual_stylus::motion::Motion;
use virtual_stylus::pins::FunctionPins;

use crate::device::{Device, MS, PERIOD_NS, SECOND};

/// Length of the recording, s; a minute if `STYLUS_LONG` is set.
fn seconds() -> u64 {
    if std::env::var_os("STYLUS_LONG").is_some() {
        60
    } else {
        10
    }
}

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
    device
        .stylus
        .set_pins(FunctionPins(code))
        .expect("the run goes on");
    device
        .stylus
        .set_motion(Motion::steady(150.0, 0.01))
        .expect("the run goes on");
    device.run_for(5 * MS);
    device.stylus.record_samples().expect("the run goes on");
    device.run_for(5 * MS);
    device.keep_alive(true);
    device
        .request::<RecordStartEndpoint>(&())
        .expect("nothing is recorded");
    device.run_for(seconds() * SECOND);
    let stopped = device
        .request::<RecordStopEndpoint>(&())
        .expect("it is recorded");
    device.run_for(50 * MS);
    assert_eq!(stopped.lost_blocks, 0);
    assert_eq!(device.status().tick.missed, 0);
    assert_eq!(device.broken, 0);

    let blocks = &device.blocks;
    assert_eq!(blocks.len(), stopped.blocks as usize);
    assert!(blocks.len() as u64 * BLOCK_SAMPLES as u64 >= seconds() * 5_000 - 100);
    for (number, block) in blocks.iter().enumerate() {
        assert_eq!(block.sequence as usize, number);
        assert_eq!(
            block.first_tick,
            blocks[0].first_tick + (number * BLOCK_SAMPLES) as u64
        );
        assert_eq!(block.lost_blocks, 0);
    }
    let recorded: Vec<RecordSample> = (blocks.iter())
        .flat_map(|block| block.samples.map(Into::into))
        .collect();

    let converted = sequences(&device.stylus.take_samples().expect("the run goes on"));
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
