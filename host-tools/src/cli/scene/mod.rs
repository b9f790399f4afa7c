//! `stylus scene`: what is played along a path, and what that takes.

mod check;
mod compile;
mod plot;
mod render;
mod source;

use clap::Subcommand;
use host_tools::support::error::Result;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Check a scene and show what it takes of each tick, with the arithmetic
    Check(check::Arguments),
    /// Put scenes into a library, for upload
    Compile(compile::Arguments),
    /// Render what the stylus plays along a motion to a WAV file, sample for sample
    Render(render::Arguments),
    /// Draw surfaces along the path, the motion, and what the stylus plays
    Plot(plot::Arguments),
}

pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Check(arguments) => check::run(arguments),
        Command::Compile(arguments) => compile::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Plot(arguments) => plot::run(arguments),
    }
}
