//! Clock configuration (RM0433 chapter 8), and the two clocks that other rooms compute with.
//!
//! | source | core | 48 MHz of USB | tolerance |
//! |---|---|---|---|
//! | external: 8 MHz, which the board's ST-LINK drives into HSE | 400 MHz, PLL1 | PLL3 | that of a crystal |
//! | internal: HSI, 64 MHz | 400 MHz, PLL1 | HSI48, trimmed by the host's frames | 1 % |
//! | unmultiplied: HSI | 64 MHz | HSI48, trimmed by the host's frames | 1 %; no samples |
//!
//! The wait for HSE is bounded here. embassy's `init` waits for supply and PLLs without a bound. A hang there ends in
//! the watchdog's reset, and the next start takes the next source (`stylus_app::start`).
//!
//! Invariant: [`CORE_HZ`] and [`TIMER_HZ`] are the clocks that [`config`] sets, unless it multiplies none. No check at
//! build time compares them.

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::adc::vals::Boost;
use embassy_stm32::pac::crs::vals::Syncsrc;
use embassy_stm32::pac::timer::regs::SrGp16;
use embassy_stm32::pac::{CRS, RCC, TIM2};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, HSIPrescaler, Hse, HseMode, Hsi48Config, Pll, PllDiv, PllMul,
    PllPreDiv, PllSource, Sysclk, VoltageScale, mux,
};
use embassy_stm32::time::Hertz;
use model_format::link::{ClockSource, SiliconRevision, StartStage};

/// Clock of the core, Hz.
pub const CORE_HZ: u32 = 400_000_000;

/// Clock of the timers on APB1, Hz: twice the clock of that bus, because its prescaler is not 1.
pub const TIMER_HZ: u32 = 200_000_000;

/// Clock of the converters, Hz, on every revision of the silicon.
pub const CONVERTER_HZ: u32 = 12_500_000;

/// Value of ADC_CR.BOOST for it: 6.25 to 12.5 MHz (RM0433 section 25.4.3).
pub const CONVERTER_BOOST: Boost = Boost::LT12_5;

/// Clock of the core from the reset until [`config`] holds: HSI, Hz (RM0433 section 8.5.2).
const RESET_HZ: u32 = 64_000_000;

/// Longest wait for the external clock, ms. A crystal takes some 2 ms (DS12110, HSE oscillator characteristics), the
/// ST-LINK's output less, once its own firmware runs.
const EXTERNAL_LIMIT_MS: u32 = 100;

/// SYNCSRC of CRS_CFGR: start of frame of USB2, the core OTG_FS on PA11 and PA12. embassy's choice, 2, is that of USB1,
/// OTG_HS. The value is that of ST's driver (RCC_CRS_SYNC_SOURCE_USB2); on revision Y it is not verified.
const FRAMES_OF_USB2: u8 = 3;

/// Stage of the start that sets up a clock from `source`.
pub const fn stage(source: ClockSource) -> StartStage {
    match source {
        ClockSource::External => StartStage::ExternalClock,
        ClockSource::Internal => StartStage::InternalClock,
        ClockSource::InternalUnmultiplied => StartStage::UnmultipliedClock,
    }
}

/// Returns the best source that is there and no better than `best`. Waits for the external clock up to
/// [`EXTERNAL_LIMIT_MS`]; the cycle counter must run.
pub fn select(best: ClockSource) -> ClockSource {
    if best == ClockSource::External && !starts_external() {
        return ClockSource::Internal;
    }
    best
}

/// Turns HSE on, in bypass, and returns true once it is ready; false if it is not in time.
fn starts_external() -> bool {
    RCC.cr().modify(|w| w.set_hsebyp(true));
    RCC.cr().modify(|w| w.set_hseon(true));
    let begin = DWT::cycle_count();
    while !RCC.cr().read().hserdy() {
        if DWT::cycle_count().wrapping_sub(begin) > RESET_HZ / 1_000 * EXTERNAL_LIMIT_MS {
            return false;
        }
    }
    true
}

