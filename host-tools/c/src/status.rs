//! Results of calls, and the text of the last that failed.

use std::cell::{Cell, RefCell};
use std::ffi::CStr;
use std::fmt::Display;

// Another code changes this declaration, on which callers rely: raise `STYLUS_PLAYER_ABI` (`tests/door/header.rs`).
/// Result of a call.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(non_camel_case_types, reason = "names of C")]
pub enum Status {
    /// The call did what it says.
    STYLUS_OK = 0,
    /// An argument is NULL.
    STYLUS_NULL = 1,
    /// A handle is none of this library, or was closed.
    STYLUS_HANDLE = 2,
    /// An address is not a multiple of its type's alignment.
    STYLUS_ALIGNMENT = 3,
    /// A length is beyond what memory can hold, or a buffer is too short for its text.
    STYLUS_LENGTH = 4,
    /// A text is not UTF-8.
    STYLUS_TEXT = 5,
    /// A file cannot be read.
    STYLUS_FILE = 6,
    /// The bytes are no library, or a damaged one.
    STYLUS_LIBRARY = 7,
    /// The library has no such texture or scene, or it cannot be played.
    STYLUS_CHOICE = 8,
    /// A speed, force, position or time is not finite, or no hand has it.
    STYLUS_MOTION = 9,
    /// The output rate is not played.
    STYLUS_RATE = 10,
    /// The gain, the limit or the coil cannot be.
    STYLUS_GAIN = 11,
    /// Another thread fills from this player at this moment.
    STYLUS_BUSY = 12,
    /// A fault of this library. The handle is of no more use, except to be closed.
    STYLUS_FAULT = 13,
}

/// Meanings of the statuses, in their order.
static TEXTS: [&CStr; 14] = [
    c"no fault",
    c"an argument is NULL",
    c"this is no open handle of this kind",
    c"an address is not aligned to its type",
    c"the length is too great, or the buffer too short",
    c"the text is not UTF-8",
    c"the file cannot be read",
    c"this is no library that can be played",
    c"the library has no such texture or scene, or it cannot be played",
    c"a speed, force, position or time is not finite, or no hand has it: give mm/s, N, mm and s",
    c"the output rate is not played: give a multiple of 25 Hz from 1000 to 192000 Hz",
    c"give a finite gain, a limit that is not negative, and ohms and watts above zero",
    c"another thread fills from this player: fill from one at a time",
    c"a fault of the library itself: close the handle, and report it",
];

/// Meaning of a status, by its number.
pub fn text(status: i32) -> &'static CStr {
    usize::try_from(status)
        .ok()
        .and_then(|at| TEXTS.get(at))
        .copied()
        .unwrap_or(c"an unknown status")
}

thread_local! {
    static LAST: RefCell<String> = const { RefCell::new(String::new()) };
    /// True if the last failure had a text. It is apart, because a call that may not allocate sets it.
    static HAS_TEXT: Cell<bool> = const { Cell::new(false) };
}

/// A call that failed. Only calls that may allocate give more than their status.
pub struct Failure(pub Status, pub Option<String>);

impl Failure {
    pub fn new(status: Status, detail: &dyn Display) -> Self {
        Self(status, Some(detail.to_string()))
    }

    /// The status, whose detail becomes the thread's text.
    pub fn tell(self) -> Status {
        let Self(status, detail) = self;
        HAS_TEXT.set(detail.is_some());
        if let Some(detail) = detail {
            LAST.with_borrow_mut(|last| *last = detail);
        }
        status
    }
}

impl From<Status> for Failure {
    fn from(status: Status) -> Self {
        Self(status, None)
    }
}

/// Text of the thread's last failure; empty if its status says all.
pub fn last<R>(look: impl FnOnce(&str) -> R) -> R {
    if HAS_TEXT.get() {
        LAST.with_borrow(|last| look(last))
    } else {
        look("")
    }
}
