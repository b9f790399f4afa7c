//! A hand along a motion: what the stylus knows of it at each update.

use stylus_kernel::position::Position;
use stylus_kernel::scene::{ContactDetector, ContactThreshold, Interaction};

use super::MotionPath;

/// A hand that follows a motion: position and contact beside speed and force.
///
/// If the motion does not give contact, the force does, above [`ContactThreshold::LEAST`]: a file's forces have no
/// converter's noise, from which a stylus derives a threshold of its own.
#[derive(Clone, Debug)]
pub struct Hand<'a> {
    motion: &'a MotionPath,
    detector: ContactDetector,
}

impl<'a> Hand<'a> {
    /// A hand on `motion` without contact so far.
    pub fn new(motion: &'a MotionPath) -> Self {
        Self {
            motion,
            detector: ContactDetector::new(),
        }
    }

    /// The interaction at `time_s`. Times must ascend from call to call, because contact is detected from the force's
    /// history if the motion does not give it.
    pub fn at(&mut self, time_s: f64) -> Interaction {
        let motion = self.motion.at(time_s);
        let touches = self.detector.touches(motion, ContactThreshold::LEAST);
        let contact = self.motion.contact_at(time_s).unwrap_or(touches);
        let farthest = f64::from(f32::MAX);
        let position_mm = self
            .motion
            .position_mm_at(time_s)
            .clamp(-farthest, farthest);
        Interaction::new(motion, position_mm as f32, contact)
            .expect("a position within finite bounds is finite")
    }

    /// The interaction of [`Hand::at`] for the block that is decided at `time_s` and whose last sample is `block_s`
    /// later. Lines that are locked to place are told the position at that sample, because the motion is known ahead.
    pub fn for_block(&mut self, time_s: f64, block_s: f64) -> Interaction {
        let end_mm = self.motion.position_mm_at(time_s + block_s);
        let position = Position::from_exact_mm(end_mm);
        self.at(time_s).reaching(Some(position))
    }
}
