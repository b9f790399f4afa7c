//! The command line: one module a command, thin over the library.

mod certify;
mod demo;
mod densify;
#[cfg(feature = "device")]
mod device;
mod evaluate;
mod fit;
mod fit_tap;
mod frontier;
mod import_hatt;
mod input;
mod inspect;
mod leave_one_out;
mod library_file;
mod output;
mod render;
mod report;
mod scene;
mod segment;
mod simulate_rig;
mod stress;
mod table;
mod takes;

use std::io;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use host_tools::support::error::Error;

/// What a failure that the user can mend ends with: a file, a value or a request that cannot be used.
const EXIT_UNUSABLE: u8 = 2;

/// The last line of the help where the commands for a stylus are left out.
#[cfg(not(feature = "device"))]
const WITHOUT_DEVICE: &str =
    "The commands for a stylus need the feature `device`; `cargo stylus` has it.";

/// Data-driven haptic textures: fit models to recordings of a tool on a surface, judge them, and render exactly what the
/// stylus plays.
#[derive(Parser)]
#[command(name = "stylus", version, arg_required_else_help = true)]
#[cfg_attr(not(feature = "device"), command(after_help = WITHOUT_DEVICE))]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a drum rig's recordings from a scene
    SimulateRig(simulate_rig::Arguments),
    /// Fit a texture library to recordings
    Fit(fit::Arguments),
    /// Compare what the stylus plays with recordings
    Evaluate(evaluate::Arguments),
    /// Render what the stylus plays to a WAV file, sample for sample
    Render(render::Arguments),
    /// Show what is in a library
    Inspect(inspect::Arguments),
    /// Write one page with everything: tables, the paper's figures, maps, spectrograms, sounds
    Report(report::Arguments),
    /// Cut a free hand's recordings where they are steady, for fit
    Segment(segment::Arguments),
    /// Make HaTT's model files a library
    ImportHatt(import_hatt::Arguments),
    /// Check, compile, render and draw scenes: surfaces along a path, with effects
    Scene(scene::Arguments),
    /// Find a scene's tap transient in recordings of taps
    FitTap(fit_tap::Arguments),
    /// Prove a library's textures stable at every point of their grids
    Certify(certify::Arguments),
    /// Play the hard cases by the device's kernel and check what it promises
    Stress(stress::Arguments),
    /// Compare structures, orders and intervals of updates: accuracy against time, and the Pareto front
    Frontier(frontier::Arguments),
    /// Do all of it on simulated recordings, with a report
    Demo(demo::Arguments),
    #[cfg(feature = "device")]
    #[command(flatten)]
    Device(device::Command),
}

/// Runs the command that the process was started with.
pub fn run() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::SimulateRig(arguments) => simulate_rig::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Inspect(arguments) => inspect::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Segment(arguments) => segment::run(&arguments),
        Command::ImportHatt(arguments) => import_hatt::run(&arguments),
        Command::Scene(arguments) => scene::run(&arguments),
        Command::FitTap(arguments) => fit_tap::run(&arguments),
        Command::Certify(arguments) => certify::run(&arguments),
        Command::Stress(arguments) => stress::run(&arguments),
        Command::Frontier(arguments) => frontier::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        #[cfg(feature = "device")]
        Command::Device(command) => device::run(&command),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever reads our output has seen enough, as `head` has.
        Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::BrokenPipe => {
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("stylus: {failure}");
            ExitCode::from(EXIT_UNUSABLE)
        }
    }
}
