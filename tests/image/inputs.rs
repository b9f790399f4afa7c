//! Recorded inputs: no sample is lost or changed, and all are taken at exact instants. Late ticks are reported, and
//! interference on the encoder's wires does not count.

use hil::checks::faults::Injected;
use model_format::link::{BLOCK_SAMPLES, RecordSample};
use stylus_board::{ALL, Board};
use virtual_stylus::Options;
use virtual_stylus::model::adc::Sample;
use virtual_stylus::motion::Motion;

use crate::device::{Device, MS, PERIOD_NS, SECOND, inject, recording_s};

/// A code that identifies the trigger and the channel.
fn code(channel: u8, at_ns: u64) -> u16 {
    let tick = at_ns / 200_000;
    (tick.wrapping_mul(40_503).wrapping_add(u64::from(channel) * 9_973) >> 3) as u16
}

/// REV_ID of silicon that halves the converter's clock, and of silicon that does not (section 60.5.8).
const REVISIONS: [u16; 2] = [0x2003, 0x1003];

/// Records on silicon of `revision` while an injected `section` delays ticks, 20 times. Returns for each sample the
/// index of the converter's row that it equals, if it equals one, and whether it is marked as whole. Returns the number
/// of late conversions in the status, too.
fn recorded_with(section: Injected, revision: u16) -> (Vec<(Option<usize>, bool)>, u32) {
    let mut options = Options::default();
    options.electrical.revision = revision;
    let mut device = Device::with_faults(options);
    device.set_pins(code);
    device.run_for(5 * MS);
    device.stylus.record_samples();
    device.record();
    let late_before = device.status().tick.late_conversions;
    for _ in 0..20 {
        inject(&mut device, section);
        device.run_for(7 * MS);
    }
    device.run_for(20 * MS);
    let late = device.status().tick.late_conversions - late_before;
    device.stop_recording();
    device.run_for(20 * MS);
    let converted = device.stylus.take_samples();
    let first = converted.iter().position(|sample| sample.rank == 0);
    let rows: Vec<[u16; 4]> = (converted[first.expect("a row")..].as_chunks::<4>().0.iter())
        .map(|row| row.map(|sample| sample.word))
        .collect();
    let samples = device.blocks.iter().flat_map(|block| {
        (0..BLOCK_SAMPLES).map(|index| {
            let sample = RecordSample::from(block.samples[index]);
            let [x, y, z] = sample.acceleration.map(|code| code.0);
            let words = [x, y, z, sample.force.0];
            (rows.iter().position(|row| *row == words), block.is_whole(index))
        })
    });
    (samples.collect(), late)
}

#[test]
fn a_tick_that_is_25_microseconds_late_reads_the_row_of_its_trigger() {
    for revision in REVISIONS {
        let (samples, late) = recorded_with(Injected::ShortSection, revision);
        assert_eq!(late, 0);
        for (pair, (row, is_whole)) in samples.windows(2).zip(&samples[1..]) {
            assert!(*is_whole);
            let before = pair[0].0.unwrap_or_else(|| panic!("torn on revision {revision:#x}"));
            assert_eq!(*row, Some(before + 1), "each sample is the row after the one before");
        }
    }
}

#[test]
fn a_row_that_a_later_tick_reads_is_marked_and_every_other_one_is_whole() {
    for revision in REVISIONS {
        let (samples, late) = recorded_with(Injected::LongSection, revision);
        let marked = samples.iter().filter(|(_, is_whole)| !is_whole).count();
        assert!((15..=20).contains(&marked), "{marked}");
        assert!(late as usize >= marked, "{late} {marked}");
        for (row, is_whole) in &samples {
            assert!(row.is_some() || !is_whole, "a torn row is recorded as data");
        }
        let torn = samples.iter().filter(|(row, _)| row.is_none()).count();
        assert!(torn > 0, "the section is long enough to tear rows");
    }
}

#[test]
fn interference_on_both_wires_of_the_encoder_moves_nothing_and_strokes_are_counted() {
    let mut device = Device::started(Options::default());
    let start = device.stylus.now_ns();
    // A pulse of 0.8 µs is the longest that the filter of 1.28 µs suppresses with a margin.
    // Each pulse is 377 ns later within its millisecond, so that they meet the filter at all phases of its clock.
    let instants: Vec<u64> = (1..400).map(|n| start + n * MS + n * 377).collect();
    device.stylus.disturb_encoder(instants, 800);
    let counts = |device: &mut Device, ms: u64| -> i64 {
        let seen = device.blocks.len();
        device.record();
        device.run_for(ms * MS);
        device.stop_recording();
        device.run_for(20 * MS);
        device.blocks[seen..]
            .iter()
            .flat_map(|block| block.samples.map(RecordSample::from))
            .map(|sample| i64::from(sample.encoder_delta))
            .sum()
    };
    assert_eq!(counts(&mut device, 200), 0, "the tool was at rest");
    // The fastest stroke with the finest encoder: 2 m/s at 5 µm per count.
    device.stylus.set_motion(Motion::steady(2_000.0, 0.005));
    device.run_for(5 * MS);
    let seen = device.blocks.len();
    let counted = counts(&mut device, 100);
    let samples = ((device.blocks.len() - seen) * BLOCK_SAMPLES) as i64;
    // 400 000 counts per second are 80 per tick.
    assert!(
        (counted.abs() - 80 * samples).abs() <= 2,
        "{counted} of {}",
        80 * samples
    );
}

/// Groups samples by the trigger that started them: X, Y, Z and force, in the order of their ranks.
fn sequences(samples: &[Sample]) -> Vec<[Sample; 4]> {
    let first = samples
        .iter()
        .position(|sample| sample.rank == 0)
        .expect("a whole sequence");
    samples[first..].as_chunks().0.to_vec()
}

#[test]
fn a_recording_holds_what_was_on_the_pins_at_instants_200_microseconds_apart() {
    ALL.iter().for_each(records_what_is_on_the_pins);
}

fn records_what_is_on_the_pins(board: &'static Board) {
    let mut device = Device::started(Options::on(board));
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
    // The recording begins somewhere within the converted samples. From there on both must be equal.
    let begin = (converted.iter())
        .position(|sequence| words(sequence) == sampled(&recorded[0]))
        .expect("the first sample was on the pins");
    for (n, (sequence, sample)) in converted[begin..].iter().zip(&recorded).enumerate() {
        assert_eq!(words(sequence), sampled(sample), "sample {n}");
        // A sensor wired to another pin would be recorded as another sensor.
        assert_eq!(sequence.map(|pin| pin.channel), board.inputs, "sample {n}");
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
    assert!((counts - expected).abs() <= 3, "{counts} counts of {expected}");
}
