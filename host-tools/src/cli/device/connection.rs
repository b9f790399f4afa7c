//! The connection to a stylus: its arguments, and the commands that concern only the connection, `devices`, `stop` and
//! `share-link`.

#[cfg(unix)]
use std::io::Write;
use std::time::Duration;

use host_tools::link::discovery;
#[cfg(unix)]
use host_tools::link::{BROKER_READY, BROKER_TAKEN, Served, serve};
use host_tools::link::{Device, LinkAddress, LinkError, Route, Sharing, Timeouts};
use host_tools::support::error::Result;
#[cfg(unix)]
use host_tools::support::visible::visible_line;
use serde::Serialize;

use crate::cli::input::positive;
use crate::cli::output::{note, print, print_json};
use crate::cli::table::{headed, table};

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
        if let Some(link) = &self.link {
            return self.connect_to(link);
        }
        let (link, words) = discovery::only(&Route::Shared(sharing()?))?;
        if let Some(words) = words {
            note(&format!("note: {words}"));
        }
        self.connect_to(&link)
    }

    /// Connects like [`Link::connect`], but without sharing the link. The stylus may speak another version of the
    /// protocol.
    ///
    /// # Errors
    /// No stylus is attached, several are attached and none is named, or the link cannot be opened.
    pub fn connect_to_any(&self) -> Result<Device> {
        let link = match &self.link {
            Some(link) => link.clone(),
            None => discovery::only(&Route::Direct)?.0,
        };
        Ok(Device::connect_to_any(
            &link,
            self.timeouts(),
            Route::Alone(command()),
        )?)
    }

    /// Connects to the stylus; if the link cannot be shared, by a link of this command only. It is for commands that
    /// must reach the stylus in any case.
    ///
    /// # Errors
    /// The error of [`Link::connect`], if neither kind of link reaches the stylus.
    fn connect_somehow(&self) -> Result<Device> {
        let link = || match &self.link {
            Some(link) => Ok(link.clone()),
            // Without a broker, which may be what failed.
            None => discovery::only(&Route::Direct).map(|(link, _)| link),
        };
        self.connect().or_else(|failure| {
            let direct =
                link().map(|link| Device::connect_by(&link, self.timeouts(), Route::Direct));
            match direct {
                Ok(Ok(device)) => Ok(device),
                _ => Err(failure),
            }
        })
    }

    fn timeouts(&self) -> Timeouts {
        // At most a day, so that sums of timeouts do not overflow.
        let longest = |seconds: f64| Duration::from_secs_f64(seconds.min(86_400.0));
        self.timeout.map_or_else(Timeouts::default, |seconds| {
            Timeouts::scaled_to(longest(seconds))
        })
    }

    /// Connects to the stylus at `link`, such as a second one of the same stylus.
    ///
    /// # Errors
    /// See [`Device::connect_by`].
    pub fn connect_to(&self, link: &LinkAddress) -> Result<Device> {
        // Either way the route carries the command's name, by which others are told who has the device.
        let route = if self.no_broker {
            Route::Alone(command())
        } else {
            Route::Shared(sharing()?)
        };
        Ok(Device::connect_by(link, self.timeouts(), route)?)
    }
}

/// Returns how to start the sharing of a link: this program and its command.
///
/// # Errors
/// The system does not report where this program's file is.
pub fn sharing() -> Result<Sharing> {
    Ok(Sharing {
        program: std::env::current_exe().map_err(LinkError::Host)?,
        command: command(),
    })
}

/// Returns the first argument that is no general option, such as `-q`: the command.
fn command() -> String {
    let mut words = std::env::args().skip(1);
    words
        .find(|word| !word.starts_with('-'))
        .unwrap_or_default()
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
    let rows = discovery::rows(&Route::Shared(sharing()?))?;
    if arguments.json {
        return print_json(&rows);
    }
    if rows.is_empty() {
        note(
            "nothing is attached: plug a stylus in, or start a virtual one with `cargo virtual-stylus`",
        );
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
    let device = arguments.link.connect_somehow()?;
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

/// Arguments of `stylus share-link`.
#[cfg(unix)]
#[derive(clap::Args)]
pub struct ShareLinkArguments {
    /// Address of the stylus
    #[arg(long, value_name = "LINK")]
    link: LinkAddress,
}

/// Runs `stylus share-link`. Other commands start it to share a link; users never type it. Its only line of output is
/// for the command that started it.
#[cfg(unix)]
pub fn share_link(arguments: &ShareLinkArguments) {
    match serve(&arguments.link, || say(BROKER_READY)) {
        Ok(Served::Ended) => {}
        Ok(Served::Taken) => say(BROKER_TAKEN),
        Err(failure) => say(&visible_line(&failure.to_string())),
    }
}

/// Prints a line. A failure is ignored, because the command that has started this program may be gone.
#[cfg(unix)]
fn say(line: &str) {
    let mut output = std::io::stdout().lock();
    let _ = writeln!(output, "{line}").and_then(|()| output.flush());
}
