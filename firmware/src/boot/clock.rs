//! Clock configuration (RM0433 chapter 8), and the two clocks that other rooms compute with.
//!
//! Invariant: [`CORE_HZ`] and [`TIMER_HZ`] are the clocks that [`config`] sets. No check at build time compares them.

use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Hsi48Config, Pll, PllDiv, PllMul, PllPreDiv,
    PllSource, Sysclk, VoltageScale, mux,
};
use embassy_stm32::time::Hertz;

/// Clock of the core, Hz.
pub const CORE_HZ: u32 = 400_000_000;

/// Clock of the timers on APB1, Hz: twice the clock of that bus, because its prescaler is not 1.
pub const TIMER_HZ: u32 = 200_000_000;

/// Returns the clock configuration, which `main` passes to embassy once, before the watchdog starts.
///
/// - Core 400 MHz from PLL1, AHB buses 200 MHz, APB buses 100 MHz: the highest clocks that `Scale1` allows.
/// - Source: 8 MHz, which the board's ST-LINK drives into HSE. Without it embassy's `init` waits for ever.
/// - USB: 48 MHz from HSI48, which the start-of-frame packets of the USB host trim.
/// - ADC: 25 MHz from PLL2. Chips of revision V halve it. Those of revision Y do not, and allow 36 MHz.
pub fn config() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    let rcc = &mut config.rcc;
    rcc.hse = Some(Hse {
        freq: Hertz(8_000_000),
        mode: HseMode::Bypass,
    });
    rcc.hsi48 = Some(Hsi48Config {
        sync_from_usb: true,
    });
    // 8 MHz / 2 x 200 / 2.
    rcc.pll1 = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV2,
        mul: PllMul::MUL200,
        fracn: None,
        divp: Some(PllDiv::DIV2),
        divq: Some(PllDiv::DIV8),
        divr: None,
    });
    // For the ADC: 8 MHz / 2 x 50 / 8, below the 36 MHz of revision Y; revision V halves it.
    rcc.pll2 = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV2,
        mul: PllMul::MUL50,
        fracn: None,
        divp: Some(PllDiv::DIV8),
        divq: None,
        divr: None,
    });
    rcc.mux.adcsel = mux::Adcsel::PLL2_P;
    rcc.sys = Sysclk::PLL1_P;
    rcc.ahb_pre = AHBPrescaler::DIV2;
    rcc.apb1_pre = APBPrescaler::DIV2;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.apb3_pre = APBPrescaler::DIV2;
    rcc.apb4_pre = APBPrescaler::DIV2;
    rcc.voltage_scale = VoltageScale::Scale1;
    rcc.mux.usbsel = mux::Usbsel::HSI48;
    config
}
