//! The board's own models, which replace or wrap the emulator's models of the part.
//!
//! Every section number is RM0433's (Rev 8, or Rev 9 where the emulator's own models cite it; the sections named here
//! are the same in both).

pub mod adc;
pub mod around;
pub mod dac;
pub mod encoder;
pub mod flash;
pub mod low_speed;
pub mod oscillators;
pub mod pin;
pub mod ram;
pub mod read_back;
pub mod trigger;
pub mod usb;
pub mod watchdog;
