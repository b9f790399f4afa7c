//! The image's tests on a real board, or on the virtual stylus: runs the package `hil` in `tests/hil` with the images,
//! the probe or the emulator that it needs.

use std::path::PathBuf;
use std::process::Command;

use anyhow::Result;

use crate::firmware::{self, Image};
use crate::toolchain::Toolchain;
use crate::{process, virtual_stylus, workspace};

/// Length of simultaneous upload, stream and playback on the virtual stylus, minutes of its own time.
const VIRTUAL_MINUTES: f64 = 0.02;

/// Length of simultaneous upload, stream and playback on a board, minutes.
const BOARD_MINUTES: f64 = 10.0;

/// Options of `cargo tasks hil`.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub struct Arguments {
    /// The stylus: usb[:SERIAL], serial:PATH, tcp:HOST:PORT or usb-virtual:HOST:PORT
    #[arg(long, env = "STYLUS_LINK", required_unless_present = "virtual_stylus")]
    link: Option<String>,
    /// Flash the product's image by the probe first, and the one with faults on request for the tests of faults
    #[arg(long, conflicts_with = "virtual_stylus")]
    flash: bool,
    /// Start a virtual stylus in place of a board
    #[arg(long)]
    virtual_stylus: bool,
    /// Length of upload, stream and play together, in minutes [default: 10; 0.02 with the virtual stylus]
    #[arg(long)]
    minutes: Option<f64>,
    /// Write the report to this file, as JSON
    #[arg(long)]
    json_out: Option<PathBuf>,
    /// Upload and activate this library at the end, because the tests overwrite both slots
    #[arg(long)]
    library: Option<PathBuf>,
    /// Overwrite the libraries without a question
    #[arg(long)]
    yes: bool,
    /// Move the output although no enable is wired, because no amplifier is connected; holds for this run alone
    #[arg(long)]
    no_amplifier: bool,
}

/// Runs the suite.
pub fn run(arguments: &Arguments) -> Result<()> {
    // Building an example selects the same features as the tests, with which the library of the host's tools is already
    // built.
    let mut build = Command::new("cargo");
    build.args(["build", "--quiet", "--locked", "--workspace", "--bin", "hil"]);
    build.args(["--example", "forty_lines"]);
    process::run(build.current_dir(workspace::root()))?;
    let mut suite = Command::new(workspace::host_target_folder().join("debug/hil"));
    if arguments.virtual_stylus || arguments.flash {
        let toolchain = Toolchain::find()?;
        let product = firmware::build(&toolchain, Image::Product)?;
        let faults = firmware::build(&toolchain, Image::FaultInjection)?;
        if arguments.virtual_stylus {
            suite.arg("--virtual-stylus").arg(virtual_stylus::build_as_tested()?);
        } else {
            let program = firmware::probe_rs()?;
            firmware::download(&product)?;
            suite.arg("--probe-rs").arg(program);
        }
        suite.arg("--product-image").arg(product);
        suite.arg("--fault-image").arg(faults);
    }
    let minutes = arguments.minutes.unwrap_or(if arguments.virtual_stylus {
        VIRTUAL_MINUTES
    } else {
        BOARD_MINUTES
    });
    suite.args(["--minutes", &minutes.to_string()]);
    // The environment may name the link of a board, for other commands.
    let link = arguments.link.iter().filter(|_| !arguments.virtual_stylus);
    suite.args(link.flat_map(|link| ["--link", link]));
    let files = [("--json-out", &arguments.json_out), ("--library", &arguments.library)];
    for (option, file) in files {
        if let Some(file) = file {
            suite.arg(option).arg(file);
        }
    }
    suite.args(arguments.yes.then_some("--yes"));
    // No amplifier is connected to the virtual stylus.
    let no_amplifier = arguments.no_amplifier || arguments.virtual_stylus;
    suite.args(no_amplifier.then_some("--no-amplifier"));
    process::run(&mut suite)
}
