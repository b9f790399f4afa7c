//! The commands that talk to a stylus.

pub mod activate;
mod histogram;
mod interrupt;
pub mod list;
pub mod monitor;
pub mod play;
pub mod record;
pub mod record_strokes;
mod sensing;
pub mod settings;
pub mod status;
pub mod stop;
pub mod upload;

use std::time::Duration;

use clap::Subcommand;
use host_tools::link::{Device, LinkAddress, Patience};
use host_tools::support::error::Result;
use indicatif::{ProgressBar, ProgressStyle};

use super::input::positive;

#[derive(Subcommand)]
pub enum Command {
    /// Record trials with the stylus's sensors, guided through speeds and forces
    Record(record::Arguments),
    /// Record a free hand's strokes, with the speed and force of every moment, for segment
    RecordStrokes(record_strokes::Arguments),
    /// Bring a library into the stylus, and read it back
    Upload(upload::Arguments),
    /// List the libraries and textures in the stylus
    List(list::Arguments),
    /// Make the library in a slot the one that is played
    Activate(activate::Arguments),
    /// Play a texture until Ctrl-C, along the sensors' motion or one from here
    Play(play::Arguments),
    /// Stop what the stylus plays or records
    Stop(stop::Arguments),
    /// Show what the stylus does and everything that it counts
    Status(status::Arguments),
    /// Watch the stylus and its accelerometer
    Monitor(monitor::Arguments),
    /// Show or change the stylus's settings
    Settings(settings::Arguments),
}

/// Runs one of them.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Record(arguments) => record::run(arguments),
        Command::RecordStrokes(arguments) => record_strokes::run(arguments),
        Command::Upload(arguments) => upload::run(arguments),
        Command::List(arguments) => list::run(arguments),
        Command::Activate(arguments) => activate::run(arguments),
        Command::Play(arguments) => play::run(arguments),
        Command::Stop(arguments) => stop::run(arguments),
        Command::Status(arguments) => status::run(arguments),
        Command::Monitor(arguments) => monitor::run(arguments),
        Command::Settings(arguments) => settings::run(arguments),
    }
}

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
        let patience = match self.timeout {
            // Longer than a day is for ever, and adds up without overflow.
            Some(seconds) => Patience::scaled_to(Duration::from_secs_f64(seconds.min(86_400.0))),
            None => Patience::default(),
        };
        Ok(Device::connect(&self.link, patience)?)
    }
}

/// A line that tells what goes on, on standard error, for as long as it takes; hidden where no person looks.
fn live_line(what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {msg}").expect("the template is fixed");
    ProgressBar::new_spinner()
        .with_style(style)
        .with_message(what)
}
