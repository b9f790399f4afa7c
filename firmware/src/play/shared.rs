//! What the tick, the update and tasks share, on one core, without a lock in the tick.
#![expect(
    unsafe_code,
    reason = "exclusive access follows from interrupt priorities, which the compiler does not know"
)]

use core::cell::UnsafeCell;

use critical_section::CriticalSection;

/// A value of an interrupt handler's. The handler has it to itself while it runs, since nothing that interrupts it touches
/// the value; tasks get it with interrupts masked, for some tens of instructions.
pub struct OfHandler<T>(UnsafeCell<T>);

// SAFETY: the methods below give one reference at a time.
unsafe impl<T: Send> Sync for OfHandler<T> {}

impl<T> OfHandler<T> {
    /// With `value` in it.
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// The value, for its handler.
    ///
    /// # Safety
    /// Called by one interrupt's handler alone, once each time it runs; no handler of another priority calls it.
    #[inline(always)]
    #[expect(
        clippy::mut_from_ref,
        reason = "the caller vouches that there is one at a time"
    )]
    pub unsafe fn in_handler(&self) -> &mut T {
        // SAFETY: a handler does not interrupt itself, only tasks use `with`, and they never interrupt a handler.
        unsafe { &mut *self.0.get() }
    }

    /// Does `what` with the value while handlers wait. For tasks only. Not to be called within itself.
    pub fn with<R>(&self, what: impl FnOnce(CriticalSection<'_>, &mut T) -> R) -> R {
        critical_section::with(|section| {
            // SAFETY: interrupts are masked, so its handler does not run, and tasks do not interrupt it; `what` is handed the only
            // reference, and no `what` here calls `with` again.
            what(section, unsafe { &mut *self.0.get() })
        })
    }
}

/// A value that goes from hand to hand by a protocol of its owner's.
pub struct Handed<T>(UnsafeCell<T>);

// SAFETY: see `Handed::get`.
unsafe impl<T: Send> Sync for Handed<T> {}

impl<T> Handed<T> {
    /// With `value` in it.
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// The value.
    ///
    /// # Safety
    /// It must be the caller's turn, by the protocol that stands where the value is declared, for as long as the reference
    /// lives.
    #[inline(always)]
    #[expect(
        clippy::mut_from_ref,
        reason = "the caller vouches that there is one at a time"
    )]
    pub unsafe fn get(&self) -> &mut T {
        // SAFETY: the caller's turn.
        unsafe { &mut *self.0.get() }
    }

    /// The value, to look at.
    ///
    /// # Safety
    /// As for [`Handed::get`], but for others that look at it too.
    #[inline(always)]
    pub unsafe fn look(&self) -> &T {
        // SAFETY: nobody changes it meanwhile.
        unsafe { &*self.0.get() }
    }
}
