//! Handles, and the checks of what comes from another language.
#![expect(
    unsafe_code,
    reason = "addresses are another language's, and the side that fills is checked while it runs"
)]

use std::cell::UnsafeCell;
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

use stylus_player::{Filler, Mover, SharedLibrary};

use crate::status::{Failure, Status};

/// A library, opened or decoded.
pub type LibraryHandle = Handle<SharedLibrary>;

/// A player.
pub type PlayerHandle = Handle<Player>;

/// Both sides of a player.
pub struct Player {
    pub mover: Mover,
    /// Of the one thread that has changed `use_of_filler` from `FREE` to `TAKEN`.
    filler: UnsafeCell<Filler>,
    use_of_filler: AtomicU8,
}

const FREE: u8 = 0;
const TAKEN: u8 = 1;
/// A fault has left the filler amid a sample.
const FAULTY: u8 = 2;

// SAFETY: the one part that is not `Sync` is `filler`, which only `fill` reaches by a shared reference, and only the
// thread that has taken it. The filler may be used by one thread after another, as below.
unsafe impl Sync for Player {}

const fn is_send<T: Send>() {}
const _: () = is_send::<Filler>();

impl Player {
    pub fn new(mover: Mover, filler: Filler) -> Self {
        Self {
            mover,
            filler: UnsafeCell::new(filler),
            use_of_filler: AtomicU8::new(FREE),
        }
    }

    /// Takes the filler for the calling thread, unless another has it. A faulty one stays what it is.
    fn take(&self) -> Result<(), Failure> {
        self.use_of_filler
            .compare_exchange(FREE, TAKEN, Ordering::Acquire, Ordering::Relaxed)
            .map(drop)
            .map_err(|now| match now {
                FAULTY => Status::STYLUS_FAULT.into(),
                _ => Status::STYLUS_BUSY.into(),
            })
    }

    /// Fills `samples`, unless another thread does.
    pub fn fill(&self, samples: &mut [f32]) -> Result<(), Failure> {
        self.take()?;
        let filled = catch_unwind(AssertUnwindSafe(|| {
            // SAFETY: this thread has taken the filler, which no other can take until it is free again.
            let filler = unsafe { &mut *self.filler.get() };
            filler.fill(samples);
        }));
        let now = if filled.is_ok() { FREE } else { FAULTY };
        self.use_of_filler.store(now, Ordering::Release);
        Ok(filled.map_err(|_| Status::STYLUS_FAULT)?)
    }
}

/// Thing of which another language holds the address.
#[repr(C)]
pub struct Handle<T> {
    /// Mark of an open handle of this kind. A closed one loses it, so that most mistakes are told. It comes first, so
    /// that it is found in a handle of any kind, however small.
    mark: AtomicU64,
    it: T,
}

/// Kinds of handles.
pub trait Marked {
    /// A number that memory is unlikely to hold by accident.
    const MARK: u64;

    /// Refuses to close what a call uses now, and keeps later calls from it.
    fn retire(&self) -> Result<(), Failure> {
        Ok(())
    }
}

impl Marked for SharedLibrary {
    const MARK: u64 = u64::from_le_bytes(*b"stylusL1");
}

impl Marked for Player {
    const MARK: u64 = u64::from_le_bytes(*b"stylusP1");

    fn retire(&self) -> Result<(), Failure> {
        match self.take() {
            Err(Failure(Status::STYLUS_FAULT, _)) => Ok(()),
            taken => taken,
        }
    }
}

impl<T: Marked> Handle<T> {
    /// The address of a new handle, which [`Handle::close`] frees.
    pub fn open(it: T) -> *mut Self {
        Box::into_raw(Box::new(Self {
            mark: AtomicU64::new(T::MARK),
            it,
        }))
    }

    /// Content of the handle at `address`.
    ///
    /// # Safety
    /// `address` is NULL, or memory of which 8 bytes can be read; of an open handle all can be read. Nobody closes the
    /// handle while the result is used.
    pub unsafe fn of<'a>(address: *const Self) -> Result<&'a T, Failure> {
        check(address)?;
        // SAFETY: it is neither NULL nor misaligned, and the caller says that it can be read. Nothing after the mark is
        // touched: the handle may be of a smaller kind.
        let mark = unsafe { &(*address).mark };
        if mark.load(Ordering::Acquire) != T::MARK {
            return Err(Status::STYLUS_HANDLE.into());
        }
        // SAFETY: its mark says that `open` made it, of this kind.
        Ok(unsafe { &(*address).it })
    }

