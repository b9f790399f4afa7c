//! Faults on request, for the tests of the fault handlers. Compiled only with the feature `fault-injection`.
//!
//! A message of one byte on the topic [`PATH`] asks for a fault. The image that is handed out does not know the topic.
#![expect(unsafe_code, reason = "faults are what this is for")]

use core::arch::asm;
use core::sync::atomic::{AtomicU8, Ordering};

use cortex_m::peripheral::{DWT, NVIC, SCB};
use embassy_stm32::interrupt::Interrupt;
use embassy_stm32::pac::TIM6;
use postcard_rpc::Key;

use crate::boot::clock::{CORE_HZ, TIMER_HZ};

/// The topic's path.
pub const PATH: &str = "stylus/fault-injection";

/// The topic's key; its message is a `u8`.
pub const KEY: Key = Key::for_path::<u8>(PATH);

/// A tick that takes 500 µs.
const LONG_TICK: u8 = 1;
/// A tick that never ends.
const ENDLESS_TICK: u8 = 2;
/// A task that never yields.
const ENDLESS_TASK: u8 = 3;
/// A panic.
const PANIC: u8 = 4;
/// A jump to an address that is no Thumb instruction.
const BAD_JUMP: u8 = 5;
/// An interrupt without a handler.
const UNEXPECTED_INTERRUPT: u8 = 6;
/// A non-maskable interrupt.
const NMI: u8 = 7;
/// A stop of the sample timer.
const NO_TICK: u8 = 8;
/// A panic in the tick.
const PANIC_IN_TICK: u8 = 9;

/// A critical section from before a trigger until 25 µs after it.
const SHORT_SECTION: u8 = 30;
/// A critical section from before a trigger until 45 µs after it.
const LONG_SECTION: u8 = 31;

static IN_TICK: AtomicU8 = AtomicU8::new(0);

/// Causes `fault` now, or in the next tick.
pub fn inject(fault: u8) {
    match fault {
        LONG_TICK | ENDLESS_TICK | PANIC_IN_TICK => IN_TICK.store(fault, Ordering::Relaxed),
        ENDLESS_TASK => spin(),
        PANIC => panic!("asked for"),
        // SAFETY: none is needed: the processor refuses the jump, which is the fault (INVSTATE, ARM DDI 0403E,
        // B1.5.14).
        BAD_JUMP => unsafe { asm!("bx {}", in(reg) 0x0800_0000, options(noreturn)) },
        UNEXPECTED_INTERRUPT => {
            // SAFETY: no critical section masks by priority, and the handler is the one for all that have none.
            unsafe { NVIC::unmask(Interrupt::SAI4) };
            NVIC::pend(Interrupt::SAI4);
        }
        // SAFETY: ICSR.NMIPENDSET (ARM DDI 0403E, B3.2.4); its handler ends the program.
        NMI => unsafe { (*SCB::PTR).icsr.write(1 << 31) },
        NO_TICK => TIM6.cr1().modify(|w| w.set_cen(false)),
        SHORT_SECTION => delay_tick(25),
        LONG_SECTION => delay_tick(45),
        _ => {}
    }
}

/// Masks all interrupts from some microseconds before a trigger until `after_us` after it.
fn delay_tick(after_us: u32) {
    let count = || u32::from(TIM6.cnt().read().cnt());
    let period = u32::from(TIM6.arr().read().arr());
    while count() < period / 2 {}
    cortex_m::interrupt::free(|_| {
        while count() >= period / 2 {}
        while count() < after_us * (TIMER_HZ / 1_000_000) {}
    });
}

/// Causes the fault that was requested for the tick, if any.
#[inline(always)]
pub fn in_tick() {
    match IN_TICK.swap(0, Ordering::Relaxed) {
        LONG_TICK => {
            let begin = DWT::cycle_count();
            while DWT::cycle_count().wrapping_sub(begin) < CORE_HZ / 2000 {}
        }
        ENDLESS_TICK => spin(),
        PANIC_IN_TICK => panic!("asked for, in the tick"),
        _ => {}
    }
}

fn spin() -> ! {
    loop {
        cortex_m::asm::nop();
    }
}
