//! The sample rate, and newtypes with their scales for physical quantities and for converter codes.

/// Sample rate of the device's tick, of recordings, and by default of models, Hz. The sample period is 200 µs.
pub const SAMPLE_RATE_HZ: u32 = 5_000;

/// Sample rate of a texture or scene that a stylus can play.
///
/// A tick takes 200 µs at either rate. The inputs, the update of coefficients and all limits keep the timing of the
/// tick. At 10 kHz, each tick computes two samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlayRate {
    /// One sample per tick.
    #[default]
    Hz5000,
    /// Two samples per tick.
    Hz10000,
}

impl PlayRate {
    /// All rates, the default first.
    pub const ALL: [Self; 2] = [Self::Hz5000, Self::Hz10000];

    /// Returns the rate of `sample_rate_hz` samples per second, or none if a stylus cannot play it.
    pub const fn of(sample_rate_hz: u32) -> Option<Self> {
        let mut index = 0;
        while index < Self::ALL.len() {
            if Self::ALL[index].hz() == sample_rate_hz {
                return Some(Self::ALL[index]);
            }
            index += 1;
        }
        None
    }

    /// Samples per second.
    pub const fn hz(self) -> u32 {
        SAMPLE_RATE_HZ * self.samples_per_tick()
    }

    /// Samples per tick.
    pub const fn samples_per_tick(self) -> u32 {
        match self {
            Self::Hz5000 => 1,
            Self::Hz10000 => 2,
        }
    }
}

/// A voltage, V.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Volt(pub f32);

/// An acceleration, m/s².
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct MetresPerSecondSquared(pub f32);

/// A force, N. A normal force is positive when the tool presses on the surface.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Newton(pub f32);

/// A speed, mm/s. A tangential speed is the magnitude of the tool's velocity along the surface.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct MillimetresPerSecond(pub f32);

/// Supply and reference voltage of the board's analogue circuits, V.
const REFERENCE_VOLT: f32 = 3.3;

/// A code of a 16-bit analogue-to-digital converter: code 0 is 0 V, 65 536 would be 3.3 V.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct AdcCode(pub u16);

impl AdcCode {
    /// Voltage of one code.
    pub const STEP: Volt = Volt(REFERENCE_VOLT / 65_536.0);

    /// The voltage on the pin.
    pub fn volt(self) -> Volt {
        Volt(f32::from(self.0) * Self::STEP.0)
    }
}

/// A code of a 12-bit digital-to-analogue converter: code 0 is 0 V, 4096 would be 3.3 V.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct DacCode(u16);

impl DacCode {
    /// Voltage of one code.
    pub const STEP: Volt = Volt(REFERENCE_VOLT / 4096.0);

    /// Mid-scale, at which the coil carries no current.
    pub const MID_SCALE: Self = Self(2048);

    /// The highest code.
    pub const MAX: Self = Self(4095);

    /// The code itself, at most [`DacCode::MAX`].
    pub const fn get(self) -> u16 {
        self.0
    }

    /// The code `offset` steps from mid-scale, saturated to the converter's range.
    pub fn from_mid_scale(offset: i32) -> Self {
        // Saturated, because a large offset would otherwise wrap to the other end of the range.
        let code = i32::from(Self::MID_SCALE.0).saturating_add(offset);
        Self(code.clamp(0, i32::from(Self::MAX.0)) as u16)
    }

    /// The voltage on the pin.
    pub fn volt(self) -> Volt {
        Volt(f32::from(self.0) * Self::STEP.0)
    }
}

/// A sample of the kernel's output: acceleration in fixed point, in steps of 2⁻²⁰ m/s², full scale ±2048 m/s².
///
/// A step is about 1 µm/s². That is far below what can be felt, so one scale serves every texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct OutputSample(pub i32);

impl OutputSample {
    /// Binary digits after the point.
    pub const FRACTION_BITS: u32 = 20;

    /// Exact silence.
    pub const SILENCE: Self = Self(0);

    /// The acceleration, rounded to `f32`.
    pub fn metres_per_second_squared(self) -> MetresPerSecondSquared {
        MetresPerSecondSquared(self.0 as f32 / (1u32 << Self::FRACTION_BITS) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dac_codes_saturate_and_centre_on_mid_scale() {
        assert_eq!(DacCode::from_mid_scale(0), DacCode::MID_SCALE);
        assert_eq!(DacCode::from_mid_scale(i32::MAX), DacCode::MAX);
        assert_eq!(DacCode::from_mid_scale(i32::MIN).get(), 0);
        assert!((DacCode::MID_SCALE.volt().0 - REFERENCE_VOLT / 2.0).abs() < 1e-6);
    }

    #[test]
    fn converter_steps_span_the_reference() {
        assert!((AdcCode(u16::MAX).volt().0 - (REFERENCE_VOLT - AdcCode::STEP.0)).abs() < 1e-6);
        assert_eq!(AdcCode(0).volt(), Volt(0.0));
    }

    #[test]
    fn an_output_step_is_a_2_pow_20th_of_a_metre_per_second_squared() {
        let one = OutputSample(1 << OutputSample::FRACTION_BITS);
        assert_eq!(one.metres_per_second_squared(), MetresPerSecondSquared(1.0));
    }
}
