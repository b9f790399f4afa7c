//! Arguments for the connection to a stylus.

use std::time::Duration;

use host_tools::link::{Device, LinkAddress, LinkError, Route, Sharing, Timeouts, discovery};
use host_tools::support::error::Result;

use crate::cli::input::positive;
use crate::cli::output::note;

/// The stylus that a command talks to.
#[derive(clap::Args)]
#[expect(clippy::struct_field_names, reason = "it is the option's name")]
pub struct Link {
    /// Address of the stylus: usb, usb:SERIAL, serial:PATH, tcp:HOST:PORT or usb-virtual:HOST:PORT [default: the only
    /// one that is attached, see `stylus devices`]
    #[arg(
        long,
        value_name = "LINK",
        env = "STYLUS_LINK",
        hide_env_values = true,
        global = true
    )]
    link: Option<LinkAddress>,
    /// Timeout of an answer, in seconds; 16 times as long for requests that write flash [default: 1]
    #[arg(
        long,
        value_name = "S",
        value_parser = positive,
        env = "STYLUS_TIMEOUT",
        hide_env_values = true,
        global = true
    )]
    timeout: Option<f64>,
    /// Open the link for this command alone, without sharing it with others
    #[arg(long, global = true)]
    no_broker: bool,
}

impl Link {
    /// Connects to the stylus.
    ///
    /// # Errors
    /// See [`Device::connect_by`].
    pub fn connect(&self) -> Result<Device> {
        let timeouts = match self.timeout {
            // At most a day, so that sums of timeouts do not overflow.
            Some(seconds) => Timeouts::scaled_to(Duration::from_secs_f64(seconds.min(86_400.0))),
            None => Timeouts::default(),
        };
        if let Some(link) = &self.link {
            return self.open(link, timeouts);
        }
        let (link, words) = discovery::only(&Route::Shared(sharing()?))?;
        if let Some(words) = words {
            note(&format!("note: {words}"));
        }
        self.open(&link, timeouts)
    }

    /// Connects to a second link of the stylus.
    ///
    /// # Errors
    /// See [`Device::connect_by`].
    pub fn connect_to(&self, link: &LinkAddress) -> Result<Device> {
        self.open(link, Timeouts::default())
    }

    fn open(&self, link: &LinkAddress, timeouts: Timeouts) -> Result<Device> {
        let route = if self.no_broker {
            Route::Alone
        } else {
            Route::Shared(sharing()?)
        };
        Ok(Device::connect_by(link, timeouts, route)?)
    }
}

/// This program, as one that shares the links that it opens.
///
/// # Errors
/// A system that does not tell the file of this program.
pub fn sharing() -> Result<Sharing> {
    // The first word is the command, because options follow it.
    let command = std::env::args().nth(1).unwrap_or_default();
    Ok(Sharing {
        program: std::env::current_exe().map_err(LinkError::Host)?,
        command,
    })
}
