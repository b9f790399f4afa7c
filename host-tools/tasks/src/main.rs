//! `cargo tasks`: builds for the microcontroller's core, and runs on emulated processors.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::{Parser, Subcommand};
use stylus_board::Board;
use tasks::firmware::Image;
use tasks::process::Progress;
use tasks::toolchain::{Toolchain, check_clippy};
use tasks::{attack, browser_module, firmware, hil, house, lint, qemu, release, tables, virtual_stylus, workspace};

/// Tasks around the microcontroller's core.
#[derive(Parser)]
#[command(name = "cargo tasks", bin_name = "cargo tasks")]
struct Arguments {
    /// The board of images, by the name of its file in firmware/boards/
    #[arg(long, global = true, value_parser = stylus_board::named, default_value = stylus_board::ALL[0].name)]
    board: &'static Board,
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// List the needed programs, and how to install the missing ones
    Setup,
    /// Build the image for the STM32H743, check the place of the tick's code, and show the use of each memory
    Firmware {
        /// With faults on request, for tests
        #[arg(long)]
        fault_injection: bool,
    },
    /// Build the image, and write the signed file for `stylus update`
    Image(firmware::UpdateArguments),
    /// Make a pair of keys for signing updates: the secret one in a new file, the public one beside it
    Keys {
        /// The new file; keep it where nobody else reads it
        file: PathBuf,
    },
    /// Build the image here and in another folder, and compare the bytes (some minutes)
    Reproducible,
    /// Build the image, flash it with probe-rs, and show its log
    Flash {
        /// An image whose watchdog waits while a debugger halts the core; never with a coil
        #[arg(long)]
        debug_halt: bool,
    },
    /// Build the image and run it on an emulated STM32H743, with a socket for `stylus --link tcp:`
    VirtualStylus {
        /// Arguments of the virtual stylus: `-- --help` lists them
        #[arg(last = true)]
        arguments: Vec<OsString>,
    },
    /// Build the images and run the tests of them on the virtual stylus
    TestVirtualStylus {
        /// A minute of recording instead of seconds, a million frames instead of thousands
        #[arg(long)]
        long: bool,
        /// Arguments of the tests, such as a name
        #[arg(last = true)]
        arguments: Vec<OsString>,
    },
    /// Run the image's tests against a real board, or the virtual stylus, over its link
    Hil(hil::Arguments),
    /// Check that code and pages keep to the drawn layout: import circles, line lengths, names in pages
    House,
    /// Write tables of figures into the pages: the named ones, or all that need no build and no emulator
    Tables {
        /// Names of tables
        names: Vec<String>,
        /// Write nothing, and fail with page and row if a table differs from what this would write
        #[arg(long, conflicts_with = "names")]
        check: bool,
    },
    /// Fuzz, model-check starts and interleaved requests, and draw cases for settings, leases, output and bounds, with
    /// fresh seeds as long as asked
    Attack(attack::Arguments),
    /// Soak test on the virtual stylus: two hosts and random faults, with invariants checked
    Soak(attack::SoakArguments),
    /// Build the kernel as a page's WebAssembly module, and keep it in host-tools/report/src/rub_page
    BrowserModule {
        /// Keep nothing, and fail if the kept module is not what this builds: byte by byte where the compiler is that
        /// of the kept one, else by its samples
        #[arg(long)]
        check: bool,
    },
    /// Build the a page that records, fits and plays with nothing installed: target/lab/stylus-lab.html
    Lab,
    /// Build all that a person downloads: image, command for three systems, wheel, module, contents and
    /// checksums
    Release(release::Arguments),
    /// Lint all code for the target; with the compiler that rust-version names, every warning fails
    CheckTarget,
    /// Lint the virtual stylus; with the compiler that rust-version names, every warning fails
    CheckVirtualStylus,
}

