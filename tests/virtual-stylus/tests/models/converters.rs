//! DAC1 and ADC1's injected sequence.

use virtual_stylus::model::adc::Sample;
use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::sensors::{ConstantPins, FunctionPins};
use virtual_stylus::{Options, VirtualStylus};

use crate::probe::{MILLISECOND_NS, READY_NS, TICK_NS, ask, numbers, ready, start};

/// Revisions, and their clock of the converter: 64 MHz, through a divider of 2 and revision V's divider of 2.
const CONVERTER_HZ: [(u16, u64); 2] = [(0x2003, 16_000_000), (0x1003, 32_000_000)];
/// 64.5 cycles of sampling, 8.5 of conversion.
const SAMPLING_HALF_CYCLES: u64 = 129;
const CONVERSION_HALF_CYCLES: u64 = 129 + 17;

fn latches(record: &[Output]) -> Vec<Output> {
    record
        .iter()
        .copied()
        .filter(|output| output.cause == Cause::Trigger)
        .collect()
}

#[test]
fn the_output_is_at_mid_scale_from_its_enable_to_the_first_trigger() {
    let mut stylus = ready(Options::default());
    let record = stylus.take_dac_record();
    assert_eq!(
        (record[0].cause, record[0].code),
        (Cause::Enabled, Some(2048))
    );
    assert_eq!(
        (record[1].cause, record[1].code),
        (Cause::Trigger, Some(2048)),
        "nothing was written before it"
    );
}

#[test]
fn a_trigger_latches_what_was_written_before_it_exactly_a_period_after_the_last() {
    let mut stylus = ready(Options::default());
    let record = latches(&stylus.take_dac_record());
    assert!(record.len() > 50);
    for pair in record.windows(2) {
        assert_eq!(pair[1].at_ns - pair[0].at_ns, TICK_NS);
    }
    // The tick of trigger n writes n, some microseconds after it; trigger n + 1 latches it.
    for (number, latch) in record.iter().enumerate().skip(1) {
        assert_eq!(latch.code, Some(number as u16));
    }
}

#[test]
fn nothing_drives_the_pin_before_the_image_does_and_after_a_reset() {
    let mut stylus = start(Options::default());
    assert!(stylus.take_dac_record().is_empty());
    stylus.run_until(READY_NS);
    stylus.take_dac_record();
    stylus.send(b"s");
    stylus.run_for(MILLISECOND_NS);
    let record = stylus.take_dac_record();
    let reset = record
        .iter()
        .position(|output| output.cause == Cause::Reset)
        .expect("the image reset the part");
    assert_eq!(record[reset].code, None);
    assert_eq!(
        (record[reset + 1].cause, record[reset + 1].code),
        (Cause::Enabled, Some(2048))
    );
}

#[test]
fn the_results_are_what_was_on_the_pins_at_the_sampling_instants() {
    // A code that encodes the channel and the microsecond.
    let code = |channel: u8, at_ns: u64| (u16::from(channel) << 12) | (at_ns / 1000 % 4096) as u16;
    for (revision, converter_hz) in CONVERTER_HZ {
        let mut options = Options {
            pins: Box::new(FunctionPins(code)),
            ..Options::default()
        };
        options.electrical.revision = revision;
        sampled_at(start(options), converter_hz, code);
    }
}

/// Checks that the words are what `code` gave at the sampling instants of a converter at `converter_hz`.
fn sampled_at(mut stylus: VirtualStylus, converter_hz: u64, code: impl Fn(u8, u64) -> u16) {
    stylus.record_samples();
    stylus.run_until(READY_NS);
    let triggers: Vec<u64> = latches(&stylus.take_dac_record())
        .iter()
        .map(|latch| latch.at_ns)
        .collect();
    let samples = stylus.take_samples();
    assert!(samples.len() >= 4 * (triggers.len() - 1));
    for (sequence, trigger) in samples.chunks_exact(4).zip(&triggers) {
        for (rank, (sample, channel)) in sequence.iter().zip([15, 10, 6, 5]).enumerate() {
            let half_cycles = rank as u64 * CONVERSION_HALF_CYCLES + SAMPLING_HALF_CYCLES;
            let at_ns = trigger + half_cycles * 1_000_000_000 / (2 * converter_hz);
            let expected = Sample {
                at_ns,
                channel,
                rank: rank as u8,
                word: code(channel, at_ns),
            };
            assert_eq!(*sample, expected);
        }
    }
}

#[test]
fn the_image_reads_what_the_sequence_converted() {
    let mut codes: [u16; 20] = [0; 20];
    for (channel, code) in [(15, 0x1234), (10, 0x5678), (6, 0x9ABC), (5, 0xDEF0)] {
        codes[channel] = code;
    }
    let mut stylus = ready(Options {
        pins: Box::new(ConstantPins(codes)),
        ..Options::default()
    });
    let answer = numbers(&ask(&mut stylus, b'j', 10));
    assert_eq!(answer[..4], [0x1234, 0x5678, 0x9ABC, 0xDEF0]);
}

#[test]
fn two_runs_of_one_image_are_the_same_run() {
    let run = || {
        let mut stylus = ready(Options::default());
        let answer = ask(&mut stylus, b'j', 10);
        (
            answer,
            stylus.now_ns(),
            stylus.take_dac_record(),
            stylus.take_ticks(),
        )
    };
    assert_eq!(run(), run());
}
