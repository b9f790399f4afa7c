//! Interrupt priorities.
//!
//! | priority | handler | deadline |
//! |---|---|---|
//! | 0 | tick (TIM6_DAC) | one sample per 200 µs |
//! | 0 | falling supply (PVD_AVD) | before the output has fallen |
//! | 2 | serial port (USART3) | its FIFO holds 170 µs, less than an update may take |
//! | 4 | update (SWPMI1, pended by software) | one block per 2 ms |
//! | 8 | embassy's handlers: time (TIM2), USB | none: they wake tasks |
//! | none | tasks, in thread mode | none |
//!
//! Priorities are the upper four bits of eight (RM0433 section 19.1); smaller is more urgent.
#![expect(
    unsafe_code,
    reason = "a raised priority can break code that masks interrupts by priority; no code here does"
)]

use cortex_m::peripheral::NVIC;
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};

/// Interrupt of the tick: TIM6's update event.
pub const TICK: Interrupt = Interrupt::TIM6_DAC;

/// Interrupt of the update, pended by the tick. It belongs to SWPMI1, a peripheral that the product does not use.
pub const UPDATE: Interrupt = Interrupt::SWPMI1;

/// Interrupt of the serial port.
pub const SERIAL: Interrupt = Interrupt::USART3;

/// Interrupt of the voltage detector.
pub const SUPPLY: Interrupt = Interrupt::PVD_AVD;

/// All other interrupts in use.
const TASKS: [Interrupt; 2] = [Interrupt::TIM2, Interrupt::OTG_FS];

/// Value of BASEPRI that masks all interrupts except those of tick, falling supply, serial port and update.
pub const TASKS_MASK: u8 = 8 << 4;

/// Sets all priorities. It runs right after embassy's initialisation, because embassy gives its own interrupts the
/// highest priority.
pub fn assign() {
    for interrupt in TASKS {
        interrupt.set_priority(Priority::P8);
    }
    SERIAL.set_priority(Priority::P2);
    UPDATE.set_priority(Priority::P4);
    TICK.set_priority(Priority::P0);
    SUPPLY.set_priority(Priority::P0);
}

/// Enables tick and update.
pub fn enable() {
    for interrupt in [UPDATE, TICK] {
        interrupt.unpend();
        // SAFETY: everything that the handlers use is initialised, and no critical section masks by priority.
        unsafe { interrupt.enable() };
    }
}

/// Requests the update, which runs as soon as nothing more urgent runs.
#[inline(always)]
pub fn pend_update() {
    NVIC::pend(UPDATE);
}
