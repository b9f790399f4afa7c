//! Rendering of a scene on the host: the same samples as on the stylus for the same motion, because the same kernel
//! plays them. The motion is updated every [`UPDATE_INTERVAL_SAMPLES`] samples.

use model_format::OutputSample;
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::{ContactDetector, Interaction, Plan, ScenePlayer};

use crate::playing::motion::MotionPath;
use crate::playing::render::SampleClock;
use crate::support::error::Result;

/// A hand that follows a motion: position and contact beside speed and force, as a scene needs them.
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

/// Iterator over the samples of a scene along a motion.
///
/// The same scene, library, motion and seed give the same samples on every machine.
#[derive(Clone, Debug)]
pub struct SceneRendering<'a> {
    player: ScenePlayer<'a>,
    hand: Hand<'a>,
    clock: SampleClock,
}

impl<'a> SceneRendering<'a> {
    /// A rendering of `seconds` of `plan`, from rest without contact.
    ///
    /// # Errors
    /// A duration that is not a number, shorter than a sample, or longer than
    /// [`MAX_SECONDS`](crate::playing::render::MAX_SECONDS).
    pub fn new(plan: Plan<'a>, motion: &'a MotionPath, seconds: f64, seed: u64) -> Result<Self> {
        Ok(Self {
            clock: SampleClock::new(seconds, plan.sample_rate_hz())?,
            player: ScenePlayer::new(plan, seed),
            hand: Hand::new(motion),
        })
    }

    /// Number of samples at full scale so far.
    pub fn saturations(&self) -> u32 {
        self.player.saturations()
    }

    /// Sample rate, Hz.
    pub fn sample_rate_hz(&self) -> u32 {
        self.clock.sample_rate_hz()
    }
}

impl Iterator for SceneRendering<'_> {
    type Item = OutputSample;

    fn next(&mut self) -> Option<OutputSample> {
        if let Some(time_s) = self.clock.next()? {
            let interaction = self.hand.at(time_s);
            self.player.follow(interaction, UPDATE_INTERVAL_SAMPLES);
        }
        Some(self.player.next_sample())
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.clock.size_hint()
    }
}

impl ExactSizeIterator for SceneRendering<'_> {}
