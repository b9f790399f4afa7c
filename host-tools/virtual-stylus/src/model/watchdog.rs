//! The independent watchdog IWDG1 (chapter 45).
//!
//! | What | Section |
//! |---|---|
//! | `KR`: 0x5555 opens `PR` and `RLR`, any other key shuts them | 45.3.3, 45.4.1 |
//! | `KR`: 0xAAAA reloads, 0xCCCC starts | 45.3.1, 45.4.1 |
//! | Counts the LSI, forced on, through the divider of `PR` from `RLR` down | 45.3.1, 45.4.2, 45.4.3, 8.5.2 |
//! | A reset of the part at the end of the count | 45.3.1 |
//! | Once started only a reset stops it | 45.3.1 |
//!
//! Left out: the window (`WINR`), but if the image asks for it, the run's report says so; the up to five cycles of the
//! LSI before a written `PR` or `RLR` takes effect, so `SR` is always zero; the start by option byte; the halt by the
//! debugger and in low-power modes.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::generated::iwdg::Register;
use rigless::soc::stm32h743::peripherals::rcc::IWDG_STARTED;
use rigless::time::{EventId, NANOS_PER_SECOND, VirtualNanos};

const OPEN: u64 = 0x5555;
const RELOAD: u64 = 0xAAAA;
const START: u64 = 0xCCCC;
/// Value of `RLR` after a reset.
const LONGEST: u64 = 0xFFF;
const WITHOUT_WINDOW: &str = "RM0433 45.3.2: the window is not modelled, so no reload is too early";
/// The code of `PR` for the largest divider. The next higher code gives the same divider.
const LARGEST_DIVIDER_CODE: u64 = 6;

/// The model.
#[derive(Debug)]
pub struct Watchdog {
    started: bool,
    open: bool,
    divider: u64,
    reload: u64,
    hz: u64,
    /// An instant, and the count at that instant.
    counted_from: (VirtualNanos, u64),
    end: Option<EventId>,
}

impl Default for Watchdog {
    fn default() -> Self {
        Self {
            started: false,
            open: false,
            divider: 4,
            reload: LONGEST,
            hz: 0,
            counted_from: (VirtualNanos(0), LONGEST),
            end: None,
        }
    }
}

impl Watchdog {
    /// Returns true if the image has started the watchdog since the last reset.
    pub fn started(&self) -> bool {
        self.started
    }

    /// Time from a reload to the reset, in nanoseconds; `None` while the watchdog does not count.
    pub fn timeout_ns(&self) -> Option<u64> {
        (self.started && self.hz != 0).then(|| self.span_ns(self.reload + 1))
    }

    fn span_ns(&self, counts: u64) -> u64 {
        // Rounded up, so that the count has surely ended at that instant.
        let cycles = u128::from(counts) * u128::from(self.divider);
        (cycles * u128::from(NANOS_PER_SECOND)).div_ceil(u128::from(self.hz)) as u64
    }

    fn count_at(&self, now: VirtualNanos) -> u64 {
        let (from, count) = self.counted_from;
        let cycles = u128::from(now.0 - from.0) * u128::from(self.hz) / u128::from(NANOS_PER_SECOND);
        count.saturating_sub((cycles / u128::from(self.divider)) as u64)
    }

    fn count_from(&mut self, count: u64, context: &mut DeviceContext<'_>) {
        self.counted_from = (context.now(), count);
        // The reset comes one step after zero.
        self.end = (self.started && self.hz != 0)
            .then(|| context.schedule(VirtualNanos(context.now().0 + self.span_ns(count + 1))));
    }

    fn key(&mut self, key: u64, context: &mut DeviceContext<'_>) {
        self.open = key == OPEN;
        match key {
            RELOAD => self.count_from(self.reload, context),
            START if !self.started => {
                self.started = true;
                // The clock controller forces the LSI on, and reports its rate at once.
                context.request(IWDG_STARTED, Level::High);
                self.count_from(self.reload, context);
            }
            _ => {}
        }
    }
}

impl Device for Watchdog {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        match register {
            Register::Kr => self.key(value & 0xFFFF, context),
            Register::Pr if self.open => {
                let count = self.count_at(context.now());
                self.divider = 4 << (value & 0b111).min(LARGEST_DIVIDER_CODE);
                self.count_from(count, context);
            }
            Register::Rlr if self.open => self.reload = value & 0xFFF,
            Register::Winr => context.tell("WINR", WITHOUT_WINDOW),
            Register::Pr | Register::Rlr | Register::Sr => {}
        }
        // The register file has taken whatever was written, even while the registers were shut.
        let divider_code = u64::from(self.divider.trailing_zeros() - 2);
        registers.set(Register::Pr, divider_code);
        registers.set(Register::Rlr, self.reload);
    }

    fn on_clock(&mut self, hz: u64, _registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let count = if self.hz == 0 {
            self.reload
        } else {
            self.count_at(context.now())
        };
        self.hz = hz;
        self.count_from(count, context);
    }

    fn on_event(&mut self, event: EventId, _registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.end == Some(event) {
            self.end = None;
            context.request_reset();
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
