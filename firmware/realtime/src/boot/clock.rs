//! Clock configuration (RM0433 chapter 8), and the two clocks that other rooms compute with.
//!
//! | source | core | 48 MHz of USB | tolerance |
//! |---|---|---|---|
//! | external: HSE, of the board's frequency | 400 MHz, PLL1 | PLL3 | that of a crystal |
//! | internal: HSI, 64 MHz | 400 MHz, PLL1 | HSI48, trimmed by the host's frames | 1 % |
//! | unmultiplied: HSI | 64 MHz | HSI48, trimmed by the host's frames | 1 %; no samples |
//!
//! The wait for HSE is bounded here. embassy's `init` waits for supply and PLLs without a bound. If it hangs, the
//! watchdog resets the chip, and the next start uses the next source in the table (`stylus_app::start`).
//!
//! Invariant: [`CORE_HZ`] and [`TIMER_HZ`] are the clocks that [`config`] sets, unless the source is the unmultiplied
//! one. No check at build time compares them.

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::adc::vals::Boost;
use embassy_stm32::pac::crs::vals::Syncsrc;
use embassy_stm32::pac::timer::regs::SrGp16;
use embassy_stm32::pac::{CRS, RCC, TIM2};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, HSIPrescaler, Hse, HseMode, Hsi48Config, Pll, PllDiv, PllMul, PllPreDiv, PllSource,
    Sysclk, VoltageScale, mux,
};
use embassy_stm32::time::Hertz;
use model_format::link::{ClockSource, SiliconRevision, StartStage};
use stylus_board::{BOARD, Clock};

/// Clock of the core, Hz.
pub const CORE_HZ: u32 = 400_000_000;

/// Clock of the timers on APB1, Hz: twice the clock of that bus, because its prescaler is not 1.
pub const TIMER_HZ: u32 = 200_000_000;

/// Clock of the converters, Hz, on every revision of the silicon.
pub const CONVERTER_HZ: u32 = 12_500_000;

/// Value of ADC_CR.BOOST for a clock of 6.25 to 12.5 MHz, as [`CONVERTER_HZ`] is (RM0433 section 25.4.3).
pub const CONVERTER_BOOST: Boost = Boost::LT12_5;

/// Clock of the core from the reset until [`config`] is applied: HSI, Hz (RM0433 section 8.5.2).
const RESET_HZ: u32 = 64_000_000;

/// The external clock.
const HSE: Clock = BOARD.clock;

/// Longest wait for the external clock, ms. A crystal takes some 2 ms (DS12110, HSE oscillator characteristics). The
/// ST-LINK's output takes less, once the ST-LINK's own firmware runs.
const EXTERNAL_LIMIT_MS: u32 = 100;

/// SYNCSRC of CRS_CFGR: start of frame of USB2, the core OTG_FS on PA11 and PA12. embassy's value, 2, selects USB1,
/// OTG_HS, instead. The value 3 is from ST's driver (RCC_CRS_SYNC_SOURCE_USB2); on revision Y it is not verified.
const FRAMES_OF_USB2: u8 = 3;

/// Stage of the start that sets up a clock from `source`.
pub const fn stage(source: ClockSource) -> StartStage {
    match source {
        ClockSource::External => StartStage::ExternalClock,
        ClockSource::Internal => StartStage::InternalClock,
        ClockSource::InternalUnmultiplied => StartStage::UnmultipliedClock,
    }
}

/// Returns the best source that is available and no better than `best`. Waits for the external clock up to
/// [`EXTERNAL_LIMIT_MS`]; the cycle counter must run.
pub fn select(best: ClockSource) -> ClockSource {
    if best == ClockSource::External && !starts_external() {
        return ClockSource::Internal;
    }
    best
}

/// Turns HSE on. Returns true once HSE is ready, and false if that takes too long.
fn starts_external() -> bool {
    RCC.cr().modify(|w| w.set_hsebyp(!HSE.is_crystal));
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
/// - ADC: [`CONVERTER_HZ`]. PLL2 supplies 25 MHz on silicon that halves the ADC's clock, and 12.5 MHz on silicon that
///   does not.
pub fn config(source: ClockSource, revision: SiliconRevision) -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    // DBGSLEEP_D1 (RM0433 section 60.5.8): without it the cycle counter stops in WFE, with or without a debugger, and
    // measured times between two interrupts come out too short.
    config.enable_debug_during_sleep = true;
    let rcc = &mut config.rcc;
    rcc.voltage_scale = VoltageScale::Scale1;
    rcc.hsi = Some(HSIPrescaler::DIV1);
    rcc.hse = None;
    // embassy's trimming follows the frames of the other USB core, so `guard` sets up the trimming instead.
    rcc.hsi48 = Some(Hsi48Config { sync_from_usb: false });
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
                freq: Hertz(HSE.hz),
                mode: if HSE.is_crystal {
                    HseMode::Oscillator
                } else {
                    HseMode::Bypass
                },
            });
            rcc.hsi48 = None;
            rcc.mux.usbsel = mux::Usbsel::PLL3_Q;
            multiply(rcc, PllSource::HSE, const { Reference::of(HSE.hz) }, converter);
        }
        ClockSource::Internal => multiply(rcc, PllSource::HSI, const { Reference::of(RESET_HZ) }, converter),
        ClockSource::InternalUnmultiplied => rcc.sys = Sysclk::HSI,
    }
    config
}