/// Returns the clock configuration from `source` on silicon of `revision`, which `main` passes to embassy once.
///
/// - Core 400 MHz from PLL1, AHB buses 200 MHz, APB buses 100 MHz: the highest clocks that `Scale1` allows.
/// - USB: 48 MHz.
/// - ADC: [`CONVERTER_HZ`]. From PLL2 come 25 MHz where the silicon halves them, and 12.5 MHz where it does not.
pub fn config(source: ClockSource, revision: SiliconRevision) -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    // DBGSLEEP_D1 (RM0433 section 60.5.8): without it the cycle counter stops in WFE, with or without a debugger, and
    // what is measured from one interrupt to the next is too short.
    config.enable_debug_during_sleep = true;
    let rcc = &mut config.rcc;
    rcc.voltage_scale = VoltageScale::Scale1;
    rcc.hsi = Some(HSIPrescaler::DIV1);
    rcc.hse = None;
    // Trimming is `trim_usb`'s, because embassy's follows the other core's frames.
    rcc.hsi48 = Some(Hsi48Config {
        sync_from_usb: false,
    });
    rcc.mux.usbsel = mux::Usbsel::HSI48;
    rcc.mux.adcsel = mux::Adcsel::PLL2_P;
    let converter = if revision.halves_converter_clock() {
        PllDiv::DIV20
    } else {
        PllDiv::DIV40
    };
    match source {
        ClockSource::External => {
            rcc.hse = Some(Hse {
                freq: Hertz(8_000_000),
                mode: HseMode::Bypass,
            });
            rcc.hsi48 = None;
            rcc.mux.usbsel = mux::Usbsel::PLL3_Q;
            multiply(rcc, PllSource::HSE, PllPreDiv::DIV2, converter);
        }
        ClockSource::Internal => multiply(rcc, PllSource::HSI, PllPreDiv::DIV16, converter),
        ClockSource::InternalUnmultiplied => rcc.sys = Sysclk::HSI,
    }
    config
}

/// Sets the PLLs and buses for `source`, which `divided` makes 4 MHz, with the divider `converter` for the ADC.
///
/// At that reference a PLL needs its wide range of 192 to 960 MHz; the medium one is for 1 to 2 MHz (RM0433 section
/// 8.5.5). embassy takes the medium one wherever it contains the frequency, so each of these is above its 420 MHz.
fn multiply(
    rcc: &mut embassy_stm32::rcc::Config,
    source: PllSource,
    divided: PllPreDiv,
    converter: PllDiv,
) {
    let pll = |mul, divp, divq| {
        Some(Pll {
            source,
            prediv: divided,
            mul,
            fracn: None,
            divp,
            divq,
            divr: None,
        })
    };
    // 4 MHz x 200 / 2.
    rcc.pll1 = pll(PllMul::MUL200, Some(PllDiv::DIV2), None);
    // For the ADC: 4 MHz x 125 / 20 or / 40.
    rcc.pll2 = pll(PllMul::MUL125, Some(converter), None);
    // For USB: 4 MHz x 120 / 10. It runs unused on the internal clock, because embassy turns a PLL off by a write to
    // the dividers of all of them.
    rcc.pll3 = pll(PllMul::MUL120, None, Some(PllDiv::DIV10));
    rcc.sys = Sysclk::PLL1_P;
    rcc.ahb_pre = AHBPrescaler::DIV2;
    rcc.apb1_pre = APBPrescaler::DIV2;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.apb3_pre = APBPrescaler::DIV2;
    rcc.apb4_pre = APBPrescaler::DIV2;
}

/// Keeps the clock from `source` honest once it runs: the external one is watched, and its failure is a non-maskable
/// interrupt (RM0433 section 8.5.3); HSI48 is trimmed by the frames of the host on USB, which allows 0.25 % (USB 2.0,
/// section 7.1.11).
pub fn guard(source: ClockSource) {
    if source == ClockSource::External {
        RCC.cr().modify(|w| w.set_hsecsson(true));
        return;
    }
    RCC.apb1henr().modify(|w| w.set_crsen(true));
    // The read waits until the write has arrived.
    let _ = RCC.apb1henr().read();
    CRS.cfgr()
        .modify(|w| w.set_syncsrc(Syncsrc::from_bits(FRAMES_OF_USB2)));
    CRS.cr().modify(|w| {
        w.set_autotrimen(true);
        w.set_cen(true);
    });
}

/// Reports whether the watch of the external clock has found that it failed.
pub fn has_failed() -> bool {
    RCC.cifr().read().hsecssf()
}

/// Mask of `CC1IF` in `TIM2_SR`.
const COMPARE_1: u32 = 1 << 1;

/// Calls `start`, which starts embassy's clock, and clears the flag before its interrupt comes. The first true one
/// comes half a turn later, after 32.8 ms.
///
/// The driver of embassy-stm32 0.6 counts half turns of TIM2's 16 bits by two flags: update, and compare of channel 1
/// at 0x8000. It generates an update while the compare value is still 0, which is what the counter holds then, and does
/// not clear the flag that this sets (`CC1IF`, RM0433 section 39.4.5; crate rigless 0.4.0 sets it). The first interrupt
/// counts it, so the clock is half a turn ahead, and its parity is wrong for good: a reading between a half turn and
/// its interrupt is 65.5 ms too early, and time steps back. Whether the part sets the flag was not measured; clearing
/// it does no harm.
pub fn begin_time<R>(start: impl FnOnce() -> R) -> R {
    critical_section::with(|_| {
        let started = start();
        // Writing 0 clears a flag, and writing 1 leaves it.
        TIM2.sr().write_value(SrGp16(!COMPARE_1));
        started
    })
}
