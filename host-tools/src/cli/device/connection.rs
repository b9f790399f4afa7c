//! The connection to a stylus: its arguments, and the commands that concern only the connection, `devices` and `stop`.

use std::time::Duration;

use serde::Serialize;
use stylus_link::link::discovery;
use stylus_link::link::{Device, LinkAddress, Timeouts};
use stylus_support::Result;

use crate::cli::input::positive;
use crate::cli::output::{note, print, print_json};
use crate::cli::table::{headed, table};

/// The stylus that a command talks to.
#[derive(clap::Args)]
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
}

impl Link {
    /// Connects to the stylus.
    pub fn connect(&self) -> Result<Device> {
        if let Some(link) = &self.link {
            return self.connect_to(link);
        }
        let (link, words) = discovery::only()?;
        if let Some(words) = words {
            note(&format!("note: {words}"));
        }
        self.connect_to(&link)
    }

    /// Connects like [`Link::connect`], also to a stylus that speaks another version of the protocol.
    pub fn connect_to_any(&self) -> Result<Device> {
        let link = match &self.link {
            Some(link) => link.clone(),
            None => discovery::only()?.0,
        };
        Ok(Device::connect_to_any(&link, self.timeouts())?)
    }

    fn timeouts(&self) -> Timeouts {
        // At most a day, so that sums of timeouts do not overflow.
        let longest = |seconds: f64| Duration::from_secs_f64(seconds.min(86_400.0));
        self.timeout
            .map_or_else(Timeouts::default, |seconds| Timeouts::scaled_to(longest(seconds)))
    }

    /// Connects to the stylus at `link`, such as a second one of the same stylus.
    pub fn connect_to(&self, link: &LinkAddress) -> Result<Device> {
        Ok(Device::connect(link, self.timeouts())?)
    }
}

/// Arguments of `stylus devices`.
#[derive(clap::Args)]
pub struct DevicesArguments {
    /// Print the list as JSON
    #[arg(long)]
    json: bool,
}

/// Runs `stylus devices`.
pub fn devices(arguments: &DevicesArguments) -> Result<()> {
    let rows = discovery::rows()?;
    if arguments.json {
        return print_json(&rows);
    }
    if rows.is_empty() {
        note("nothing is attached: plug a stylus in, or start a virtual one with `cargo virtual-stylus`");
        return Ok(());
    }
    let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "-".to_owned());
    let (header, rows) = headed(rows.iter().map(|row| {
        [
            ("--link", row.link.clone()),
            ("kind", row.kind.to_string()),
            ("serial number", text(&row.serial_number)),
            ("firmware", text(&row.firmware)),
            ("probe", text(&row.probe)),
            ("state", row.state.clone()),
        ]
    }));
    print(&table(&header, &rows))
}

/// Arguments of `stylus stop`.
#[derive(clap::Args)]
pub struct StopArguments {
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct StopReport {
    was_playing: bool,
    was_recording: bool,
}

/// Runs `stylus stop`.
pub fn stop(arguments: &StopArguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let (was_playing, _) = device.stop()?;
    // A program that was killed may have left its recording running.
    let was_recording = device.status()?.record.recording;
    if was_recording {
        device.record_stop()?;
    }
    if arguments.json {
        return print_json(&StopReport {
            was_playing,
            was_recording,
        });
    }
    let what = match (was_playing, was_recording) {
        (true, true) => "stopped playing and recording",
        (true, false) => "stopped playing",
        (false, true) => "stopped recording; nothing was played",
        (false, false) => "nothing was played or recorded",
    };
    print(&format!("{what}; the output is at rest"))
}
