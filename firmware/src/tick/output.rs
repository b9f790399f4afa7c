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

/// The output, moved by hand for the self test, while the amplifier is disabled and nothing is played.
///
/// The tick goes on writing mid-scale to the holding register, which reaches the pin only by the software trigger. So a
/// code that was triggered stays, and one that the tick has overwritten before its trigger shows in [`ByHand::is_out`].
/// Dropped, the output is at mid-scale and follows the timer again.
pub struct ByHand(());

/// The software trigger (RM0433 table 213, dac_chx_trg0).
const TRIGGER_SOFTWARE: u8 = 0;

/// Attempts to have a code out, of which the tick disturbs one in some hundred.
const ATTEMPTS: usize = 8;

impl ByHand {
    /// Disables the amplifier and takes the output. The output is at rest, so the holding register is at mid-scale.
    pub fn take() -> Self {
        amplifier_off();
        let by_hand = Self(());
        by_hand.follow(TRIGGER_SOFTWARE);
        by_hand
    }

    /// Changes the trigger. Without one, mid-scale goes to the pin, where it is already or belongs.
    fn follow(&self, trigger: u8) {
        DAC1.cr().modify(|w| w.set_ten(CHANNEL, false));
        DAC1.cr().modify(|w| w.set_tsel(CHANNEL, trigger));
        DAC1.cr().modify(|w| w.set_ten(CHANNEL, true));
    }

    /// Writes the code that [`ByHand::trigger`] moves to the pin.
    #[inline(always)]
    pub fn load(&self, code: DacCode) {
        DAC1.dhr12r(CHANNEL).write(|w| w.set_dhr(code.get()));
    }

    /// Moves the loaded code to the pin.
    #[inline(always)]
    pub fn trigger(&self) {
        DAC1.swtrigr().write(|w| w.set_swtrig(CHANNEL, true));
    }

    /// Returns true if `code` is on the pin.
    pub fn is_out(&self, code: DacCode) -> bool {
        DAC1.dor(CHANNEL).read().dor() == code.get()
    }

    /// Moves `code` to the pin; false if the output does not take it.
    pub fn set(&self, code: DacCode) -> bool {
        (0..ATTEMPTS).any(|_| {
            self.load(code);
            self.trigger();
            // The register follows its trigger by up to three cycles of the bus, of four of the core each (RM0433
            // section 26.4.7).
            cortex_m::asm::delay(16);
            self.is_out(code)
        })
    }
}

impl Drop for ByHand {
    fn drop(&mut self) {
        let _ = self.set(DacCode::MID_SCALE);
        self.load(DacCode::MID_SCALE);
        self.follow(TRIGGER_TIM6);
        amplifier_as_before();
    }
}

/// Disables the amplifier. This board's has no input for that, so the user switches it off.
fn amplifier_off() {}

/// Lets the amplifier be enabled again by what is played.
fn amplifier_as_before() {}

/// Writes the code that the next trigger moves to the output.
#[inline(always)]
pub fn write(code: DacCode) {
    DAC1.dhr12r(CHANNEL).write(|w| w.set_dhr(code.get()));
}
