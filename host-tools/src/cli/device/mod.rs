//! The commands that talk to a stylus.

pub mod activate;
mod connection;
mod histogram;
mod interrupt;
pub mod list;
mod live_line;
pub mod monitor;
pub mod play;
pub mod record;
pub mod record_strokes;
mod sensing;
pub mod settings;
pub mod status;
pub mod stop;
pub mod upload;

use clap::Subcommand;
use host_tools::support::error::Result;

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
