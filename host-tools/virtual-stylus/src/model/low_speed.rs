//! LSI at TIM16's input: `TISEL` of 1 connects it to TI1 (RM0433, TIM16 timer input selection register). The timer is
//! the emulator's model.
//!
//! Edges are driven only while the timer counts and captures this input, because no other reader could see them. Left
//! out: LSI's jitter, and its enable, because the watchdog keeps it on.

use rigless::device::{DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::generated::tim16::{Register, ccer, cr1};
use rigless::soc::stm32h743::peripherals::tim::{Channel, Tim, Tim16};
use rigless::time::{EventId, NANOS_PER_SECOND, VirtualNanos};

use super::around::{Around, Call};

/// Value of `TISEL` that selects LSI.
const SELECTION: u8 = 1;
const CHANNEL_1: Channel = Channel::new(1).expect("every timer has it");
/// DS12110 table 136: the typical rate.
const TYPICAL_HZ: u64 = 32_000;

/// The oscillator at the timer's input.
#[derive(Debug)]
pub struct LowSpeedInput {
    hz: Option<u64>,
    /// Instant from which the edges are counted, number of the next edge, and the next edge's event.
    next: Option<(u64, u64, EventId)>,
}

impl Default for LowSpeedInput {
    fn default() -> Self {
        Self {
            hz: Some(TYPICAL_HZ),
            next: None,
        }
    }
}

impl LowSpeedInput {
    /// Sets the oscillator's rate, Hz; `None` stops the oscillator.
    pub fn set_hz(&mut self, hz: Option<u64>) {
        self.hz = hz;
    }

    fn is_seen(registers: &RegisterFile) -> bool {
        registers.get(Register::Tim16Tisel) & 0xF == u64::from(SELECTION)
            && ccer::CC1E.is_set(registers.get(Register::Ccer))
            && cr1::CEN.is_set(registers.get(Register::Cr1))
    }

    fn schedule(&mut self, began: u64, edge: u64, context: &mut DeviceContext<'_>) {
        self.next = self.hz.map(|hz| {
            // Counted from the first edge, so that the rounding to nanoseconds does not add up.
            let at = began + edge * NANOS_PER_SECOND / (2 * hz);
            (began, edge, context.schedule(VirtualNanos(at)))
        });
    }
}

impl Around<Tim<Tim16>> for LowSpeedInput {
    fn event(&mut self, inner: &mut Tim<Tim16>, event: EventId, call: &mut Call<'_, '_>) {
        if let Some((began, edge, _)) = self.next.take_if(|(_, _, asked)| *asked == event)
            && Self::is_seen(call.registers)
        {
            let level = Level::from(edge % 2 != 0);
            inner.drive_input_source(CHANNEL_1, SELECTION, level, call.registers, call.context);
            self.schedule(began, edge + 1, call.context);
        }
    }

    fn after(&mut self, _inner: &mut Tim<Tim16>, call: &mut Call<'_, '_>) {
        if self.next.is_none() && Self::is_seen(call.registers) {
            self.schedule(call.context.now().0, 1, call.context);
        }
    }

    fn reset(&mut self) {
        self.next = None;
    }
}
