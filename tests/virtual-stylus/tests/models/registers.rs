//! Registers that the probe image does not use, written one by one without a core: converters and watchdog.

use rigless::mcu::Operate;
use virtual_stylus::Electrical;
use virtual_stylus::model::dac::Cause;

use crate::bench::{AHB1ENR, Bench, RCC};

pub const APB1LENR: u64 = RCC + 0xE8;
const D3CCIPR: u64 = RCC + 0x58;
pub const DAC: u64 = 0x4000_7400;
const ADC1: u64 = 0x4002_2000;
const IWDG1: u64 = 0x5800_4800;

/// The part with the clocks of the converters on.
pub fn converters() -> Bench {
    let mut bench = Bench::new(Electrical::default());
    bench.write(APB1LENR, 1 << 29);
    bench.write(AHB1ENR, 1 << 5);
    // The converters' clock is the peripherals' common one, 64 MHz.
    bench.write(D3CCIPR, 0b10 << 16);
    bench
}

#[test]
fn every_holding_register_of_the_dac_gives_the_same_codes() {
    const CR: u64 = DAC;
    let mut bench = converters();
    bench.write(CR, 1 << 16 | 1);
    // Register, value, and the outputs of both channels after the write.
    let steps = [
        (0x08, 0x0123, 0x123, 0),
        (0x0C, 0x4560, 0x456, 0),
        (0x10, 0x78, 0x780, 0),
        (0x14, 0x0ABC, 0x780, 0xABC),
        (0x18, 0xDEF0, 0x780, 0xDEF),
        (0x1C, 0x9A, 0x780, 0x9A0),
        (0x20, 0x0321_0654, 0x654, 0x321),
        (0x24, 0x9870_4560, 0x456, 0x987),
        (0x28, 0xBEAD, 0xAD0, 0xBE0),
    ];
    for (register, value, first, second) in steps {
        bench.write(DAC + register, value);
        assert_eq!(
            (bench.read(DAC + 0x2C), bench.read(DAC + 0x30)),
            (first, second),
            "{register:#x}"
        );
    }
}

#[test]
fn a_software_trigger_latches_the_channel_it_is_for() {
    const SWTRGR: u64 = DAC + 0x04;
    const TRIGGERED: u64 = 0b11;
    let mut bench = converters();
    bench.write(DAC, TRIGGERED << 16 | TRIGGERED);
    bench.write(DAC + 0x20, 0x0222_0111);
    assert_eq!((bench.read(DAC + 0x2C), bench.read(DAC + 0x30)), (0, 0));
    bench.write(SWTRGR, 0b10);
    assert_eq!((bench.read(DAC + 0x2C), bench.read(DAC + 0x30)), (0, 0x222));
    bench.write(SWTRGR, 0b01);
    assert_eq!(
        (bench.read(DAC + 0x2C), bench.read(DAC + 0x30)),
        (0x111, 0x222)
    );
}

#[test]
fn an_enabled_channel_that_is_kept_from_its_pin_drives_nothing() {
    const MCR: u64 = DAC + 0x3C;
    const INTERNAL_ONLY: u64 = 0b011;
    let mut bench = converters();
    bench.write(MCR, INTERNAL_ONLY);
    bench.write(DAC, 1);
    bench.write(DAC + 0x08, 100);
    assert_eq!(bench.part.dac.pin(), None);
    bench.write(MCR, 0);
    assert_eq!(bench.part.dac.pin(), Some(100));
    bench.write(DAC, 0);
    let causes: Vec<Cause> = bench
        .part
        .dac
        .record()
        .iter()
        .map(|output| output.cause)
        .collect();
    assert_eq!(causes, [Cause::Enabled, Cause::Disabled]);
}

#[test]
fn a_sequence_started_by_software_runs_once_at_the_resolution_asked_for() {
    const ISR: u64 = ADC1;
    const CR: u64 = ADC1 + 0x08;
    const RESOLUTION_12: u64 = 0b010 << 2;
    const JADSTART: u64 = 1 << 3;
    const JEOC: u64 = 1 << 5;
    const JEOS: u64 = 1 << 6;
    let mut bench = converters();
    bench.write(CR, 1 << 28);
    bench.wait(20_000);
    bench.write(CR, 1 << 28 | 1);
    bench.wait(1_000);
    assert_eq!(bench.read(ISR) & 1, 1, "ready");
    bench.write(ADC1 + 0x0C, RESOLUTION_12);
    // Two conversions, both of the third channel.
    bench.write(ADC1 + 0x4C, 3 << 15 | 3 << 9 | 1);
    bench.write(CR, JADSTART);
    // 1.5 and 6.5 cycles per conversion at 32 MHz.
    bench.wait(249);
    assert_eq!(
        (bench.read(ISR) & (JEOC | JEOS), bench.read(CR) & JADSTART),
        (0, JADSTART)
    );
    bench.wait(1);
    assert_eq!(bench.read(ISR) & (JEOC | JEOS), JEOC);
    assert_eq!(bench.read(ADC1 + 0x80), 0xABC);
    assert_eq!(
        bench.read(ISR) & (JEOC | JEOS),
        0,
        "reading the result clears the flag"
    );
    bench.wait(250);
    assert_eq!(
        (bench.read(ISR) & (JEOC | JEOS), bench.read(CR) & JADSTART),
        (JEOC | JEOS, 0)
    );
    bench.write(ISR, JEOC | JEOS);
    assert_eq!(bench.read(ISR) & (JEOC | JEOS), 0);
}

#[test]
fn a_watchdog_fed_before_its_window_opens_resets_the_part() {
    const KEY: u64 = IWDG1;
    const RELOAD: u64 = IWDG1 + 0x08;
    const WINDOW: u64 = IWDG1 + 0x10;
    /// 4 cycles of the 32 kHz LSI.
    const COUNT_NS: u64 = 125_000;
    for (counts, resets) in [(89, true), (91, false)] {
        let mut bench = converters();
        bench.write(KEY, 0xCCCC);
        bench.wait(1_000_000);
        bench.write(KEY, 0x5555);
        bench.write(RELOAD, 100);
        bench.write(WINDOW, 10);
        bench.wait(counts * COUNT_NS + COUNT_NS / 2);
        bench.write(KEY, 0xAAAA);
        assert_eq!(
            bench.part.take_reset_request().is_some(),
            resets,
            "after {counts} counts"
        );
    }
}

#[test]
fn a_shut_register_of_the_watchdog_takes_nothing() {
    const RELOAD: u64 = IWDG1 + 0x08;
    let mut bench = converters();
    bench.write(RELOAD, 5);
    assert_eq!(bench.read(RELOAD), 0xFFF);
    bench.write(IWDG1, 0x5555);
    bench.write(RELOAD, 5);
    assert_eq!(bench.read(RELOAD), 5);
}
