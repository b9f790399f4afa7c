//! Cells for values that the tick, the update and tasks share, on one core, without a lock in the tick.
#![expect(
    unsafe_code,
    reason = "exclusive access follows from interrupt priorities, which the compiler does not know"
)]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use critical_section::CriticalSection;

/// A value that an interrupt handler owns. The handler has exclusive access while it runs, because nothing that
/// interrupts it touches the value. Tasks access it with interrupts masked, for less than 5 µs
/// (`tests/image/ticks.rs`).
pub struct OfHandler<T>(UnsafeCell<T>);

// SAFETY: the methods below give one reference at a time.
unsafe impl<T: Send> Sync for OfHandler<T> {}

impl<T> OfHandler<T> {
    /// A cell with `value`.
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// The value, for its handler.
    ///
    /// # Safety
    /// Called by one interrupt's handler only, once each time it runs; no handler of another priority calls it.
    #[inline(always)]
    #[expect(clippy::mut_from_ref, reason = "by the caller's contract there is one at a time")]
    pub unsafe fn in_handler(&self) -> &mut T {
        // SAFETY: a handler does not interrupt itself, only tasks use `with`, and they never interrupt a handler.
        unsafe { &mut *self.0.get() }
    }

    /// Calls `what` with the value while interrupts are masked. For tasks only; must not be nested.
    pub fn with<R>(&self, what: impl FnOnce(CriticalSection<'_>, &mut T) -> R) -> R {
        critical_section::with(|section| {
            // SAFETY: interrupts are masked, so the handler does not run, and tasks do not interrupt it. `what` gets
            // the only reference, because no `what` in this program calls `with` again.
            what(section, unsafe { &mut *self.0.get() })
        })
    }
}

/// A value that changes owners by the protocol of the module that declares it.
pub struct Handed<T>(UnsafeCell<MaybeUninit<T>>);

// SAFETY: see `Handed::get`.
unsafe impl<T: Send> Sync for Handed<T> {}

impl<T> Handed<T> {
    /// A cell with `value`.
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new(MaybeUninit::new(value)))
    }

    /// A cell without a value, so that no initial value takes up flash. [`Handed::set`] stores the first value.
    pub const fn empty() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Sets the value.
    ///
    /// # Safety
    /// As for [`Handed::get`], except that the cell may be empty.
    #[inline(always)]
    pub unsafe fn set(&self, value: T) {
        // SAFETY: the caller owns the value.
        unsafe { (*self.0.get()).write(value) };
    }

    /// The value.
    ///
    /// # Safety
    /// The caller must own the value, by the protocol of the module that declares it, for as long as the reference
    /// lives, and the cell must not be empty.
    #[inline(always)]
    #[expect(clippy::mut_from_ref, reason = "by the caller's contract there is one at a time")]
    pub unsafe fn get(&self) -> &mut T {
        // SAFETY: the caller owns the value, and the cell is not empty.
        unsafe { (*self.0.get()).assume_init_mut() }
    }

    /// The value, to read.
    ///
    /// # Safety
    /// As for [`Handed::get`], except that others may read the value too.
    #[inline(always)]
    pub unsafe fn look(&self) -> &T {
        // SAFETY: by the caller's contract the cell is not empty, and nothing changes the value meanwhile.
        unsafe { (*self.0.get()).assume_init_ref() }
    }
}
