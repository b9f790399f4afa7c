//! The `stylus` command: a module per command, or for two that share most of their arguments or their work.
//!
//! **Invariant: thin.** A command parses its arguments, calls the library and prints. Signal processing, formats and
//! the link belong to the library, where other programs can use them. The shared modules import no command: `input`
//! reads, `output` and `table` print, `files` writes, `interrupt` ends the process, and `help` composes the help.

mod compare;
mod demo;
mod device;
mod evaluate;
mod files;
mod fit;
mod frontier;
mod help;
mod import_hatt;
mod input;
mod inspect;
mod interrupt;
mod join;
mod output;
mod page;
mod render;
mod scene;
mod simulate_rig;
mod stress;
mod table;
mod trials;

use std::io;
use std::process::ExitCode;

use clap::builder::FalseyValueParser;
use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use stylus_support::{Error, Result};
use stylus_support::{progress, temporaries};

/// Exit code of a failure that the user can correct: a file, a value or a request that cannot be used.
const EXIT_UNUSABLE: u8 = 2;

/// Exit code of a command whose reader closed the output before the end.
const EXIT_CLOSED: u8 = 1;

/// Data-driven haptic textures: fit models to recordings, judge them, and play them on a stylus
#[derive(Parser)]
#[command(name = "stylus", version, arg_required_else_help = true)]
struct Arguments {
    /// Print results, warnings and errors only
    #[arg(
        short,
        long,
        global = true,
        env = "STYLUS_QUIET",
        hide_env_values = true,
        value_parser = FalseyValueParser::new(),
        help_heading = "General options"
    )]
    quiet: bool,
    /// Print every warning by itself, and every column and table
    #[arg(long, global = true, help_heading = "General options")]
    full: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate the recordings of a drum rig
    SimulateRig(simulate_rig::Arguments),
    /// Fit a texture library to recordings
    Fit(fit::Arguments),
    /// Judge a library by figures, against recordings (by listeners: compare)
    Evaluate(evaluate::Arguments),
    /// Make a listening test of recordings and textures, or score it (figures: evaluate)
    Compare(compare::Arguments),
    /// Write an HTML page to rub a library's textures, played by the stylus's kernel
    Page(page::Arguments),
    /// Render the stylus's output to a WAV file, sample for sample
    Render(render::Arguments),
    /// Write a stroke for other devices: MPEG haptics, .haptic, AHAP or WAV
    Export(render::ExportArguments),
    /// Show the content of a library
    Inspect(inspect::Arguments),
    /// Join libraries to one
    Join(join::Arguments),
    /// Write trials.csv, fit's list of recordings, from the names of files
    Trials(trials::Arguments),
    /// Convert HaTT's model files to a library
    ImportHatt(import_hatt::Arguments),
    /// Check, compile and render scenes: surfaces along a path, with effects
    Scene(scene::Arguments),
    /// Play the hard cases with the device's kernel and check its guarantees
    Stress(stress::Arguments),
    /// Compare structures, orders and update intervals: accuracy against time
    Frontier(frontier::Arguments),
    /// Run every step on simulated recordings, with a report
    Demo(demo::Arguments),
    /// Print the script that completes this program's words in a shell
    Completions(help::CompletionsArguments),
    /// Print the manual page of this program or of a command
    Man(help::ManArguments),
    #[command(flatten)]
    Device(device::Command),
}

/// Returns the program's command with all of its help.
fn whole() -> clap::Command {
    help::whole(Arguments::command())
}

/// Runs the command on the process's command line.
pub fn run() -> ExitCode {
    let mut command = whole();
    // On Windows a command gets patterns such as *.csv as they were typed. Elsewhere the shell has replaced them.
    let parsed = command.try_get_matches_from_mut(wild::args_os());
    let arguments = match parsed.and_then(|matches| {
        // Only clap's matches tell which values are paths, whatever the command.
        files::remember_inputs(&command, &matches);
        Arguments::from_arg_matches(&matches)
    }) {
        Ok(arguments) => arguments,
        Err(answer) => {
            return answer_without_a_command(&with_place_of_option(answer, &command));
        }
    };
    if arguments.quiet {
        progress::hide();
    }
    if arguments.full {
        output::be_full();
    }
    interrupt::handle();
    let outcome = run_command(arguments.command);
    // A signal removes temporaries while the command still runs, so that the command fails for a reason that nobody
    // wants to read.
    temporaries::wait_for_an_interrupt();
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failed(&failure),
    }
}

/// Prints the reason why the command failed, and returns its exit code.
fn failed(failure: &Error) -> ExitCode {
    match failure {
        // The reader has closed the output, like `head` after its last line, and expects no message.
        Error::Io { source, .. } if source.kind() == io::ErrorKind::BrokenPipe => ExitCode::from(EXIT_CLOSED),
        _ => {
            output::failed(failure);
            ExitCode::from(EXIT_UNUSABLE)
        }
    }
}

fn run_command(command: Command) -> Result<()> {
    match command {
        Command::SimulateRig(arguments) => simulate_rig::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Page(arguments) => page::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Export(arguments) => render::export(&arguments),
        Command::Inspect(arguments) => inspect::run(&arguments),
        Command::Join(arguments) => join::run(&arguments),
        Command::Trials(arguments) => trials::run(&arguments),
        Command::ImportHatt(arguments) => import_hatt::run(&arguments),
        Command::Scene(arguments) => scene::run(&arguments),
        Command::Stress(arguments) => stress::run(&arguments),
        Command::Frontier(arguments) => frontier::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Completions(arguments) => help::completions(&arguments, &mut whole()),
        Command::Man(arguments) => help::man(&arguments, &mut whole()),
        Command::Device(command) => device::run(&command),
    }
}

/// Returns `answer`. If it is about an option before the command to which the option belongs, a hint on its place is
/// added.
fn with_place_of_option(mut answer: clap::Error, command: &clap::Command) -> clap::Error {
    let Some(ContextValue::String(option)) = answer.get(ContextKind::InvalidArg) else {
        return answer;
    };
    let words = || std::env::args_os().skip(1);
    // Words that are not Unicode take part as far as they can be read. `args` would panic at them.
    let words = || words().map(|word| word.to_string_lossy().into_owned());
    let is_before_command = words()
        .take_while(|word| command.find_subcommand(word).is_none())
        .any(|word| word.starts_with(option.as_str()));
    let name = option.trim_start_matches("--");
    let has_it = |inner: &&clap::Command| {
        let mut options = inner.get_arguments();
        options.any(|argument| argument.get_long() == Some(name))
    };
    let mut commands = command.get_subcommands().filter(has_it);
    // An option that no command has, or that stands after its command, gets clap's answer alone.
    let Some(first) = commands.next().filter(|_| is_before_command) else {
        return answer;
    };
    let given = words()
        .find(|word| command.find_subcommand(word).is_some())
        .unwrap_or_else(|| first.get_name().to_owned());
    let tip = format!("'{option}' belongs after the command: stylus {given} {option} ...");
    answer.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    answer
}

/// Prints the help, the version, or the error in a command line that cannot be parsed.
fn answer_without_a_command(answer: &clap::Error) -> ExitCode {
    match output::answer(answer) {
        Ok(()) if answer.use_stderr() => ExitCode::from(EXIT_UNUSABLE),
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failed(&failure),
    }
}