fn main() -> ExitCode {
    let Arguments { board, task } = Arguments::parse();
    let done = match task {
        Task::Setup => setup(),
        Task::Firmware { fault_injection } => {
            build_firmware(board, either(fault_injection, Image::FaultInjection)).map(drop)
        }
        Task::Image(arguments) => build_firmware(board, Image::Product)
            .and_then(|file| firmware::write_update(&file, board, &arguments))
            .map(|written| println!("{}", written.display())),
        Task::Keys { file } => firmware::make_keys(&file).map(|public| {
            let secret = file.display();
            println!("{secret}: secret, signs updates: cargo tasks image --key");
            println!("{}: for builds: STYLUS_UPDATE_KEY", public.display());
        }),
        Task::Reproducible => Toolchain::find()
            .and_then(|toolchain| firmware::check_reproducible(&toolchain, board))
            .map(|bytes| println!("the same {bytes} bytes from two folders")),
        Task::Flash { debug_halt } => {
            build_firmware(board, either(debug_halt, Image::DebugHalt)).and_then(|file| firmware::flash(&file, board))
        }
        Task::VirtualStylus { arguments } => {
            match Toolchain::find().and_then(|found| virtual_stylus::run(&found, board, &arguments)) {
                Ok(code) => return ExitCode::from(code),
                Err(failure) => Err(failure),
            }
        }
        Task::TestVirtualStylus { long, arguments } => {
            Toolchain::find().and_then(|toolchain| virtual_stylus::test(&toolchain, long, &arguments))
        }
        Task::Hil(arguments) => hil::run(board, &arguments),
        Task::Attack(arguments) => attack::run(&arguments),
        Task::Soak(arguments) => attack::soak(&arguments),
        Task::House => check_house(),
        Task::Tables { check: true, .. } => tables::check_instant(),
        Task::Tables { names, .. } => write_tables(names),
        Task::BrowserModule { check } => {
            let done = if check {
                browser_module::check()
            } else {
                browser_module::write()
            };
            done.map(|told| println!("{told}"))
        }
        Task::Lab => browser_module::write_laboratory().map(|page| println!("{}", page.display())),
        Task::Release(arguments) => release::run(&arguments).map(|folder| println!("{}", folder.display())),
        Task::CheckVirtualStylus => virtual_stylus::lint(),
        Task::CheckTarget => Toolchain::find().and_then(|toolchain| lint::check_target(&toolchain)),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Returns `image` if it was requested, else the product's.
fn either(is_asked: bool, image: Image) -> Image {
    if is_asked { image } else { Image::Product }
}

/// Lists every needed program, and fails if one is missing.
fn setup() -> Result<()> {
    let toolchain = Toolchain::find();
    let lints = toolchain.as_ref().ok().map_or(Ok(()), check_clippy);
    let programs = [
        ("toolchain for the target", toolchain.map(|found| found.to_string())),
        ("lints for the target", lints.map(|()| "found".to_owned())),
        ("emulator", qemu::version()),
    ];
    let mut missing = 0;
    for (what, found) in programs {
        missing += usize::from(found.is_err());
        println!(
            "{what}: {}",
            found.unwrap_or_else(|error| format!("missing: {error:#}"))
        );
    }
    // What runs on emulators needs none.
    let probe = firmware::probe_rs().map(|program| program.display().to_string());
    println!(
        "probe-rs, for a board alone: {}",
        probe.unwrap_or_else(|error| format!("missing: {error:#}"))
    );
    match missing {
        0 => Ok(()),
        _ => bail!("{missing} of these are missing"),
    }
}

/// Builds the image, and prints each memory's use and the file's path. Progress is shown, because a first build takes
/// minutes.
fn build_firmware(board: &Board, image: Image) -> Result<PathBuf> {
    let file = firmware::build_saying(&Toolchain::find()?, board, image, Progress::Shown)?;
    print!("{}", firmware::memory(&file)?);
    println!("{}", file.display());
    Ok(file)
}

/// Prints one line per departure from the rules of the layout.
fn check_house() -> Result<()> {
    let findings = house::check(workspace::root())?.0;
    for (path, line, problem) in &findings {
        println!("{path}:{line}: {problem}");
    }
    match findings.len() {
        0 => Ok(()),
        count => {
            bail!("the house is not as drawn, in {count} places above; the rules are in host-tools/tasks/src/house")
        }
    }
}

/// Writes the tables called `names`. Without names, writes those that need no build.
fn write_tables(mut names: Vec<String>) -> Result<()> {
    let asked = names.len();
    names.retain(|name| name != tables::TICKS);
    if names.len() < asked {
        virtual_stylus::write_ticks(&Toolchain::find()?)?;
        if names.is_empty() {
            return Ok(());
        }
    }
    tables::write(&names, |name| println!("{name}: written"))
}
