//! `cargo tasks hil` runs this program.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Parser;
use hil::bench::{DeviceUnderTest, Lengths};
use hil::board::{Board, Images, Probe, VirtualBoard};
use hil::report::{Error, Result};
use hil::report::{Report, Test};
use hil::suite::{overwrites, run};
use serde::Serialize;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use stylus_link::link::{Device, LinkAddress, Timeouts};

/// Exit code after a second interrupt.
const EXIT_INTERRUPTED: i32 = 130;

/// Longest wait for an answer of an emulated device, which may share its processor with a build. A request that is lost
/// in a reset costs this time.
const EMULATED_ANSWER: Duration = Duration::from_secs(6);

/// Runs the image's tests against a real board, or the virtual stylus, over its link
#[derive(Parser)]
#[command(name = "cargo tasks hil", bin_name = "cargo tasks hil")]
struct Arguments {
    /// The stylus: usb[:SERIAL], serial:PATH, tcp:HOST:PORT or usb-virtual:HOST:PORT
    #[arg(long, env = "STYLUS_LINK", required_unless_present = "virtual_stylus")]
    link: Option<LinkAddress>,
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
    /// The program probe-rs, which resets the board and exchanges its image
    #[arg(long, hide = true, requires_all = ["product_image", "fault_image"])]
    probe_rs: Option<PathBuf>,
    /// The virtual stylus's program, which is started and takes the place of a board
    #[arg(long, hide = true, conflicts_with = "link", requires_all = ["product_image", "fault_image"])]
    virtual_stylus: Option<PathBuf>,
    /// The board's name
    #[arg(long, hide = true, value_parser = stylus_board::named, default_value = stylus_board::ALL[0].name)]
    board: &'static stylus_board::Board,
    /// The ELF file of the product's image
    #[arg(long, hide = true)]
    product_image: Option<PathBuf>,
    /// The ELF file of the image with faults on request
    #[arg(long, hide = true)]
    fault_image: Option<PathBuf>,
}

