//! The two tracks of the quadrature encoder on TIM3's channels 1 and 2 (sections 39.3.19 and 39.4.3): each edge is
//! driven at its own instant, and the emulator's timer counts it.
//!
//! The first track leads when the tool moves forward, so encoder mode 3 without inversion counts up. The tracks are at
//! the timer's inputs; their pins, and the setting of these pins to TIM3, are not modelled.

use rigless::device::{DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::peripherals::tim::{Channel, General, Tim};
use rigless::time::{EventId, VirtualNanos};

use super::around::Around;
use crate::motion::{Edge, Motion};

/// The levels of the two tracks over a period of four counts.
const TRACKS: [[Level; 2]; 4] = [
    [Level::Low, Level::Low],
    [Level::High, Level::Low],
    [Level::High, Level::High],
    [Level::Low, Level::High],
];
const CHANNEL_1: Channel = Channel::new(1).expect("the timer has four");
const CHANNEL_2: Channel = Channel::new(2).expect("the timer has four");

/// The encoder.
#[derive(Debug)]
pub struct Quadrature {
    motion: Motion,
    /// Offset that is added to the motion's position, so that the encoder's count goes on where it was.
    offset: f64,
    count: i64,
    next: Option<(Edge, EventId)>,
    settled: bool,
}

impl Default for Quadrature {
    fn default() -> Self {
        Self {
            motion: Motion::rest(),
            offset: 0.0,
            count: 0,
            next: None,
            settled: false,
        }
    }
}

impl Quadrature {
    /// Continues with `motion` at `now_ns`, from the present count of the encoder.
    pub fn set_motion(&mut self, motion: Motion, now_ns: u64) {
        self.offset = self.count as f64 + 0.5 - motion.position(now_ns);
        self.motion = motion;
        self.next = None;
        self.settled = false;
    }

    /// Number of edges since the run began, up less down.
    pub fn count(&self) -> i64 {
        self.count
    }

    fn schedule(&mut self, context: &mut DeviceContext<'_>) {
        self.next = self
            .motion
            .next_edge(context.now().0, self.count, self.offset)
            .map(|edge| (edge, context.schedule(VirtualNanos(edge.at_ns))));
        self.settled = true;
    }
}

impl Around<Tim<General>> for Quadrature {
    fn event(
        &mut self,
        inner: &mut Tim<General>,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        if let Some((edge, _)) = self.next.take_if(|(_, asked)| *asked == event) {
            self.count = edge.count;
            let [first, second] = TRACKS[edge.count.rem_euclid(4) as usize];
            inner.drive_input(CHANNEL_1, first, registers, context);
            inner.drive_input(CHANNEL_2, second, registers, context);
            self.schedule(context);
        }
        // There is one event per instance and instant, so the timer may have scheduled this one too.
        false
    }

    fn after(
        &mut self,
        _inner: &mut Tim<General>,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if !self.settled {
            self.schedule(context);
        }
    }

    fn reset(&mut self) {
        self.next = None;
        self.settled = false;
    }
}