/// Frequencies of the oscillators of PLL1, PLL2 and PLL3, MHz. Above a reference of 2 MHz a PLL needs its wide range of
/// 192 to 960 MHz (RM0433 section 8.5.5). embassy chooses the medium range for every frequency within it, so these lie
/// above the medium range's end of 420 MHz.
const OSCILLATORS_MHZ: [u32; 3] = [800, 500, 480];

/// The dividers of all PLLs before and after their comparator.
#[derive(Clone, Copy)]
struct Reference {
    divider: PllPreDiv,
    multipliers: [PllMul; 3],
}

impl Reference {
    /// The fastest reference that divides a clock of `hz`, lies above 2 MHz and at most at 16 MHz, and of which each
    /// oscillator is a multiple. A clock without one ends the build.
    const fn of(hz: u32) -> Self {
        let mut divider = 1;
        loop {
            let reference = hz / divider;
            assert!(reference > 2_000_000, "no reference for the PLLs");
            let [core, adc, usb] = OSCILLATORS_MHZ;
            // 20 MHz is the greatest common divisor of the oscillators' frequencies.
            let is_whole = hz.is_multiple_of(divider) && 20_000_000_u32.is_multiple_of(reference);
            if is_whole && reference <= 16_000_000 {
                return Self {
                    divider: PllPreDiv::from_bits(divider as u8),
                    multipliers: [times(core, reference), times(adc, reference), times(usb, reference)],
                };
            }
            divider += 1;
        }
    }
}

/// The multiplier that makes `mhz` of a reference.
const fn times(mhz: u32, reference_hz: u32) -> PllMul {
    PllMul::from_bits((mhz * 1_000_000 / reference_hz - 1) as u16)
}

/// Sets the PLLs and buses for `source`. The divider `converter` is for the ADC's clock.
fn multiply(rcc: &mut embassy_stm32::rcc::Config, source: PllSource, reference: Reference, converter: PllDiv) {
    let [core, adc, usb] = reference.multipliers;
    let pll = |mul, divp, divq| {
        Some(Pll {
            source,
            prediv: reference.divider,
            mul,
            fracn: None,
            divp,
            divq,
            divr: None,
        })
    };
    rcc.pll1 = pll(core, Some(PllDiv::DIV2), None);
    rcc.pll2 = pll(adc, Some(converter), None);
    // PLL3 also runs, unused, on the internal clock, because embassy turns a PLL off by
    // writing the dividers of all PLLs.
    rcc.pll3 = pll(usb, None, Some(PllDiv::DIV10));
    rcc.sys = Sysclk::PLL1_P;
    rcc.ahb_pre = AHBPrescaler::DIV2;
    rcc.apb1_pre = APBPrescaler::DIV2;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.apb3_pre = APBPrescaler::DIV2;
    rcc.apb4_pre = APBPrescaler::DIV2;
}

/// Guards the running clock from `source`. The external clock is watched, and its failure raises a non-maskable
/// interrupt (RM0433 section 8.5.3). On an internal source, HSI48 is trimmed by the frames of the host on USB, because
/// USB allows an error of only 0.25 % (USB 2.0, section 7.1.11).
pub fn guard(source: ClockSource) {
    if source == ClockSource::External {
        RCC.cr().modify(|w| w.set_hsecsson(true));
        return;
    }
    RCC.apb1henr().modify(|w| w.set_crsen(true));
    // The read waits until the write has arrived.
    let _ = RCC.apb1henr().read();
    CRS.cfgr().modify(|w| w.set_syncsrc(Syncsrc::from_bits(FRAMES_OF_USB2)));
    CRS.cr().modify(|w| {
        w.set_autotrimen(true);
        w.set_cen(true);
    });
}

/// Reports whether the monitor of the external clock has detected a failure.
pub fn has_failed() -> bool {
    RCC.cifr().read().hsecssf()
}

/// Mask of `CC1IF` in `TIM2_SR`.
const COMPARE_1: u32 = 1 << 1;

/// Calls `start`, which starts embassy's clock, and clears a false flag before its interrupt comes. The first true
/// interrupt comes half a turn later, after 32.8 ms.
///
/// The driver of embassy-stm32 0.6 counts half turns of TIM2's 16 bits by two flags: update, and compare of channel 1
/// at 0x8000. At its start the driver generates an update while both the compare value and the counter are 0. The match
/// sets `CC1IF` (RM0433 section 39.4.5; crate rigless 0.4.0 sets it, too), and the driver does not clear it. The first
/// interrupt then counts a half turn that has not happened. The clock is half a turn ahead, and its parity stays wrong:
/// a reading between a half turn and its interrupt is 65.5 ms too early, and time steps back. Whether the part sets the
/// flag was not measured; clearing it does no harm.
pub fn begin_time<R>(start: impl FnOnce() -> R) -> R {
    critical_section::with(|_| {
        let started = start();
        // Writing 0 clears a flag, and writing 1 leaves it.
        TIM2.sr().write_value(SrGp16(!COMPARE_1));
        started
    })
}
