//! Commands that talk to a stylus, each over one connection that its `--link` names.
//!
//! Here are the arguments of the connection, and the commands that concern only the connection, `devices` and `stop`.

pub mod calibrate;
pub mod headroom;
pub mod play;
pub mod record;
pub mod response;
pub mod selftest;
pub mod settings;
pub mod slots;
pub mod status;
pub mod upload;

use std::time::Duration;

use clap::Subcommand;
use serde::Serialize;
use stylus_link::link::{Device, LinkAddress, Timeouts, discovery};
use stylus_support::Result;

use super::input::positive;
use super::output::{note, print, print_json};
use super::table::{headed, table};

#[derive(Subcommand)]
pub enum Command {
    /// List the styluses that are attached: by USB, serial port or virtual
    Devices(DevicesArguments),
    /// Record trials or a free hand's strokes with the stylus's sensors
    Record(record::Arguments),
    /// Send a library to the stylus, and read it back (firmware: update)
    Upload(upload::Arguments),
    /// Send a signed firmware image, and confirm it once it runs (libraries: upload)
    Update(upload::UpdateArguments),
    /// List the stylus's libraries, or make another one the active one
    Slots(slots::Arguments),
    /// Play a texture or a scene, along the sensors' motion or a given one
    Play(play::Arguments),
    /// Stop playing and recording
    Stop(StopArguments),
    /// Show the stylus's state and counters, once or live with the sensors
    Status(status::Arguments),
    /// Test board, wiring and link, and keep a record (the actuator: check)
    Selftest(selftest::Arguments),
    /// Show or change the stylus's settings
    Settings(settings::Arguments),
    /// Set the coil's values and the sensors' zeros; measure and equalise the response
    ///
    /// Nothing plays before the coil's values are set.
    Calibrate(calibrate::Arguments),
    /// Compare the actuator with its stored response (board: selftest; scenes: scene check)
    Check(response::CheckArguments),
    /// Compare a library, through the stored equaliser, with coil and limits
    Headroom(headroom::Arguments),
}

/// Runs a command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Devices(arguments) => devices(arguments),
        Command::Record(arguments) => record::run(arguments),
        Command::Upload(arguments) => upload::run(arguments),
        Command::Update(arguments) => upload::update_image(arguments),
        Command::Slots(arguments) => slots::run(arguments),
        Command::Play(arguments) => play::run(arguments),
        Command::Stop(arguments) => stop(arguments),
        Command::Status(arguments) => status::run(arguments),
        Command::Selftest(arguments) => selftest::run(arguments),
        Command::Settings(arguments) => settings::run(arguments),
        Command::Calibrate(arguments) => calibrate::run(arguments),
        Command::Check(arguments) => response::run_check(arguments),
        Command::Headroom(arguments) => headroom::run(arguments),
    }
}

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
