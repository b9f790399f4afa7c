//! A scene played on the host: the very samples that the stylus plays for the same motion, block by block.

use model_format::OutputSample;
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::{ContactDetector, Interaction, Plan, ScenePlayer};

use crate::playing::motion::MotionPath;
use crate::playing::render::MAX_SECONDS;
use crate::support::error::{Error, Result};

/// The hand of a motion, as a scene follows it: its place and whether it touches go with speed and force.
#[derive(Clone, Debug)]
pub struct Hand<'a> {
    motion: &'a MotionPath,
    detector: ContactDetector,
}

impl<'a> Hand<'a> {
    /// Not touching yet.
    pub fn new(motion: &'a MotionPath) -> Self {
        Self {
            motion,
            detector: ContactDetector::new(),
        }
    }

    /// What it does at `time_s`. Asked for one moment after the other, as it detects contact on the way where the motion does
    /// not tell it.
    pub fn at(&mut self, time_s: f64) -> Interaction {
        let motion = self.motion.at(time_s);
        let touches = self.detector.touches(motion);
        let contact = self.motion.contact_at(time_s).unwrap_or(touches);
        let farthest = f64::from(f32::MAX);
        let position_mm = self
            .motion
            .position_mm_at(time_s)
            .clamp(-farthest, farthest);
        Interaction::new(motion, position_mm as f32, contact)
            .expect("a position within finite bounds is finite")
    }
}

/// A scene as it is played along a motion, sample by sample; nothing is kept.
///
/// The same scene, library, motion and seed give the same samples, always and everywhere.
#[derive(Clone, Debug)]
pub struct SceneRendering<'a> {
    player: ScenePlayer<'a>,
    hand: Hand<'a>,
    sample_rate_hz: u32,
    position: usize,
    len: usize,
}

impl<'a> SceneRendering<'a> {
    /// `seconds` of `plan`, from rest without contact.
    ///
    /// # Errors
    /// A duration that is not a number, is shorter than a sample, or longer than [`MAX_SECONDS`].
    pub fn new(plan: Plan<'a>, motion: &'a MotionPath, seconds: f64, seed: u64) -> Result<Self> {
        let sample_rate_hz = plan.sample_rate_hz();
        let samples = (seconds * f64::from(sample_rate_hz)).round();
        if !(seconds <= MAX_SECONDS && samples >= 1.0) {
            return Err(Error::Request(format!(
                "cannot render {seconds} s: ask for at least one sample and at most {MAX_SECONDS} s"
            )));
        }
        Ok(Self {
            player: ScenePlayer::new(plan, seed),
            hand: Hand::new(motion),
            sample_rate_hz,
            position: 0,
            len: samples as usize,
        })
    }

    /// How many samples were at full scale so far.
    pub fn saturations(&self) -> u32 {
        self.player.saturations()
    }

    /// Samples a second.
    pub fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }
}

impl Iterator for SceneRendering<'_> {
    type Item = OutputSample;

    fn next(&mut self) -> Option<OutputSample> {
        if self.position == self.len {
            return None;
        }
        if self
            .position
            .is_multiple_of(UPDATE_INTERVAL_SAMPLES as usize)
        {
            let time_s = self.position as f64 / f64::from(self.sample_rate_hz);
            let interaction = self.hand.at(time_s);
            self.player.follow(interaction, UPDATE_INTERVAL_SAMPLES);
        }
        self.position += 1;
        Some(self.player.next_sample())
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.len - self.position;
        (left, Some(left))
    }
}

impl ExactSizeIterator for SceneRendering<'_> {}
