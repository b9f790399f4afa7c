//! Critical sections, whose durations are measured: interrupts are masked by PRIMASK, on the one core.
//!
//! The tick cannot begin within a critical section. So a tick may be late by the longest section plus the entry of the
//! update's handler. Every critical section of the image is implemented here, including those of embassy's executor,
//! time driver, channels and USB driver. embassy's sections run from flash, so on the part a cache miss lengthens them.
//!
//! The measurement costs each outermost section two reads of the cycle counter and a comparison, some ten instructions.
#![expect(unsafe_code, reason = "critical sections are what this implements")]

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::interrupt;
use cortex_m::peripheral::DWT;
use cortex_m::register::primask;

/// The implementation for the crate `critical-section`.
struct TimedSections;

critical_section::set_impl!(TimedSections);

/// Cycle at which the current section began.
static BEGAN: AtomicU32 = AtomicU32::new(0);

/// Cycles of the longest section so far.
static LONGEST: AtomicU32 = AtomicU32::new(0);

// SAFETY: interrupts are masked from `acquire` to the `release` of the outermost section, and this is the only core.
unsafe impl critical_section::Impl for TimedSections {
    #[inline(always)]
    unsafe fn acquire() -> bool {
        let outermost = primask::read().is_active();
        interrupt::disable();
        if outermost {
            BEGAN.store(DWT::cycle_count(), Ordering::Relaxed);
        }
        outermost
    }

    #[inline(always)]
    unsafe fn release(outermost: bool) {
        if !outermost {
            return;
        }
        let cycles = DWT::cycle_count().wrapping_sub(BEGAN.load(Ordering::Relaxed));
        if cycles > LONGEST.load(Ordering::Relaxed) {
            LONGEST.store(cycles, Ordering::Relaxed);
        }
        // SAFETY: interrupts were enabled when this section began, and it is the outermost one.
        unsafe { interrupt::enable() };
    }
}

/// Discards the sections before the tick starts, because embassy sets up the clocks within a long one.
pub fn begin_measuring() {
    LONGEST.store(0, Ordering::Relaxed);
}

/// Length of the longest critical section since [`begin_measuring`], cycles.
pub fn longest_cycles() -> u32 {
    LONGEST.load(Ordering::Relaxed)
}
