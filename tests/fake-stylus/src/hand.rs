//! The motion of a hand, as the fake's sensors measure it.

use model_format::AdcCode;
use model_format::link::{RecordSample, Setting, Settings};
use stylus_app::SAMPLE_RATE_HZ;

/// A hand that moves the stylus with constant speed and force.
#[derive(Clone, Debug)]
pub struct Hand {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Converter codes of the three axes of acceleration, repeated forever.
    pub acceleration: Vec<[u16; 3]>,
    /// True if the wire of the force sensor is open, so that a pull-down resistor pulls its pin to the lower rail.
    pub is_open: bool,
    /// Noise of the force's converter, codes: each code is up to so far from the force's, to either side.
    pub force_noise: u16,
    /// Position that the tip moves to and stays at, counts of the encoder from the start. If `None`, the tip moves at
    /// its speed.
    pub goal_counts: Option<i64>,
}

/// Largest number of counts per tick at which a tip moves to its goal.
const GOAL_COUNTS_PER_TICK: i64 = 40;

impl Default for Hand {
    /// A hand at rest.
    fn default() -> Self {
        Self {
            speed_mm_s: 0.0,
            force_n: 0.0,
            acceleration: vec![[32_768; 3]],
            is_open: false,
            force_noise: 0,
            goal_counts: None,
        }
    }
}

impl Hand {
    /// A hand that moves at this speed and force.
    pub fn moving(speed_mm_s: f64, force_n: f64) -> Self {
        Self {
            speed_mm_s,
            force_n,
            ..Self::default()
        }
    }

    /// Returns the noise of the force's converter at `tick`, codes.
    fn disturbance(&self, tick: u64) -> f64 {
        let hashed = tick.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
        let noise = u64::from(self.force_noise);
        (hashed % (2 * noise + 1)) as f64 - noise as f64
    }

    /// Returns the converters' codes and the encoder's step at `tick` for a tip at `place`, under the default settings.
    pub fn sample(&self, tick: u64, place: i64) -> RecordSample {
        let settings = Settings::default();
        let per_volt = f64::from(settings.get(Setting::ForcePerVolt));
        let path = f64::from(settings.get(Setting::PathPerCount));
        let zero = f64::from(settings.force_zero().0);
        let force = zero + self.force_n / per_volt / f64::from(AdcCode::STEP.0);
        // A step is the difference of two positions, so that the rounding to counts does not add up.
        let counts = |tick: u64| {
            let per_tick = self.speed_mm_s / path / f64::from(SAMPLE_RATE_HZ);
            (tick as f64 * per_tick).floor() as i64
        };
        let index = tick % self.acceleration.len() as u64;
        RecordSample {
            acceleration: self.acceleration[index as usize].map(AdcCode),
            force: AdcCode(if self.is_open {
                0
            } else {
                // The cast keeps a force beyond the range at the range's end.
                (force.round() + self.disturbance(tick)) as u16
            }),
            encoder_delta: match self.goal_counts {
                Some(goal) => (goal - place).clamp(-GOAL_COUNTS_PER_TICK, GOAL_COUNTS_PER_TICK) as i16,
                None => (counts(tick + 1) - counts(tick)) as i16,
            },
        }
    }
}
