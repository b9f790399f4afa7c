//! The image's tests on a real board, or on the virtual stylus: runs the package `hil` in `tests/hil` with the images,
//! the probe or the emulator that it needs.

use std::ffi::OsString;
use std::process::Command;

use anyhow::Result;
use stylus_board::Board;

use crate::firmware::{self, Image};
use crate::toolchain::Toolchain;
use crate::{process, virtual_stylus, workspace};

/// Options of `cargo tasks hil`. All others are those of the program.
#[derive(clap::Args)]
pub struct Arguments {
    /// Flash the product's image by the probe first, and the one with faults on request for the tests of faults
    #[arg(long, conflicts_with = "virtual_stylus")]
    flash: bool,
    /// Start a virtual stylus in place of a board
    #[arg(long)]
    virtual_stylus: bool,
    /// Arguments of the tests, behind these: `-- --help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    of_tests: Vec<OsString>,
}

/// Runs the suite.
pub fn run(board: &Board, arguments: &Arguments) -> Result<()> {
    // Building an example selects the same features as the tests, with which the library of the host's tools is already
    // built.
    let mut build = Command::new("cargo");
    build.args(["build", "--quiet", "--locked", "--workspace", "--bin", "hil"]);
    build.args(["--example", "forty_lines"]);
    process::run(build.current_dir(workspace::root()))?;
    let mut suite = Command::new(workspace::host_target_folder().join("debug/hil"));
    if arguments.virtual_stylus || arguments.flash {
        let toolchain = Toolchain::find()?;
        let product = firmware::build(&toolchain, board, Image::Product)?;
        let faults = firmware::build(&toolchain, board, Image::FaultInjection)?;
        if arguments.virtual_stylus {
            suite.arg("--virtual-stylus").arg(virtual_stylus::build_as_tested()?);
        } else {
            let program = firmware::probe_rs()?;
            firmware::download(&product, board)?;
            suite.arg("--probe-rs").arg(program);
        }
        suite.arg("--product-image").arg(product);
        suite.arg("--fault-image").arg(faults);
    }
    if arguments.virtual_stylus {
        // The environment may name the link of a board, for other commands.
        suite.env_remove("STYLUS_LINK");
    }
    suite.args(["--board", board.name]).args(&arguments.of_tests);
    process::run(&mut suite)
}
