//! ADC2, which reads the output's own pin: PA4 is DAC1_OUT1 and INP18 of both ADC1 and ADC2 (DS12110, pin definitions).
//!
//! ADC1 converts for the tick, so it is not touched. ADC2 shares the clock of ADC1, which is on, and the reset, which
//! is therefore not used. ADC2 is in deep power-down before and after.

use cortex_m::asm;
use cortex_m::peripheral::DWT;
use embassy_futures::yield_now;
use embassy_stm32::pac::ADC2;
use embassy_stm32::pac::adc::vals::{Adcaldif, Difsel, Exten, Ovrmod, Pcsel, SampleTime};
use embassy_time::{Duration, Instant, Timer};
use model_format::link::SelfTestError;

use crate::boot::clock::{CONVERTER_BOOST, CORE_HZ};
use crate::self_test::clocks::since;

/// Channel of PA4.
const CHANNEL: usize = 18;

/// Limit of the waits for the converter. The longest wait, for a calibration, takes 165 010 of the converter's cycles,
/// 13 ms.
const LIMIT: Duration = Duration::from_millis(100);

/// Wait for the regulator, many times its start-up time of 10 µs (DS12110, ADC characteristics, t_ADCVREG_STUP).
const REGULATOR: Duration = Duration::from_millis(1);

/// Limit of a conversion, cycles of the core: many times the 73 cycles of the converter.
const CONVERSION_CYCLES: u32 = CORE_HZ / 10_000;

/// The converter, calibrated and enabled. When this is dropped, the converter returns to deep power-down.
pub struct ReadBack(());

/// A failure of the hardware.
pub fn fault(what: &'static str) -> SelfTestError {
    SelfTestError::Hardware {
        // Fits.
        what: what.try_into().unwrap_or_default(),
    }
}

async fn becomes(is_there: impl Fn() -> bool, what: &'static str) -> Result<(), SelfTestError> {
    let begin = Instant::now();
    while !is_there() {
        if since(begin) > LIMIT {
            return Err(fault(what));
        }
        yield_now().await;
    }
    Ok(())
}

impl ReadBack {
    /// Wakes, calibrates and enables the converter (RM0433 sections 25.4.6 to 25.4.9).
    pub async fn start() -> Result<Self, SelfTestError> {
        // From here on a failure drops this value, which puts the converter to sleep.
        let read_back = Self(());
        ADC2.cr().modify(|w| {
            w.set_deeppwd(false);
            w.set_boost(CONVERTER_BOOST);
        });
        ADC2.cr().modify(|w| w.set_advregen(true));
        // Waits for a fixed time, because revisions Z and Y have no flag that shows when the regulator is ready.
        Timer::after(REGULATOR).await;
        ADC2.difsel().modify(|w| w.set_difsel(CHANNEL, Difsel::SINGLE_ENDED));
        ADC2.cr().modify(|w| {
            w.set_adcaldif(Adcaldif::SINGLE_ENDED);
            w.set_adcallin(true);
        });
        ADC2.cr().modify(|w| w.set_adcal(true));
        becomes(|| !ADC2.cr().read().adcal(), "ADC2's calibration does not end").await?;
        ADC2.isr().write(|w| w.set_adrdy(true));
        ADC2.cr().modify(|w| w.set_aden(true));
        becomes(|| ADC2.isr().read().adrdy(), "ADC2 does not become ready").await?;
        ADC2.cfgr().modify(|w| {
            w.set_cont(false);
            w.set_exten(Exten::DISABLED);
            w.set_ovrmod(Ovrmod::OVERWRITE);
        });
        ADC2.pcsel().write(|w| w.set_pcsel(CHANNEL, Pcsel::PRESELECTED));
        ADC2.sqr1().write(|w| w.set_sq(0, CHANNEL as u8));
        read_back.sample_for(SampleTime::CYCLES64_5);
        Ok(read_back)
    }

    /// Sets the sampling time.
    #[expect(clippy::unused_self, reason = "the value is the right to do it")]
    pub fn sample_for(&self, time: SampleTime) {
        ADC2.smpr(1).modify(|w| w.set_smp(CHANNEL - 10, time));
    }

    /// Orders a conversion.
    #[expect(clippy::unused_self, reason = "the value is the right to do it")]
    #[inline(always)]
    pub fn order(&self) {
        ADC2.cr().modify(|w| w.set_adstart(true));
    }

    /// Waits for the end of the conversion that was ordered, and returns its code.
    #[expect(clippy::unused_self, reason = "the value is the right to do it")]
    #[expect(
        clippy::result_large_err,
        reason = "without allocation the error is as large as its longest text"
    )]
    pub fn word(&self) -> Result<u16, SelfTestError> {
        let begin = DWT::cycle_count();
        while !ADC2.isr().read().eoc() {
            if DWT::cycle_count().wrapping_sub(begin) > CONVERSION_CYCLES {
                return Err(fault("ADC2 does not convert"));
            }
        }
        // Reading clears the flag (RM0433 section 25.6.1).
        Ok(ADC2.dr().read().rdata())
    }
}

impl Drop for ReadBack {
    /// Disables the converter, which is idle within the time of a conversion, and puts it to sleep.
    fn drop(&mut self) {
        let begin = DWT::cycle_count();
        let waited = || DWT::cycle_count().wrapping_sub(begin) > CONVERSION_CYCLES;
        while ADC2.cr().read().adstart() && !waited() {
            asm::nop();
        }
        if ADC2.cr().read().aden() {
            ADC2.cr().modify(|w| w.set_addis(true));
            while ADC2.cr().read().aden() && !waited() {
                asm::nop();
            }
        }
        ADC2.cr().modify(|w| w.set_advregen(false));
        ADC2.cr().modify(|w| w.set_deeppwd(true));
    }
}
