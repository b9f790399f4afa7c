//! The trigger output of a timer (section 42.4.2, `MMS`), for the converters.
//!
//! The emulator's timer counts the pulses of its trigger output. Here each new pulse is kept with its instant until the
//! part passes it to the converters, at the same instant and before anything else happens.
//!
//! The timers also hear the acknowledges of the request multiplexer DMAMUX1 (section 17.4.4), which the emulator
//! numbers by its inputs of table 124. Those of the digital-to-analogue converter's two requests are kept here for it.
//!
//! Left out: the level modes of `MMS` (reset, enable). The pulse of the update mode is one instant; its two edges are
//! one cycle of the timer's clock apart on the part.

use rigless::device::{DeviceContext, Level, RequestChange};
use rigless::soc::stm32h743::peripherals::tim::{Basic, Tim};
use rigless::time::VirtualNanos;

use super::around::{Around, Call};

/// The first acknowledge among the outputs of DMAMUX1: after one request and one event for each of its 16 channels.
const FIRST_ACKNOWLEDGE: usize = 2 * 16;
/// Table 124: the requests of the converter's two channels.
const CONVERTER_REQUESTS: [usize; 2] = [67, 68];

/// The pulses of a timer's trigger output, and the acknowledges for the converter, that were not taken yet.
#[derive(Debug, Default)]
pub struct TriggerOutput {
    sent: u64,
    unheard: Vec<VirtualNanos>,
    acknowledged: Option<(VirtualNanos, usize)>,
}

impl TriggerOutput {
    /// Returns the instant of the oldest pulse that no call has returned yet.
    pub fn take(&mut self) -> Option<VirtualNanos> {
        (!self.unheard.is_empty()).then(|| self.unheard.remove(0))
    }

    /// Returns the instant of an acknowledge for the DAC and the DAC's channel, if no call has returned it yet.
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
        // The model wakes at each update while the trigger output is in use, so a call adds one at most.
        for _ in self.sent..sent {
            self.unheard.push(call.context.now());
        }
        self.sent = sent;
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
