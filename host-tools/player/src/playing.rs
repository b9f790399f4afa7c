//! A choice being played along the motion of each block, like on the device.

use model_format::{MillimetresPerSecond, Newton, OutputSample};
use stylus_kernel::position::Position;
use stylus_kernel::scene::{ContactDetector, ContactThreshold, Interaction, Plan, ScenePlayer};
use stylus_kernel::{Motion, MotionError};

/// Count of the numbers that describe a block's motion.
pub const BLOCK_NUMBERS: usize = 5;

/// The motion of one block. A value that is not a number (NaN) is unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockMotion {
    /// Tangential speed, mm/s, signed by the direction.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Position at the block's first sample, mm. It is known if and only if the last sample's position is.
    pub begin_mm: f64,
    /// Position at the block's last sample, mm.
    pub end_mm: f64,
    /// Contact: 0 for none, another number for contact, NaN to derive it from the force.
    pub contact: f64,
}

impl BlockMotion {
    /// A motion whose position and contact follow from speed, mm/s, and force, N.
    pub const fn new(speed_mm_s: f64, force_n: f64) -> Self {
        Self {
            speed_mm_s,
            force_n,
            begin_mm: f64::NAN,
            end_mm: f64::NAN,
            contact: f64::NAN,
        }
    }

    /// The motion of these numbers, in the order of the fields.
    pub const fn of_numbers(numbers: [f64; BLOCK_NUMBERS]) -> Self {
        let [speed_mm_s, force_n, begin_mm, end_mm, contact] = numbers;
        Self {
            speed_mm_s,
            force_n,
            begin_mm,
            end_mm,
            contact,
        }
    }

    /// The numbers of the motion, in the order of the fields.
    pub const fn numbers(self) -> [f64; BLOCK_NUMBERS] {
        [self.speed_mm_s, self.force_n, self.begin_mm, self.end_mm, self.contact]
    }

    /// Returns speed and force in the kernel's form.
    pub(crate) fn motion(&self) -> Result<Motion, &'static str> {
        // A value that is too large for single precision becomes infinite, and is refused.
        let speed = MillimetresPerSecond(self.speed_mm_s as f32);
        let motion = Motion::new(speed, Newton(self.force_n as f32));
        motion.map_err(|error| match error {
            MotionError::Speed => "the speed is not finite: give it in mm/s",
            MotionError::Force => "the force is not finite: give it in N",
        })
    }

    /// Checks that the motion can be played.
    ///
    /// # Errors
    /// A speed or force that is not finite, an infinite position, or only one of the two positions. The error has the
    /// remedy.
    pub fn check(&self) -> Result<(), &'static str> {
        self.motion()?;
        let (begin, end) = (self.begin_mm, self.end_mm);
        if begin.is_nan() != end.is_nan() {
            return Err("one of its two positions is not a number: give both or none");
        }
        if begin.is_infinite() || end.is_infinite() {
            return Err("a position is infinite: give it in mm");
        }
        Ok(())
    }
}

/// A plan and its state. Playing it allocates nothing.
pub struct Playing<'a> {
    plan: Plan<'a>,
    player: ScenePlayer<'a>,
    detector: ContactDetector,
    at_mm: f64,
    contact: bool,
    motion: Motion,
}

impl<'a> Playing<'a> {
    /// Plays `plan` with the noise of `seed`, from rest at the path's origin.
    pub fn new(plan: Plan<'a>, seed: u64) -> Self {
        Self {
            player: ScenePlayer::new(plan.clone(), seed),
            plan,
            detector: ContactDetector::new(),
            at_mm: 0.0,
            contact: false,
            motion: Motion::REST,
        }
    }

    /// The plan.
    pub fn plan(&self) -> &Plan<'a> {
        &self.plan
    }

    /// Position at the end of the last block, mm.
    pub fn at_mm(&self) -> f64 {
        self.at_mm
    }

    /// Contact in the last block.
    pub fn contact(&self) -> bool {
        self.contact
    }

    /// Speed and force of the last block.
    pub fn motion(&self) -> Motion {
        self.motion
    }

    /// Number of samples at full scale since the beginning.
    pub fn saturations(&self) -> u32 {
        self.player.saturations()
    }

    /// Fades out what is playing, from the next block on.
    pub fn leave(&mut self) {
        // A switch fades out what plays. The plan after the fade is never heard, because the caller then takes its next
        // choice.
        self.player.switch(self.plan.clone());
    }

    /// Returns whether something is still fading out, after [`Playing::leave`] and [`Playing::follow`].
    pub fn is_leaving(&self) -> bool {
        self.player.director().is_switching()
    }

    /// Follows `motion` for the next block. A speed or force that is not finite counts as rest.
    pub fn follow(&mut self, motion: &BlockMotion) {
        let samples = self.plan.block_samples();
        let rate_hz = f64::from(self.plan.sample_rate_hz());
        // Positions that are not known are the integral of the speed.
        let (begin_mm, end_mm) = if motion.begin_mm.is_nan() {
            let last_s = f64::from(samples - 1) / rate_hz;
            (self.at_mm, self.at_mm + motion.speed_mm_s * last_s)
        } else {
            (motion.begin_mm, motion.end_mm)
        };
        // An integral is carried to the first sample of the next block. A given position is known only up to the last
        // sample of this one.
        self.at_mm = if motion.begin_mm.is_nan() {
            begin_mm + motion.speed_mm_s * f64::from(samples) / rate_hz
        } else {
            end_mm
        };
        self.motion = motion.motion().unwrap_or(Motion::REST);
        let touches = self.detector.touches(self.motion, ContactThreshold::LEAST);
        self.contact = if motion.contact.is_nan() {
            touches
        } else {
            motion.contact != 0.0
        };
        // A position beyond it would be infinite in single precision, and the interaction refused.
        let farthest = f64::from(f32::MAX);
        let begin_mm = begin_mm.clamp(-farthest, farthest) as f32;
        let interaction = Interaction::new(self.motion, begin_mm, self.contact);
        let interaction = interaction.unwrap_or(Interaction::NONE);
        let end = Position::from_exact_mm(end_mm);
        self.player.follow(interaction.reaching(Some(end)), samples);
    }

    /// Plays the block into `outputs`, which must be long enough for its samples.
    pub fn play(&mut self, outputs: &mut [OutputSample]) {
        self.player.next_block(outputs);
    }
}
