//! Pieces of a level track, joined where one entry goes over into the next.
//!
//! A piece takes 0.2 to 1 s. It begins at any entry of the track, and goes on at its beginning after its end. The
//! amplitude goes in a straight line from entry to entry, and so it does from the last of a piece to the first of the
//! next.

use model_format::{Modulation, level_amplitude};

use super::draws::{Draws, share};

/// Pieces per second at most; at least there is one.
const SHORTEST_PER_S: u32 = 5;

/// The state of the level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// Amplitude of the entry before and of the one ahead, in steps of 2⁻¹⁶.
    from: i32,
    to: i32,
    /// Samples since the entry before.
    since: u32,
    /// Samples from one entry to the next; 0 before the first sample.
    step: u32,
    /// Index of the entry ahead.
    at: u32,
    /// Entries of the piece after the one ahead.
    left: u32,
}

impl Level {
    /// No level.
    pub const NONE: Self = Self {
        from: 0,
        to: 0,
        since: 0,
        step: 0,
        at: 0,
        left: 0,
    };

    /// The amplitude at the next sample, in steps of 2⁻¹⁶.
    #[inline]
    pub fn next_sample(
        &mut self,
        modulation: &Modulation<'_>,
        sample_rate_hz: u32,
        draws: &mut Draws,
    ) -> i32 {
        if self.since == self.step {
            self.advance(modulation, sample_rate_hz, draws);
        }
        // An amplitude is below 2²² and a step at most 500, so that the product has room.
        let way = (self.to - self.from) * self.since as i32;
        self.since += 1;
        self.from + way / self.step.max(1) as i32
    }

    #[inline(never)]
    fn advance(&mut self, modulation: &Modulation<'_>, sample_rate_hz: u32, draws: &mut Draws) {
        if self.step == 0 {
            self.step = u32::from(modulation.step_samples());
            self.enter(modulation, sample_rate_hz, draws);
        }
        self.from = self.to;
        if self.left == 0 {
            self.enter(modulation, sample_rate_hz, draws);
        } else {
            self.left -= 1;
            self.go_to(modulation, self.at + 1);
        }
        self.since = 0;
    }

    /// Draws a piece and goes to its first entry.
    fn enter(&mut self, modulation: &Modulation<'_>, sample_rate_hz: u32, draws: &mut Draws) {
        let entries = modulation.entries().len() as u32;
        let start = draws.below(entries);
        // One entry is the one ahead.
        let shortest = (sample_rate_hz / SHORTEST_PER_S / self.step.max(1)).max(1);
        let longest = (sample_rate_hz / self.step.max(1)).max(shortest);
        self.left = shortest - 1 + share(draws.bits(), longest - shortest + 1);
        self.go_to(modulation, start);
    }

    fn go_to(&mut self, modulation: &Modulation<'_>, at: u32) {
        let entries = modulation.entries();
        self.at = if at as usize >= entries.len() { 0 } else { at };
        let entry = entries.get(self.at as usize).copied().unwrap_or(0);
        self.to = level_amplitude(entry.cast_signed()) as i32;
    }
}
