//! The motion of a block.

use model_format::{MillimetresPerSecond, Newton};
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
