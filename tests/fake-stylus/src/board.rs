//! What the device measures: the board, as the self test finds it, and the motion of a hand, as the sensors find it. By
//! default the board is healthy and the hand at rest; a test changes some of the values.

use model_format::AdcCode;
use model_format::link::{
    CONVERSIONS_PER_CODE, ChipValues, ClockCount, ClockValues, ErrorCorrectionValues, OUTPUT_CODES, OptionByteValues,
    OutputValues, RAM_MONITORS, REST_CONVERSIONS, RecordSample, RestValues, STEP_CODES, STEP_INSTANTS, SelfTestError,
    Setting, Settings, output_code,
};
use stylus_app::SAMPLE_RATE_HZ;

const CORE_HZ: u32 = 400_000_000;
const TIMER_HZ: u32 = 200_000_000;

/// The values of each measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// The silicon.
    pub chip: ChipValues,
    /// The option bytes.
    pub option_bytes: OptionByteValues,
    /// The clocks.
    pub clocks: ClockValues,
    /// Counters of the memories' error correction.
    pub error_correction: ErrorCorrectionValues,
    /// The output's pin, or the failure to read it.
    pub output: Result<OutputValues, SelfTestError>,
    /// The output's pin at rest, or the failure to read it.
    pub rest: Result<RestValues, SelfTestError>,
    /// The level at which the encoder's first line is stuck. If `None`, the line follows the count.
    pub stuck_line: Option<bool>,
    /// Apparent duration of an operation of the flash, µs.
    pub flash_us: u32,
}

impl Default for Board {
    /// A healthy board.
    fn default() -> Self {
        Self {
            chip: ChipValues {
                device: 0x450,
                revision: 0x2003,
                // The serial number of the fake device.
                unique_id: [0x6745_2301, 0xEFCD_AB89, 0x6745_2301],
                flash_kb: 2048,
                package: 2,
            },
            option_bytes: OptionByteValues {
                // A new part has 0x0406_AAF0. The brown-out level is 3 here.
                status: 0x0406_AAFC,
                banks_swapped: false,
                writable_sectors: [0xff; 2],
                read_protected: [0xff; 2],
                secure: [0x8000_00ff; 2],
                boot: 0x1FF0_0800,
            },
            clocks: ClockValues {
                core_hz: CORE_HZ,
                timer_hz: TIMER_HZ,
                low_speed: Some(ClockCount {
                    periods: 8_000,
                    cycles: 8_000 * u64::from(TIMER_HZ) / 32_000,
                }),
                usb_frames: Some(ClockCount {
                    periods: 1_000,
                    cycles: CORE_HZ.into(),
                }),
                ticks: ClockCount {
                    periods: SAMPLE_RATE_HZ,
                    cycles: CORE_HZ.into(),
                },
            },
            error_correction: ErrorCorrectionValues {
                ram: [0; RAM_MONITORS],
                flash_corrected: [0; 2],
                flash_failed: [0; 2],
            },
            output: Ok(Self::output(|code| code)),
            rest: Ok(Self::rest(2048.0)),
            stuck_line: None,
            flash_us: 50,
        }
    }
}

impl Board {
    /// Returns the values of an output whose pin rests at `code`, with the noise of the converter.
    pub fn rest(code: f64) -> RestValues {
        let word = (code * 16.0).round().clamp(16.0, 65_519.0) as u16;
        RestValues {
            sum: u32::from(word) * REST_CONVERSIONS,
            range: [word - 16, word + 16],
        }
    }

    /// Returns the values of an output whose pin reads `pin(code)` codes while `code` is put out.
    pub fn output(pin: impl Fn(f64) -> f64) -> OutputValues {
        let word = |code: u16| (pin(code.into()) * 16.0).round().clamp(0.0, 65_535.0);
        let mut step_words = [word(STEP_CODES[1]) as u16; STEP_INSTANTS];
        step_words[0] = word(STEP_CODES[0]) as u16;
        let codes: [u16; OUTPUT_CODES] = std::array::from_fn(output_code);
        OutputValues {
            sums: codes.map(|code| (word(code) * f64::from(CONVERSIONS_PER_CODE)) as u32),
            noise: 6.0,
            step_words,
            sample_cycles: 144,
        }
    }
}

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
