//! The motion of each block, from the mover's latest message.

use crate::exchange::{Mailbox, Words};
use crate::playing::{BLOCK_NUMBERS, BlockMotion};

/// Number of blocks, of 2 ms each, for which a motion is held in addition to the blocks of a buffer.
pub const HELD_BLOCKS: u32 = 25;

/// Number of blocks of the longest buffer that plays through: 1 s.
const MOST_BUFFERED_BLOCKS: u32 = 500;

/// Longest time between two places from which a speed is computed, s.
const LONGEST_STEP_S: f64 = 0.1;

/// Highest speed, mm/s, and farthest position, mm: no hand has them, and the kernel's positions are finite.
pub const MOST_MOTION: (f64, f64) = (1e6, 1e9);

/// A message of the mover.
#[derive(Clone, Copy, Debug)]
pub enum MoverMessage {
    /// The motion of the next block.
    Block(BlockMotion),
    /// A place at a time of the caller's clock, s; the speed follows from the previous place.
    Place {
        time_s: f64,
        position_mm: f64,
        force_n: f64,
    },
}

impl MoverMessage {
    /// Returns the words for the mailbox. A place has NaN as its speed, and its time in place of a block's end.
    pub fn words(self) -> Words<BLOCK_NUMBERS> {
        let motion = match self {
            Self::Block(motion) => motion,
            Self::Place {
                time_s,
                position_mm,
                force_n,
            } => BlockMotion {
                begin_mm: position_mm,
                end_mm: time_s,
                ..BlockMotion::new(f64::NAN, force_n)
            },
        };
        motion.numbers().map(f64::to_bits)
    }

    fn of_words(words: Words<BLOCK_NUMBERS>) -> Self {
        let motion = BlockMotion::of_numbers(words.map(f64::from_bits));
        // No block has NaN as its speed, because `BlockMotion::check` refuses it.
        if motion.speed_mm_s.is_nan() {
            return Self::Place {
                time_s: motion.end_mm,
                position_mm: motion.begin_mm,
                force_n: motion.force_n,
            };
        }
        Self::Block(motion)
    }
}

/// A mailbox of the mover's messages.
pub type Moves = Mailbox<BLOCK_NUMBERS>;

/// The motion of each block.
pub struct Follower {
    /// Ticket of the motion that is held.
    taken: u64,
    held: BlockMotion,
    /// Number of blocks that have begun since the motion was taken.
    age: u32,
    /// Number of blocks for which a motion is held.
    held_blocks: u32,
    /// True from the block on in which no motion is held.
    is_over: bool,
    /// The last place and its time, s.
    place: Option<(f64, f64)>,
}

impl Follower {
    pub const fn new() -> Self {
        Self {
            taken: 0,
            held: BlockMotion::new(0.0, 0.0),
            // No motion was told yet.
            age: u32::MAX,
            held_blocks: HELD_BLOCKS,
            is_over: true,
            place: None,
        }
    }

    /// Prepares for a buffer of `blocks`, rounded up.
    ///
    /// A buffer is filled in a moment, and no motion arrives meanwhile. The next motion is met a buffer later at the
    /// latest, so a motion is held for that much longer, or a longer buffer would fall silent within itself.
    pub fn begin_buffer(&mut self, blocks: u32) {
        self.held_blocks = HELD_BLOCKS + blocks.min(MOST_BUFFERED_BLOCKS);
    }

