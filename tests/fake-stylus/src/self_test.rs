//! The self test's measurements of a fake device: those of its board.

use std::cell::Cell;

use model_format::link::{
    ChipValues, ClockValues, EncoderValues, ErrorCorrectionValues, OptionByteValues, OutputValues,
    RestValues, SelfTestError,
};
use stylus_app::SAMPLE_RATE_HZ;
use stylus_app::control::Device;
use stylus_app::self_test::Bench;

use crate::board::Board;
use crate::device::SharedControl;

/// The board of a device, and its clock.
pub struct BoardOf {
    control: SharedControl,
    /// Time that operations of the flash have taken, µs.
    flash_us: Cell<u32>,
}

impl BoardOf {
    /// The board of the device of `control`.
    pub fn new(control: SharedControl) -> Self {
        Self {
            control,
            flash_us: Cell::new(0),
        }
    }

    fn board(&self) -> Board {
        self.control.borrow_mut().device().board.clone()
    }
}

impl Bench for BoardOf {
    fn chip(&self) -> ChipValues {
        self.board().chip
    }

    fn option_bytes(&self) -> OptionByteValues {
        self.board().option_bytes
    }

    fn error_correction(&self) -> ErrorCorrectionValues {
        self.board().error_correction
    }

    fn encoder(&self) -> EncoderValues {
        let stuck = self.board().stuck_line;
        let count = self.control.borrow_mut().device().encoder_count();
        let half = count >> 1;
        EncoderValues {
            count,
            levels: [stuck.unwrap_or((count ^ half) & 1 != 0), half & 1 != 0],
        }
    }

    async fn clocks(&mut self) -> ClockValues {
        self.board().clocks
    }

    async fn output(&mut self) -> Result<OutputValues, SelfTestError> {
        self.board().output
    }

    async fn rest(&mut self) -> Result<RestValues, SelfTestError> {
        self.board().rest
    }

    /// Each reading comes after an operation of the flash, or before one.
    fn now_us(&self) -> u32 {
        let before = self.flash_us.get();
        self.flash_us
            .set(before.wrapping_add(self.board().flash_us));
        let ticks = self.control.borrow_mut().device().now();
        before.wrapping_add(ticks as u32 * (1_000_000 / SAMPLE_RATE_HZ))
    }
}