    /// Closes the handle at `address`; NULL is none.
    ///
    /// # Safety
    /// As [`Handle::of`], and nobody uses the handle now or later.
    pub unsafe fn close(address: *mut Self) -> Result<(), Failure> {
        if address.is_null() {
            return Ok(());
        }
        // SAFETY: the caller says the same.
        unsafe { Self::of(address) }?.retire()?;
        // SAFETY: it is a handle of this kind.
        let mark = unsafe { &(*address).mark };
        mark.compare_exchange(T::MARK, 0, Ordering::AcqRel, Ordering::Acquire)
            .map_err(|_| Status::STYLUS_HANDLE)?;
        // SAFETY: its mark says that `open` made it, and only the first call that closes it finds the mark.
        drop(unsafe { Box::from_raw(address) });
        Ok(())
    }
}

/// Checks that `address` is neither NULL nor misaligned.
pub fn check<T>(address: *const T) -> Result<(), Failure> {
    if address.is_null() {
        return Err(Status::STYLUS_NULL.into());
    }
    if !address.is_aligned() {
        return Err(Status::STYLUS_ALIGNMENT.into());
    }
    Ok(())
}

fn check_length<T>(address: *const T, length: usize) -> Result<(), Failure> {
    check(address)?;
    if length > isize::MAX.unsigned_abs() / size_of::<T>() {
        return Err(Status::STYLUS_LENGTH.into());
    }
    Ok(())
}

/// The `length` numbers at `address`; none at any address.
///
/// # Safety
/// `address` is NULL, or so many can be read there and nobody writes them meanwhile.
pub unsafe fn slice<'a, T: Copy>(address: *const T, length: usize) -> Result<&'a [T], Failure> {
    if length == 0 {
        return Ok(&[]);
    }
    check_length(address, length)?;
    // SAFETY: address and length are in order, and the caller says what can be read there.
    Ok(unsafe { std::slice::from_raw_parts(address, length) })
}

/// Room for `length` numbers at `address`; none at any address. Their old values are numbers, whatever they are.
///
/// # Safety
/// `address` is NULL, or so many can be written there and nobody else uses them meanwhile.
pub unsafe fn room<'a, T: Copy>(address: *mut T, length: usize) -> Result<&'a mut [T], Failure> {
    if length == 0 {
        return Ok(&mut []);
    }
    check_length(address, length)?;
    // SAFETY: address and length are in order, and the caller says what can be written there.
    Ok(unsafe { std::slice::from_raw_parts_mut(address, length) })
}

/// Writes `value` to `address`.
///
/// # Safety
/// `address` is NULL, or a `T` can be written there.
///
/// # Errors
/// `STYLUS_NULL` or `STYLUS_ALIGNMENT`.
pub unsafe fn put<T>(address: *mut T, value: T) -> Result<(), Failure> {
    check(address)?;
    // SAFETY: it is neither NULL nor misaligned, and the caller says that it can be written.
    unsafe { address.write(value) };
    Ok(())
}

/// The text at `address`, which ends with a 0.
///
/// # Safety
/// `address` is NULL, or a text that ends with a 0.
pub unsafe fn text<'a>(address: *const c_char) -> Result<&'a str, Failure> {
    check(address)?;
    // SAFETY: it is not NULL, and the caller says that a 0 ends it.
    let text = unsafe { CStr::from_ptr(address) };
    Ok(text.to_str().map_err(|_| Status::STYLUS_TEXT)?)
}

/// The status of `call`. A panic ends here.
pub fn guarded(call: impl FnOnce() -> Result<(), Failure>) -> Status {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => Status::STYLUS_OK,
        Ok(Err(failure)) => failure.tell(),
        Err(_) => Status::STYLUS_FAULT,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(of: Result<(), Failure>) -> Status {
        of.map_or_else(|Failure(status, _)| status, |()| Status::STYLUS_OK)
    }

    #[test]
    fn a_player_that_fills_is_not_closed_and_one_with_a_fault_is() {
        for (now, filled, closed) in [
            (TAKEN, Status::STYLUS_BUSY, Status::STYLUS_BUSY),
            (FAULTY, Status::STYLUS_FAULT, Status::STYLUS_OK),
            (FREE, Status::STYLUS_OK, Status::STYLUS_OK),
        ] {
            let (mover, filler) = stylus_player::player(5000).expect("the rate is played");
            let player = Handle::open(Player::new(mover, filler));
            // SAFETY: the handle is open until it is closed.
            unsafe {
                (*player).it.use_of_filler.store(now, Ordering::Relaxed);
                assert_eq!(status((*player).it.fill(&mut [0.0])), filled);
                assert_eq!(status(Handle::close(player)), closed);
                if closed == Status::STYLUS_BUSY {
                    (*player).it.use_of_filler.store(FREE, Ordering::Relaxed);
                    assert_eq!(status(Handle::close(player)), Status::STYLUS_OK);
                }
            }
        }
    }
}