    /// Returns the motion of the next block, whose last sample is `last_s` after its first.
    ///
    /// A message gives the motion of one block. In the blocks after it, the tool continues at its speed. Once the
    /// motion is too old, the tool is at rest and without contact. The force stays, so that no impact is played when
    /// the tool returns.
    pub fn next_block(&mut self, moves: &Moves, last_s: f64) -> BlockMotion {
        if let Some((ticket, words)) = moves.newer_than(self.taken) {
            let motion = self.motion_of(MoverMessage::of_words(words), last_s);
            // The positions were those of one block. In later blocks the speed alone moves the tool.
            let (begin_mm, end_mm) = (f64::NAN, f64::NAN);
            self.held = BlockMotion {
                begin_mm,
                end_mm,
                ..motion
            };
            // The block that begins now is the first of those for which the motion is held.
            (self.taken, self.age, self.is_over) = (ticket, 1, false);
            return motion;
        }
        self.is_over = self.age >= self.held_blocks;
        if self.is_over {
            let contact = 0.0;
            return BlockMotion {
                contact,
                ..BlockMotion::new(0.0, self.held.force_n)
            };
        }
        self.age += 1;
        self.held
    }

    /// Returns whether the last block had no motion.
    pub fn is_over(&self) -> bool {
        self.is_over
    }

    fn motion_of(&mut self, told: MoverMessage, last_s: f64) -> BlockMotion {
        let (time_s, position_mm, force_n) = match told {
            MoverMessage::Block(motion) => {
                self.place = None;
                return motion;
            }
            MoverMessage::Place {
                time_s,
                position_mm,
                force_n,
            } => (time_s, position_mm, force_n),
        };
        let before = self.place.replace((time_s, position_mm));
        let speed_mm_s = match before.map(|(at_s, at_mm)| (time_s - at_s, position_mm - at_mm)) {
            // The same moment again gives no speed: it would be 0 / 0.
            Some((0.0, _)) => self.held.speed_mm_s,
            // After a pause the way says nothing about the speed now, nor does a clock that went back.
            Some((step_s, way_mm)) if step_s > 0.0 && step_s <= LONGEST_STEP_S => way_mm / step_s,
            _ => 0.0,
        };
        // A jump is no motion of a hand.
        let is_of_a_hand = speed_mm_s.abs() <= MOST_MOTION.0;
        let speed_mm_s = if is_of_a_hand { speed_mm_s } else { 0.0 };
        BlockMotion {
            begin_mm: position_mm,
            end_mm: position_mm + speed_mm_s * last_s,
            ..BlockMotion::new(speed_mm_s, force_n)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAST_S: f64 = 0.0018;

    #[test]
    fn the_speed_of_places_is_their_way_over_their_time_whatever_the_rate() {
        for step_s in [0.0001, 0.001, 0.01, 0.05] {
            let (moves, mut follower) = (Moves::new(), Follower::new());
            let mut motion = BlockMotion::new(0.0, 0.0);
            for step in 0..10 {
                let time_s = 1e3 + f64::from(step) * step_s;
                let place = MoverMessage::Place {
                    time_s,
                    position_mm: -120.0 * time_s,
                    force_n: 0.5,
                };
                moves.put(place.words());
                motion = follower.next_block(&moves, LAST_S);
            }
            assert!((motion.speed_mm_s + 120.0).abs() < 1e-3, "{motion:?}");
            let way_mm = motion.end_mm - motion.begin_mm;
            assert!((way_mm + 120.0 * LAST_S).abs() < 1e-6, "{motion:?}");
        }
    }

    #[test]
    fn places_after_a_pause_or_with_a_time_that_goes_back_begin_at_rest() {
        let (moves, mut follower) = (Moves::new(), Follower::new());
        let mut speed_at = |time_s: f64, position_mm| {
            let force_n = 0.5;
            moves.put(
                MoverMessage::Place {
                    time_s,
                    position_mm,
                    force_n,
                }
                .words(),
            );
            follower.next_block(&moves, LAST_S).speed_mm_s
        };
        assert_eq!(speed_at(1.0, 5.0), 0.0);
        assert_eq!(speed_at(1.0625, 10.0), 80.0);
        assert_eq!(speed_at(1.0625, 10.0), 80.0, "the same moment again");
        assert_eq!(speed_at(1.5, 90.0), 0.0, "a pause");
        assert_eq!(speed_at(0.5, 90.0), 0.0, "another clock");
    }
}
