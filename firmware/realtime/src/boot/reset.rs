//! The cause of the last reset, as the processor's reset and clock controller reports it.

/// Cause of the last reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub enum ResetFlags {
    /// Power came on.
    PowerOn,
    /// Power dipped.
    Brownout,
    /// The independent watchdog.
    Watchdog,
    /// The processor itself.
    Software,
    /// The reset pin.
    Pin,
    /// None of these.
    Unknown,
}

impl ResetFlags {
    /// Reads and clears RCC_RSR (RM0433 section 8.7.38).
    ///
    /// The order of the tests matters, because every other reset sets the pin's flag too, and power-on sets all of
    /// them.
    pub fn take() -> Self {
        let rsr = embassy_stm32::pac::RCC.rsr();
        let flags = rsr.read();
        rsr.modify(|w| w.set_rmvf(true));
        if flags.porrstf() {
            Self::PowerOn
        } else if flags.borrstf() {
            Self::Brownout
        } else if flags.iwdg1rstf() {
            Self::Watchdog
        } else if flags.sftrstf() {
            Self::Software
        } else if flags.pinrstf() {
            Self::Pin
        } else {
            Self::Unknown
        }
    }
}
