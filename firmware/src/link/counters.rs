//! Counters of each link.

use core::cell::Cell;

use critical_section::Mutex;
use model_format::link::LinkCounters;

/// Counters of one link.
pub struct Counters(Mutex<Cell<LinkCounters>>);

/// Counters of the serial link.
pub static SERIAL: Counters = Counters::new();

/// Counters of the USB link.
pub static USB: Counters = Counters::new();

/// Counters of both links: USB, serial.
pub fn all() -> [LinkCounters; 2] {
    [USB.get(), SERIAL.get()]
}

impl Counters {
    const fn new() -> Self {
        Self(Mutex::new(Cell::new(LinkCounters {
            frames: 0,
            malformed: 0,
            oversized: 0,
            line_errors: 0,
            unsent: 0,
        })))
    }

    /// Values of the counters.
    fn get(&self) -> LinkCounters {
        critical_section::with(|section| self.0.borrow(section).get())
    }

    /// Adds one to the counter that `which` selects.
    pub fn count(&self, which: impl FnOnce(&mut LinkCounters) -> &mut u32) {
        critical_section::with(|section| {
            let cell = self.0.borrow(section);
            let mut counters = cell.get();
            let counter = which(&mut counters);
            *counter = counter.saturating_add(1);
            cell.set(counters);
        });
    }
}