fn main() -> ExitCode {
    match tested(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Runs the tests. Returns true if the report holds.
fn tested(arguments: &Arguments) -> Result<bool> {
    let interrupt = Arc::new(AtomicBool::new(false));
    listen(&interrupt)?;
    let (board, address) = board(arguments)?;
    let is_slow = board.is_emulated() || matches!(address, LinkAddress::Tcp { .. } | LinkAddress::UsbVirtual { .. });
    let timeouts = if is_slow {
        Timeouts::scaled_to(EMULATED_ANSWER)
    } else {
        Timeouts::default()
    };
    let device = connect(&address, timeouts)?;
    let mut bench = DeviceUnderTest::new(device, board, lengths(arguments), interrupt, |test: &Test| {
        println!("{test}");
    });
    // None is connected to the virtual stylus.
    bench.no_amplifier = arguments.no_amplifier || arguments.virtual_stylus.is_some();
    println!(
        "{} {} over {address}{}",
        bench.device.info().product,
        bench.device.info().serial,
        if bench.is_emulated() {
            ", emulated: no figure below is a board's"
        } else {
            ""
        }
    );
    if !may_overwrite(&bench, arguments)? {
        eprintln!("nothing was changed");
        // Nothing was tested either, so this is no success.
        return Ok(false);
    }
    let restored = run(&mut bench, arguments.library.clone());
    println!("{}", bench.report.summary());
    if let Some(path) = &arguments.json_out {
        write_json(&bench, path)?;
    }
    restored?;
    Ok(bench.report.holds())
}

/// Makes Ctrl-C and SIGTERM raise the flag, because the stylus must be left silent and with its settings. A second
/// signal ends the process at once.
fn listen(interrupt: &Arc<AtomicBool>) -> Result<()> {
    for signal in [SIGINT, SIGTERM] {
        // Registered first, so that it sees the flag before the present signal raises it.
        flag::register_conditional_shutdown(signal, EXIT_INTERRUPTED, interrupt.clone())?;
        flag::register(signal, interrupt.clone())?;
    }
    Ok(())
}

fn board(arguments: &Arguments) -> Result<(Board, LinkAddress)> {
    let images = || Images {
        board: arguments.board,
        product: arguments.product_image.clone().unwrap_or_default(),
        faults: arguments.fault_image.clone().unwrap_or_default(),
    };
    if let Some(program) = &arguments.virtual_stylus {
        let board = VirtualBoard::start(program.clone(), images())?;
        let link = board.link().parse().expect("it is an address");
        return Ok((Board::Virtual(board), link));
    }
    let board = match &arguments.probe_rs {
        Some(program) => Board::Probe(Probe {
            program: program.clone(),
            images: images(),
        }),
        None => Board::ByHand,
    };
    let link = arguments.link.clone().expect("required without the virtual stylus");
    Ok((board, link))
}

/// Opens the link. A board that was just flashed, or a virtual stylus that was just started, may not answer at once.
fn connect(address: &LinkAddress, timeouts: Timeouts) -> Result<Device> {
    const ATTEMPTS: u32 = 10;
    let mut attempt = 1;
    loop {
        match Device::connect(address, timeouts) {
            Ok(device) => return Ok(device),
            Err(error) if attempt == ATTEMPTS || !error.is_passing() => return Err(error.into()),
            Err(_) => std::thread::sleep(Duration::from_millis(500)),
        }
        attempt += 1;
    }
}

fn lengths(arguments: &Arguments) -> Lengths {
    let is_virtual = arguments.virtual_stylus.is_some();
    let minutes = arguments.minutes.unwrap_or(if is_virtual { 0.02 } else { 10.0 });
    let endurance_ms = (minutes * 60e3).max(0.0) as u64;
    if is_virtual {
        Lengths {
            play_ms: 40,
            record_ms: 500,
            endurance_ms,
            // Emulated flash does not wear.
            between_uploads_ms: 0,
        }
    } else {
        Lengths {
            play_ms: 1_000,
            record_ms: 60_000.min(endurance_ms),
            endurance_ms,
            between_uploads_ms: 6_000,
        }
    }
}

/// Lists what the run overwrites, and asks whether it may.
fn may_overwrite(bench: &DeviceUnderTest, arguments: &Arguments) -> Result<bool> {
    let overwritten = overwrites(bench)?;
    if overwritten.is_empty() {
        return Ok(true);
    }
    println!("this overwrites, and cannot read back before:");
    for one in overwritten {
        println!("  {one}");
    }
    if let Some(path) = &arguments.library {
        println!("at the end {} is uploaded and activated", path.display());
    }
    if arguments.yes {
        return Ok(true);
    }
    if !std::io::stdin().is_terminal() {
        return Err(Error::Program {
            program: "cargo tasks hil".to_owned(),
            problem: "nobody is there to be asked: give --yes".to_owned(),
        });
    }
    print!("go on? [y/N] ");
    std::io::stdout().flush()?;
    let mut answer = String::new();
    std::io::stdin().read_line(&mut answer)?;
    Ok(answer.trim().eq_ignore_ascii_case("y"))
}

#[derive(Serialize)]
struct Written<'a> {
    link: String,
    serial: &'a str,
    firmware_version: &'a str,
    build: &'a str,
    emulated: bool,
    holds: bool,
    summary: String,
    #[serde(flatten)]
    report: &'a Report,
}

fn write_json(bench: &DeviceUnderTest, path: &PathBuf) -> Result<()> {
    let info = bench.device.info();
    let written = Written {
        link: bench.device.address().to_string(),
        serial: &info.serial,
        firmware_version: &info.firmware_version,
        build: &info.build,
        emulated: bench.is_emulated(),
        holds: bench.report.holds(),
        summary: bench.report.summary(),
        report: &bench.report,
    };
    let text = serde_json::to_string_pretty(&written).expect("plain data") + "\n";
    std::fs::write(path, text).map_err(|source| Error::File {
        path: path.clone(),
        source,
    })
}
