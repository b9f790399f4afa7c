//! The trigger output of a timer (section 42.4.2, `MMS`), for the converters.
//!
//! The emulator's timer counts the pulses of its trigger output. Here each new pulse is kept with its instant until the
//! part passes it to the converters, at the same instant and before anything else happens.
//!
//! The timers also receive the acknowledges of the request multiplexer DMAMUX1 (section 17.4.4), which the emulator
//! numbers by its inputs in table 124. The acknowledges of the digital-to-analogue converter's two requests are kept
//! here for the converter.
//!
//! Left out: the level modes of `MMS` (reset, enable). The pulse of the update mode is one instant here; on the part
//! its two edges are one cycle of the timer's clock apart.

use rigless::device::{DeviceContext, Level, RequestChange};
use rigless::soc::stm32h743::peripherals::tim::{Basic, Tim};
use rigless::time::VirtualNanos;

use super::around::{Around, Call};

/// Index of the first acknowledge among the outputs of DMAMUX1. One request and one event for each of its 16 channels
/// come before it.
const FIRST_ACKNOWLEDGE: usize = 2 * 16;
/// The requests of the converter's two channels, as table 124 numbers them.
const CONVERTER_REQUESTS: [usize; 2] = [67, 68];

/// The pulses of a timer's trigger output, and the acknowledges for the converter, until they are taken.
#[derive(Debug, Default)]
pub struct TriggerOutput {
    /// Number of pulses of the emulator's timer that were seen.
    sent: u64,
    unheard: Vec<VirtualNanos>,
    acknowledged: Option<(VirtualNanos, usize)>,
}

impl TriggerOutput {
    /// Returns the instant of the oldest pulse that no earlier call has returned.
    pub fn take(&mut self) -> Option<VirtualNanos> {
        (!self.unheard.is_empty()).then(|| self.unheard.remove(0))
    }

    /// Returns the instant and the channel of an acknowledge for the DAC, unless an earlier call has returned it.
    pub fn take_acknowledge(&mut self) -> Option<(VirtualNanos, usize)> {
        self.acknowledged.take()
    }
}

impl Around<Tim<Basic>> for TriggerOutput {
    fn request(&mut self, change: RequestChange, context: &mut DeviceContext<'_>) {
        if change.instance == "DMAMUX1" && change.level == Level::High {
            let channel = CONVERTER_REQUESTS
                .iter()
                .position(|input| change.request == FIRST_ACKNOWLEDGE + input);
            if let Some(channel) = channel {
                self.acknowledged = Some((context.now(), channel));
            }
        }
    }

    fn after(&mut self, inner: &mut Tim<Basic>, call: &mut Call<'_, '_>) {
        let (_, sent) = inner.trigger_output();
        // The model wakes at each update while the trigger output is in use, so a call adds at most one pulse.
        for _ in self.sent..sent {
            self.unheard.push(call.context.now());
        }
        self.sent = sent;
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
