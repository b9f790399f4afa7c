//! Registers written one by one without a core: DAC1, which DMA feeds at the triggers of TIM7, and the watchdog.

use stylus_board::ALL;
use virtual_stylus::Electrical;

use crate::bench::{AHB1ENR, EmulatedPart, RCC};

pub const APB1LENR: u64 = RCC + 0xE8;
const D3CCIPR: u64 = RCC + 0x58;
pub const DAC: u64 = 0x4000_7400;
const IWDG1: u64 = 0x5800_4800;

/// The part with the clocks of the converters on.
pub fn converters() -> EmulatedPart {
    let mut bench = EmulatedPart::new(Electrical::of(&ALL[0]));
    bench.write(APB1LENR, 1 << 29);
    bench.write(AHB1ENR, 1 << 5);
    // The converters run on the peripherals' common clock, 64 MHz.
    bench.write(D3CCIPR, 0b10 << 16);
    bench
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

const TIM7: u64 = 0x4000_1400;
const DMA1: u64 = 0x4002_0000;
const DMAMUX1: u64 = 0x4002_0800;

const CR: u64 = DAC;
const DHR12R1: u64 = DAC + 0x08;
const DHR12R2: u64 = DAC + 0x14;
const DOR1: u64 = DAC + 0x2C;
const SR: u64 = DAC + 0x34;

const ENABLE: u64 = 1;
const TRIGGER_ENABLE: u64 = 1 << 1;
const TIM7_SELECTED: u64 = 6 << 2;
const DMA_ENABLE: u64 = 1 << 12;
const UNDERRUN: u64 = 1 << 13;

/// Period of TIM7, in cycles at 64 MHz and in nanoseconds.
const PERIOD_CYCLES: u64 = 1_600;
const PERIOD_NS: u64 = 25_000;

/// A channel that is on and was set to be triggered by TIM7, with TIM7 running.
fn triggered() -> EmulatedPart {
    let mut bench = converters();
    let clocks = bench.read(APB1LENR);
    bench.write(APB1LENR, clocks | 1 << 5);
    bench.write(CR, TIM7_SELECTED);
    bench.write(CR, TIM7_SELECTED | TRIGGER_ENABLE | ENABLE);
    bench.write(TIM7 + 0x2C, PERIOD_CYCLES - 1);
    // TIM7 sends TRGO at each update.
    bench.write(TIM7 + 0x04, 0b010 << 4);
    bench.write(TIM7, 1);
    bench
}

/// Makes stream 0 of DMA1 copy the other channel's holding register to this channel's, one word at each request 67.
fn with_stream(bench: &mut EmulatedPart) {
    const ENABLE: u64 = 1;
    const MEMORY_TO_PERIPHERAL: u64 = 0b01 << 6;
    const CIRCULAR: u64 = 1 << 8;
    const WORDS: u64 = 0b10 << 11;
    let clocks = bench.read(AHB1ENR);
    bench.write(AHB1ENR, clocks | 1);
    bench.write(DMAMUX1, 67);
    // The stream's count and addresses, which must be set before it is enabled (RM0433 chapter 15).
    bench.write(DMA1 + 0x14, 4);
    bench.write(DMA1 + 0x18, DHR12R1);
    bench.write(DMA1 + 0x1C, DHR12R2);
    let setting = MEMORY_TO_PERIPHERAL | CIRCULAR | WORDS;
    bench.write(DMA1 + 0x10, setting);
    bench.write(DMA1 + 0x10, setting | ENABLE);
}

#[test]
fn a_code_that_was_written_under_the_trigger_is_put_out_when_the_trigger_is_switched_off() {
    let mut bench = converters();
    bench.write(CR, TIM7_SELECTED | TRIGGER_ENABLE | ENABLE);
    bench.write(DHR12R1, 0x123);
    assert_eq!(bench.read(DOR1), 0);
    bench.write(CR, TIM7_SELECTED | ENABLE);
    assert_eq!(bench.read(DOR1), 0x123);
}

#[test]
fn each_trigger_requests_one_code_which_the_next_one_puts_out() {
    let mut bench = triggered();
    with_stream(&mut bench);
    bench.write(CR, DMA_ENABLE | TIM7_SELECTED | TRIGGER_ENABLE | ENABLE);
    // The stream has fetched the old word already, so the new one follows a trigger later.
    bench.write(DHR12R2, 0xABC);
    bench.wait(PERIOD_NS + 1_000);
    assert_eq!((bench.read(DHR12R1), bench.read(DOR1)), (0, 0));
    bench.wait(PERIOD_NS);
    assert_eq!((bench.read(DHR12R1), bench.read(DOR1)), (0xABC, 0));
    bench.wait(PERIOD_NS);
    assert_eq!(bench.read(DOR1), 0xABC);
    assert_eq!(bench.read(DMA1 + 0x14), 1, "a code per trigger");
    assert_eq!(bench.read(SR), 0);
}

#[test]
fn a_trigger_before_the_acknowledge_is_an_underrun_and_ends_the_requests() {
    let mut bench = triggered();
    bench.write(CR, DMA_ENABLE | TIM7_SELECTED | TRIGGER_ENABLE | ENABLE);
    bench.write(DHR12R1, 0x111);
    bench.wait(PERIOD_NS + 1_000);
    assert_eq!(bench.read(SR), 0, "the first request waits");
    bench.wait(PERIOD_NS);
    assert_eq!(bench.read(SR), UNDERRUN);
    assert_eq!(bench.read(DOR1), 0x111, "the old code goes on");
    // A stream that is enabled now serves the pending request, and receives no further one.
    with_stream(&mut bench);
    bench.wait(4 * PERIOD_NS);
    assert_eq!(bench.read(DMA1 + 0x14), 3);
    bench.write(SR, UNDERRUN);
    assert_eq!(bench.read(SR), 0);
    bench.wait(PERIOD_NS);
    assert_eq!(bench.read(DMA1 + 0x14), 2);
}
