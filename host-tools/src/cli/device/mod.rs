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
use stylus_support::Result;

use self::connection::{DevicesArguments, StopArguments, devices, stop};

#[derive(Subcommand)]
pub enum Command {
    /// List the styluses that are attached: by USB, serial port or virtual
    Devices(DevicesArguments),
    /// Record trials or a free hand's strokes with the stylus's sensors
    Record(record::Arguments),
    /// Send a library to the stylus, and read it back (firmware: update)
    Upload(upload::Arguments),
    /// Send a signed firmware image, and confirm it once it runs (libraries: upload)
    Update(update::Arguments),
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
