//! Who interrupts whom.
//!
//! | priority | who | why |
//! |---|---|---|
//! | 0 | the tick (TIM6_DAC) | one sample within 200 µs |
//! | 2 | the serial port (USART3) | its FIFO holds 170 µs, less than an update may take |
//! | 4 | the update (SWPMI1, pended by software) | one frame within 2 ms |
//! | 8 | everything of embassy's: time, USB | wakes tasks |
//! | none | tasks, in thread mode | may be late |
//!
//! Priorities are the upper four bits of eight (RM0433 section 19.1); smaller is more urgent.
#![expect(
    unsafe_code,
    reason = "a priority that is raised can break what masks interrupts by priority; nothing here does"
)]

use cortex_m::peripheral::NVIC;
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};

/// The interrupt of the tick: TIM6's update.
pub const TICK: Interrupt = Interrupt::TIM6_DAC;

/// The interrupt of the update: that of a peripheral the product does not use, pended by the tick.
pub const UPDATE: Interrupt = Interrupt::SWPMI1;

/// The interrupt of the serial port.
pub const SERIAL: Interrupt = Interrupt::USART3;

/// What has an interrupt here and is none of these.
const TASKS: [Interrupt; 3] = [Interrupt::TIM2, Interrupt::OTG_FS, Interrupt::FLASH];

/// Masks the interrupts of tasks but the serial port's, as BASEPRI has it, and leaves tick and update.
pub const TASKS_MASK: u8 = 8 << 4;

/// Sets all priorities. Embassy gives its own the highest one, so this comes right after its initialisation.
pub fn assign() {
    for interrupt in TASKS {
        interrupt.set_priority(Priority::P8);
    }
    SERIAL.set_priority(Priority::P2);
    UPDATE.set_priority(Priority::P4);
    TICK.set_priority(Priority::P0);
}

/// Lets tick and update run.
pub fn enable() {
    for interrupt in [UPDATE, TICK] {
        interrupt.unpend();
        // SAFETY: what the handlers use is in place, and no critical section masks by priority.
        unsafe { interrupt.enable() };
    }
}

/// Has the update run as soon as nothing more urgent does.
#[inline(always)]
pub fn pend_update() {
    NVIC::pend(UPDATE);
}
