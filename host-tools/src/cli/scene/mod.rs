//! `stylus scene`: check, compile, render and fit-tap.

mod check;
mod compile;
mod fit_tap;
mod render;

use clap::Subcommand;
use stylus_support::Result;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Check a scene's cost per sample, with the arithmetic (the actuator: `stylus check`)
    Check(check::Arguments),
    /// Put scenes into a library, for upload
    Compile(compile::Arguments),
    /// Render the stylus's output along a motion to a WAV file, sample for sample
    Render(render::Arguments),
    /// Fit a scene's tap transient to recordings of taps
    FitTap(fit_tap::Arguments),
}

pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Check(arguments) => check::run(arguments),
        Command::Compile(arguments) => compile::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::FitTap(arguments) => fit_tap::run(arguments),
    }
}
