//! Pieces of a level track, joined by interpolation from the last entry of one piece to the first entry of the next.
//!
//! A piece takes 0.2 to 1 s. It begins at any entry of the track, and continues at the track's beginning after its end.
//! The amplitude goes in a straight line from entry to entry, also from the last entry of a piece to the first entry of
//! the next.

use model_format::{Modulation, level_amplitude};

use super::draws::{Draws, share};

/// Largest number of pieces per second. The longest piece takes one second.
const SHORTEST_PER_S: u32 = 5;

/// The state of the level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// Amplitudes of the previous entry and of the next entry, in steps of 2⁻¹⁶.
    from: i32,
    to: i32,
    /// Samples since the previous entry.
    since: u32,
    /// Samples from one entry to the next; 0 before the first sample.
    step: u32,
    /// Index of the next entry.
    at: u32,
    /// Entries of the piece after the next entry.
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
    pub fn next_sample(&mut self, modulation: &Modulation<'_>, sample_rate_hz: u32, draws: &mut Draws) -> i32 {
        if self.since == self.step {
            self.advance(modulation, sample_rate_hz, draws);
        }
        // An amplitude is below 2²² and a step has at most 500 samples, so that the product does not overflow.
        let way = (self.to - self.from) * self.since as i32;
        self.since += 1;
        self.from + way / self.step.max(1) as i32
    }

    #[inline(never)]
    fn advance(&mut self, modulation: &Modulation<'_>, sample_rate_hz: u32, draws: &mut Draws) {
        if self.step == 0 {
            // No entry precedes the first one: it is drawn here, and the level begins there.
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
        // `left` does not count the first entry of the piece. At the lowest sample rates a step is longer than a piece,
        // which then has one entry.
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
