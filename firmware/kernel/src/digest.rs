//! A digest of the first words of a texture along a fixed stroke: one number that identifies what it plays.
//!
//! Two platforms play the same bits if their digests agree, because each sample depends on all before it. The stroke
//! goes back and forth between -256 and 256 mm/s, rests at each turn, presses up to 2.75 N, and lifts off now and then.
//! It reaches the middle, the edges and the outside of every grid that a hand can follow.

use model_format::{MillimetresPerSecond, Newton, OutputSample};

use crate::arithmetic::Arithmetic;
use crate::grid::Motion;
use crate::position::Position;
use crate::scene::{ContactDetector, ContactThreshold, Interaction, Plan, ScenePlayer};

/// Number of words in a texture's digest: 10 s at 5 kHz.
pub const DIGEST_WORDS: u32 = 50_000;

/// Seed with which textures are played for their digests.
pub const DIGEST_SEED: u64 = 1;

/// A digest that depends on each word and on their order: FNV-1a (Fowler, Noll and Vo), 32 bits, over whole words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest(u32);

impl Default for Digest {
    /// The digest of no word.
    fn default() -> Self {
        Self(0x811c_9dc5)
    }
}

impl Digest {
    /// Adds the word of `sample`.
    #[inline]
    pub fn add(&mut self, sample: OutputSample) {
        self.0 = (self.0 ^ sample.0.cast_unsigned()).wrapping_mul(0x0100_0193);
    }

    /// The digest of the words so far.
    pub const fn value(self) -> u32 {
        self.0
    }
}

/// The fixed stroke at one block: 2 ms at each rate that a stylus plays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Tangential speed, mm/s, signed by the direction.
    pub speed_mm_s: f32,
    /// Normal force, N; not negative.
    pub force_n: f32,
    /// Position at the block's first sample, mm.
    pub begin_mm: f64,
    /// Position at the block's last sample, mm.
    pub end_mm: f64,
}

impl Stroke {
    /// The stroke at block `block` of a plan at `sample_rate_hz`. It repeats after 1536 blocks.
    ///
    /// All numbers except positions have few digits, so that they are exact. A position takes two quotients, two
    /// products and a sum of floats, which every platform rounds in the same way.
    pub fn at(block: u32, sample_rate_hz: u32) -> Self {
        // Half the mean speed of a block, mm/s: a triangle from 128 to -128 and back, in 512 blocks.
        const TURN: i32 = 256;
        const FASTEST: i32 = 128;
        let phase = (block % (2 * TURN as u32)).cast_signed();
        let speed = (phase - TURN).abs() - FASTEST;
        // Sum of these half speeds over the earlier blocks, which is 0 after each period.
        let falling = |blocks: i32| FASTEST * blocks - blocks * (blocks - 1) / 2;
        let rising = |blocks: i32| blocks * (blocks - 1) / 2 - FASTEST * blocks;
        let gone = if phase <= TURN {
            falling(phase)
        } else {
            falling(TURN) + rising(phase - TURN)
        };
        // A triangle of 384 blocks that is cut off at 0.
        let press = (block % 384).cast_signed().abs_diff(192) as f32 / 64.0 - 0.25;
        let speed_mm_s = (2 * speed) as f32;
        let samples = crate::update_interval_samples(sample_rate_hz);
        let time_s = |samples: u32| f64::from(samples) / f64::from(sample_rate_hz.max(1));
        let begin_mm = f64::from(2 * gone) * time_s(samples);
        Self {
            speed_mm_s,
            force_n: press.max(0.0),
            begin_mm,
            end_mm: begin_mm + f64::from(speed_mm_s) * time_s(samples - 1),
        }
    }

    /// Returns the interaction at this block, with contact as `detector` finds it from the force.
    pub fn interaction(&self, detector: &mut ContactDetector) -> Interaction {
        // All numbers of the stroke are finite, so that neither constructor refuses them.
        let motion = Motion::new(MillimetresPerSecond(self.speed_mm_s), Newton(self.force_n));
        let motion = motion.unwrap_or(Motion::REST);
        let contact = detector.touches(motion, ContactThreshold::LEAST);
        let interaction = Interaction::new(motion, self.begin_mm as f32, contact);
        let end = Position::from_exact_mm(self.end_mm);
        interaction.unwrap_or(Interaction::NONE).reaching(Some(end))
    }
}

/// Plays the first [`DIGEST_WORDS`] words of `plan` along the stroke, with [`DIGEST_SEED`] and the arithmetic `A`.
pub fn of_plan<A: Arithmetic>(plan: Plan<'_>) -> Digest {
    let (rate, samples) = (plan.sample_rate_hz(), plan.block_samples());
    let mut player = ScenePlayer::<A>::new(plan, DIGEST_SEED);
    let mut detector = ContactDetector::new();
    let mut digest = Digest::default();
    for sample in 0..DIGEST_WORDS {
        if sample.is_multiple_of(samples) {
            let stroke = Stroke::at(sample / samples, rate);
            player.follow(stroke.interaction(&mut detector), samples);
        }
        digest.add(player.next_sample());
    }
    digest
}
