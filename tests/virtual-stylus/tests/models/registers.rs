//! Registers that the probe image does not use, written one by one without a core: converters and watchdog.

use rigless::mcu::Operate;
use virtual_stylus::Electrical;
use virtual_stylus::model::dac::Cause;

use crate::bench::{AHB1ENR, Bench, RCC};

pub const APB1LENR: u64 = RCC + 0xE8;
const D3CCIPR: u64 = RCC + 0x58;
pub const DAC: u64 = 0x4000_7400;
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
