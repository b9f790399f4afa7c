//! Commands that talk to a stylus, each over one connection that its `--link` names.

pub mod calibrate;
mod connection;
pub mod headroom;
pub mod play;
pub mod record;
pub mod response;
pub mod selftest;
pub mod settings;
pub mod slots;
pub mod status;
pub mod update;
pub mod upload;

use clap::Subcommand;
use host_tools::support::error::Result;

use self::connection::{DevicesArguments, StopArguments, devices, stop};

#[derive(Subcommand)]
pub enum Command {
    /// List the styluses that are attached: on USB, behind a probe's serial port, or virtual
    Devices(DevicesArguments),
    /// Record with the stylus's sensors: trials, prompted for each speed and force, or a free hand's strokes
    Record(record::Arguments),
    /// Upload a library to the stylus, and read it back
    Upload(upload::Arguments),
    /// Update the stylus's firmware with a signed image, and confirm it once it runs
    Update(update::Arguments),
    /// List the libraries and textures in the stylus, or make another library the active one
    Slots(slots::Arguments),
    /// Play a texture or a scene until Ctrl-C, along the sensors' motion or a given one
    Play(play::Arguments),
    /// Stop playing and recording
    Stop(StopArguments),
    /// Show the stylus's state and all its counters, once or continuously with the sensors
    Status(status::Arguments),
    /// Test the board, the wiring and the link, and keep a record
    Selftest(selftest::Arguments),
    /// Show or change the stylus's settings
    Settings(settings::Arguments),
    /// Set the coil's measured values and the sensors' zeros, with checks, and measure and equalise the actuator's
    /// response; until then nothing plays
    Calibrate(calibrate::Arguments),
    /// Compare the actuator with its stored response, by a probe of two seconds
    Check(response::CheckArguments),
    /// Compare a library, through the stored equaliser, with what coil and limits give
    Headroom(headroom::Arguments),
}

/// Runs a command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Devices(arguments) => devices(arguments),
        Command::Record(arguments) => record::run(arguments),
        Command::Upload(arguments) => upload::run(arguments),
        Command::Update(arguments) => update::run(arguments),
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
