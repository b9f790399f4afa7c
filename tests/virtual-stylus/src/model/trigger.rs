//! The trigger output of a timer (section 42.4.2, `MMS`), for the converters.
//!
//! The emulator's timer counts the pulses of its trigger output. Here each new pulse is kept with its instant until the
//! part passes it to the converters, at the same instant and before anything else happens.
//!
//! Left out: the level modes of `MMS` (reset, enable). The pulse of the update mode is one instant; its two edges are
//! one cycle of the timer's clock apart on the part.

use rigless::device::{DeviceContext, RegisterFile};
use rigless::soc::stm32h743::peripherals::tim::{Basic, Tim};
use rigless::time::VirtualNanos;

use super::around::Around;

/// The pulses of a timer's trigger output that were not taken yet.
#[derive(Debug, Default)]
pub struct TriggerOutput {
    sent: u64,
    unheard: Vec<VirtualNanos>,
}

impl TriggerOutput {
    /// Takes the instant of the oldest pulse that was not taken yet.
    pub fn take(&mut self) -> Option<VirtualNanos> {
        (!self.unheard.is_empty()).then(|| self.unheard.remove(0))
    }
}

impl Around<Tim<Basic>> for TriggerOutput {
    fn after(
        &mut self,
        inner: &mut Tim<Basic>,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let (_, sent) = inner.trigger_output();
        // The model wakes at each update while the trigger output is in use, so a call adds one at most.
        for _ in self.sent..sent {
            self.unheard.push(context.now());
        }
        self.sent = sent;
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
