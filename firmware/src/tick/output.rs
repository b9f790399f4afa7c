//! The output: channel 1 of DAC1 on PA4, RM0433 chapter 26.
//!
//! While the tick runs, TIM6's trigger moves the holding register to the output, so that software never shifts the
//! instant. Before that, and after a fault, the trigger is off and a written code takes effect at once.
//! `boot/startup.rs` turns the channel on, at mid-scale, before anything else runs.

use embassy_stm32::pac::{DAC1, RCC};
use model_format::DacCode;

/// Channel 1, in the numbering of the registers.
const CHANNEL: usize = 0;

/// TIM6_TRGO as a trigger of the DAC (RM0433 table 213, dac_chx_trg5).
const TRIGGER_TIM6: u8 = 5;

/// Lets TIM6 move written codes to the output (RM0433 section 26.4.7).
pub fn follow_timer() {
    DAC1.cr().modify(|w| w.set_tsel(CHANNEL, TRIGGER_TIM6));
    DAC1.cr().modify(|w| w.set_ten(CHANNEL, true));
}

/// Sets the output to mid-scale within a cycle of the bus clock, with or without the trigger, whatever the timer does
/// later.
///
/// With the trigger off, the holding register goes to the output one bus cycle after it is written (RM0433 section
/// 26.4.6).
#[inline(always)]
pub fn mid_scale_now() {
    // A fault may come before the clock is on.
    RCC.apb1lenr().modify(|w| w.set_dac12en(true));
    let _ = RCC.apb1lenr().read();
    DAC1.cr().modify(|w| w.set_ten(CHANNEL, false));
    write(DacCode::MID_SCALE);
}

/// Writes the code that the next trigger moves to the output.
#[inline(always)]
pub fn write(code: DacCode) {
    DAC1.dhr12r(CHANNEL).write(|w| w.set_dhr(code.get()));
}
