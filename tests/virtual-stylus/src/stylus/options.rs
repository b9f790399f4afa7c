//! How a run begins.

use std::num::NonZeroU64;

use crate::model::adc::Pins;
use crate::model::flash::{Contents, Moment};
use crate::pins::ConstantPins;

/// 400 MHz at two cycles an instruction, where a Cortex-M7 often retires two instructions a cycle.
pub const PESSIMISTIC_INSTRUCTIONS_PER_SECOND: NonZeroU64 =
    NonZeroU64::new(200_000_000).expect("not zero");
/// How a run begins.
#[derive(Debug)]
pub struct Options {
    /// What the flash holds before the image is put into it.
    pub flash: Contents,
    /// Leaves the image out of the flash: what it holds is what runs, as after a power cut.
    pub keep_flash: bool,
    /// How fast the core is in virtual time.
    pub instructions_per_second: NonZeroU64,
    /// What is on the converter's pins.
    pub pins: Box<dyn Pins>,
    /// Cuts the power at this flash operation, counted from 1, at this moment of it.
    pub power_cut: Option<(u64, Moment)>,
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
            watch_ticks: true,
        }
    }
}
