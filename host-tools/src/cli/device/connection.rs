//! The stylus that a command talks to.

use std::time::Duration;

use host_tools::link::{Device, LinkAddress, Timeouts};
use host_tools::support::error::Result;

use crate::cli::input::positive;

/// Which stylus.
#[derive(clap::Args)]
pub struct Link {
    /// The stylus: usb, usb:SERIAL, serial:PATH or tcp:HOST:PORT
    #[arg(
        long,
        value_name = "LINK",
        env = "STYLUS_LINK",
        default_value = "usb",
        global = true
    )]
    link: LinkAddress,
    /// Wait so long for an answer, in seconds; 16 times as long where flash is written [default: 1]
    #[arg(long, value_name = "S", value_parser = positive, global = true)]
    timeout: Option<f64>,
}

impl Link {
    /// Connects.
    ///
    /// # Errors
    /// What [`Device::connect`] says.
    pub fn connect(&self) -> Result<Device> {
        let timeouts = match self.timeout {
            // Longer than a day is for ever, and adds up without overflow.
            Some(seconds) => Timeouts::scaled_to(Duration::from_secs_f64(seconds.min(86_400.0))),
            None => Timeouts::default(),
        };
        Ok(Device::connect(&self.link, timeouts)?)
    }
}
