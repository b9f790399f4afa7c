//! Clock configuration, RM0433 chapter 8.

use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Hsi48Config, Pll, PllDiv, PllMul, PllPreDiv,
    PllSource, Sysclk, VoltageScale, mux,
};
use embassy_stm32::time::Hertz;

/// Clock of the core, Hz.
pub const CORE_HZ: u32 = 400_000_000;

/// Clock of the timers on APB1, Hz: twice the bus's.
pub const TIMER_HZ: u32 = 200_000_000;

/// The configuration: core at 400 MHz from the 8 MHz of the board's probe, buses at 100 MHz, USB from HSI48, which the
/// host's frames trim.
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
