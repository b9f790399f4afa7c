//! The two tracks of the quadrature encoder on TIM3's channels 1 and 2 (sections 39.3.19 and 39.4.3). Each edge is
//! driven at its own instant, and the emulator's timer counts it.
//!
//! The timer's input filters (`TIMx_CCMR1`, `IC1F` and `IC2F`) are the emulator's. Interference reaches first one track
//! and then the other, as on two wires of a cable. In encoder mode 3 this pair of pulses moves the count by four, where
//! a pulse on only one track would count one up and one down.
//!
//! The first track leads when the tool moves forward, so encoder mode 3 without inversion counts up. The tracks are
//! connected to the timer's inputs; their pins, and the assignment of these pins to TIM3, are not modelled.

use std::collections::VecDeque;

use rigless::device::{DeviceContext, Level};
use rigless::soc::stm32h743::peripherals::tim::{Channel, General, Tim};
use rigless::time::{EventId, VirtualNanos};

use super::around::{Around, Call};
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
    /// Offset added to the motion's position, so that the encoder's count continues from its present value.
    offset: f64,
    count: i64,
    next: Option<(Edge, EventId)>,
    /// Instants at which interference toggles a track, in order, each with the index of the track.
    disturbances: VecDeque<(u64, usize)>,
    next_disturbance: Option<EventId>,
    /// True for each track whose level interference now inverts.
    disturbed: [bool; 2],
    settled: bool,
}

impl Default for Quadrature {
    fn default() -> Self {
        Self {
            motion: Motion::rest(),
            offset: 0.0,
            count: 0,
            next: None,
            disturbances: VecDeque::new(),
            next_disturbance: None,
            disturbed: [false; 2],
            settled: false,
        }
    }
}

impl Quadrature {
    /// Continues with `motion` at `now_ns`, from the present count of the encoder.
    pub fn set_motion(&mut self, motion: Motion, now_ns: u64) {
        // The wheel begins in the middle between two edges, so that it reaches either after half a count.
        self.offset = self.count as f64 + 0.5 - motion.position(now_ns);
        self.motion = motion;
        self.next = None;
        self.settled = false;
    }

    /// Adds interference: at each of the rising `instants`, a pulse of `width_ns` on the first track, and half a pulse
    /// later a pulse on the second track. The pulses must end before the next instant.
    pub fn disturb(&mut self, instants: impl IntoIterator<Item = u64>, width_ns: u64) {
        for at in instants {
            // These are in order, as the queue must be: the pulses of an instant end before the next instant.
            let half = width_ns / 2;
            self.disturbances
                .extend([(at, 0), (at + half, 1), (at + width_ns, 0), (at + half + width_ns, 1)]);
        }
        self.settled = false;
    }

    fn schedule(&mut self, context: &mut DeviceContext<'_>) {
        self.next = self
            .motion
            .next_edge(context.now().0, self.count, self.offset)
            .map(|edge| (edge, context.schedule(VirtualNanos(edge.at_ns))));
        self.next_disturbance = self
            .disturbances
            .front()
            .map(|&(at_ns, _)| context.schedule(VirtualNanos(at_ns)));
        self.settled = true;
    }

    /// Drives both tracks.
    fn drive(&self, inner: &mut Tim<General>, call: &mut Call<'_, '_>) {
        let tracks = TRACKS[self.count.rem_euclid(4) as usize];
        for (track, channel) in [CHANNEL_1, CHANNEL_2].into_iter().enumerate() {
            let is_high = (tracks[track] == Level::High) ^ self.disturbed[track];
            inner.drive_input(channel, Level::from(is_high), call.registers, call.context);
        }
    }
}

impl Around<Tim<General>> for Quadrature {
    fn event(&mut self, inner: &mut Tim<General>, event: EventId, call: &mut Call<'_, '_>) {
        let is_edge = self.next.take_if(|(_, asked)| *asked == event);
        let is_disturbance = self.next_disturbance.take_if(|asked| *asked == event);
        if let Some((edge, _)) = is_edge {
            self.count = edge.count;
        }
        if is_disturbance.is_some() {
            let now = call.context.now().0;
            while let Some((_, track)) = self.disturbances.pop_front_if(|&mut (at, _)| at <= now) {
                self.disturbed[track] = !self.disturbed[track];
            }
        }
        if is_edge.is_some() || is_disturbance.is_some() {
            self.drive(inner, call);
            // An instant that was asked for before keeps its event, so asking for both again is harmless.
            self.schedule(call.context);
        }
    }

    fn after(&mut self, _inner: &mut Tim<General>, call: &mut Call<'_, '_>) {
        if !self.settled {
            self.schedule(call.context);
        }
    }

    fn reset(&mut self) {
        self.next = None;
        self.next_disturbance = None;
        self.settled = false;
    }
}
