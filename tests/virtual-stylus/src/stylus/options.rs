//! The start of a run.

use std::num::NonZeroU64;

use crate::electrical::Electrical;
use crate::model::adc::Pins;
use crate::model::flash::{Contents, Moment};
use crate::pins::ConstantPins;

/// 400 MHz at two cycles per instruction, where a Cortex-M7 often retires two instructions per cycle.
pub const PESSIMISTIC_INSTRUCTIONS_PER_SECOND: NonZeroU64 =
    NonZeroU64::new(200_000_000).expect("not zero");
/// Options of a run.
#[derive(Debug)]
pub struct Options {
    /// Content of the flash before the image is put into it.
    pub flash: Contents,
    /// Leaves the image out of the flash, and runs its content, as after a power cut.
    pub keep_flash: bool,
    /// Speed of the core in virtual time.
    pub instructions_per_second: NonZeroU64,
    /// Signals on the converter's pins.
    pub pins: Box<dyn Pins>,
    /// Cuts the power at the flash operation with this number, counted from 1, at this moment of it.
    pub power_cut: Option<(u64, Moment)>,
    /// Fills all RAM with noise from this seed before the start; without, RAM holds zeros.
    pub ram_noise: Option<u64>,
    /// Silicon, clocks and supply.
    pub electrical: Electrical,
    /// Follows the ticks.
    pub watch_ticks: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            flash: Contents::default(),
            keep_flash: false,
            instructions_per_second: PESSIMISTIC_INSTRUCTIONS_PER_SECOND,
            pins: Box::new(ConstantPins::default()),
            power_cut: None,
            ram_noise: None,
            electrical: Electrical::default(),
            watch_ticks: true,
        }
    }
}
