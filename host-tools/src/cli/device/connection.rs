//! Arguments for the connection to a stylus.

use std::time::Duration;

use host_tools::link::{Device, LinkAddress, Timeouts};
use host_tools::support::error::Result;

use crate::cli::input::positive;

/// The stylus that a command talks to.
#[derive(clap::Args)]
pub struct Link {
    /// Address of the stylus: usb, usb:SERIAL, serial:PATH, tcp:HOST:PORT or usb-virtual:HOST:PORT
    #[arg(
        long,
        value_name = "LINK",
        env = "STYLUS_LINK",
        default_value = "usb",
        global = true
    )]
    link: LinkAddress,
    /// Timeout of an answer, in seconds; 16 times as long for requests that write flash [default: 1]
    #[arg(long, value_name = "S", value_parser = positive, global = true)]
    timeout: Option<f64>,
}

impl Link {
    /// Connects to the stylus.
    ///
    /// # Errors
    /// See [`Device::connect`].
    pub fn connect(&self) -> Result<Device> {
        let timeouts = match self.timeout {
            // At most a day, so that sums of timeouts do not overflow.
            Some(seconds) => Timeouts::scaled_to(Duration::from_secs_f64(seconds.min(86_400.0))),
            None => Timeouts::default(),
        };
        Ok(Device::connect(&self.link, timeouts)?)
    }
}
