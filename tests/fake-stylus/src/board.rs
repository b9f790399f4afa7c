//! The board that the self test measures. By default all values are those of a healthy board; a test changes some of
//! them.

use model_format::link::{
    CONVERSIONS_PER_CODE, ChipValues, ClockCount, ClockValues, ErrorCorrectionValues, OUTPUT_CODES, OptionByteValues,
    OutputValues, RAM_MONITORS, REST_CONVERSIONS, RestValues, STEP_CODES, STEP_INSTANTS, SelfTestError, output_code,
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
