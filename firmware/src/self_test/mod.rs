//! Measurements of the self test, as `stylus_app::self_test` requests them.
//!
//! Everything here runs in the storage's task, for about a millisecond at most between two yields. Nothing here stops
//! the tick or touches the tick's converter. Each measurement restores what it changed before it ends, whatever the
//! host does meanwhile.

pub mod chip;
mod clocks;
mod output;

use embassy_time::Instant;
use model_format::link::{
    ChipValues, ClockValues, EncoderValues, ErrorCorrectionValues, OptionByteValues, OutputValues, RestValues,
    SelfTestError,
};
use stylus_app::self_test::SelfTestHardware;
use stylus_board::{BOARD, Pin};

use crate::tick::inputs;

const ENCODER: [Pin; 2] = [BOARD.pins.encoder_a, BOARD.pins.encoder_b];

/// The hardware that is measured.
pub struct BoardHardware;

impl SelfTestHardware for BoardHardware {
    fn chip(&self) -> ChipValues {
        chip::identity()
    }

    fn option_bytes(&self) -> OptionByteValues {
        chip::option_bytes()
    }

    fn error_correction(&self) -> ErrorCorrectionValues {
        chip::memory_errors()
    }

    /// An input register shows a pin's level whatever the pin's function (RM0433 section
    /// 11.3.1).
    fn encoder(&self) -> EncoderValues {
        EncoderValues {
            count: inputs::encoder_count(),
            levels: ENCODER.map(|pin| pin.registers().idr().read().0 >> pin.number & 1 != 0),
        }
    }

    async fn clocks(&mut self) -> ClockValues {
        clocks::count().await
    }

    async fn output(&mut self) -> Result<OutputValues, SelfTestError> {
        output::measure().await
    }

    async fn rest(&mut self) -> Result<RestValues, SelfTestError> {
        output::rest().await
    }

    fn now_us(&self) -> u32 {
        Instant::now().as_micros() as u32
    }
}
