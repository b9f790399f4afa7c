//! The virtual stylus as a command: the flashed image on an emulated part, with its serial line and its USB on sockets.

use std::io::{BufRead, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use anyhow::Result;
use clap::Parser;
use stylus_board::{ALL, Board, named};
use stylus_plant::{Parameters, Plant};
use virtual_link::announcement::Announcement;
use virtual_stylus::chance::Chance;
use virtual_stylus::flash_file::FlashFile;
use virtual_stylus::model::adc::Pins;
use virtual_stylus::model::flash::Contents;
use virtual_stylus::motion::{Motion, MotionLine, read_csv};
use virtual_stylus::pace::Pace;
use virtual_stylus::sensors::{self, ActuatedPins, FULL_SCALE, FunctionPins, MID_SCALE, REFERENCE_VOLTS, force_at};
use virtual_stylus::sockets::{SerialSocket, UsbSocket};
use virtual_stylus::tick::TickStatistics;
use virtual_stylus::{Options, ResetCause, RunReport, VirtualStylus};

/// Virtual time between two comparisons with the wall clock, if no program or host is on a socket.
const STEP_NS: u64 = 1_000_000;
/// Virtual time between two comparisons with the wall clock, with a program at the serial line.
const SERIAL_STEP_NS: u64 = 250_000;
/// Virtual time between two comparisons with the wall clock, with a host on USB.
const USB_STEP_NS: u64 = 125_000;
const NANOS_PER_SECOND: f64 = 1e9;

/// Exit code if the user can correct the reason why the run did not start. The product's command uses the same code.
const EXIT_UNUSABLE: u8 = 2;

/// Runs the stylus's image, unmodified, on an emulated STM32H743 in virtual time
#[derive(Parser)]
#[command(name = "virtual-stylus", version)]
struct Arguments {
    /// The board, by the name of its file in firmware/boards/
    #[arg(long, value_parser = named, default_value = ALL[0].name)]
    board: &'static Board,
    /// The ELF file that `cargo firmware` built
    #[arg(long)]
    image: PathBuf,
    /// Stop after this many seconds of virtual time; without it, run until interrupted
    #[arg(long)]
    seconds: Option<f64>,
    /// Put the serial line on this port of the loopback interface (0: any), for `stylus --link tcp:127.0.0.1:PORT`
    #[arg(long)]
    port: Option<u16>,
    /// Plug USB into a host on this port of the loopback interface (0: any), for `stylus --link
    /// usb-virtual:127.0.0.1:PORT`
    #[arg(long)]
    usb_port: Option<u16>,
    /// Keep the content of the flash in this file, from run to run
    #[arg(long)]
    flash: Option<PathBuf>,
    /// Move the tool as this file says: time_s,speed_mm_s,force_n
    #[arg(long)]
    motion: Option<PathBuf>,
    /// Put the actuator model in this TOML file, or of this name, at the output: its accelerometer is on the pins
    #[arg(long)]
    plant: Option<PathBuf>,
    /// Vary the actuator model by this seed
    #[arg(long, requires = "plant")]
    plant_seed: Option<u64>,
    /// Hold the button while power comes on, and during the run
    #[arg(long)]
    button: bool,
    /// Run as fast as this computer can, instead of in real time
    #[arg(long)]
    fast: bool,
    /// Take commands from the standard input: a line `reset` resets the part by its pin, and its end ends the run
    #[arg(long)]
    commands: bool,
}

/// What a run has besides the stylus: links, the flash's file and the announcement.
struct Around {
    serial: Option<SerialSocket>,
    usb: Option<UsbSocket>,
    flash: Option<FlashFile>,
    /// The announcement by which `stylus devices` finds the stylus. It lasts as long as the stylus runs.
    announced: Option<Announcement>,
}

impl Around {
    /// Virtual time between two comparisons with the wall clock.
    fn step_ns(&self) -> u64 {
        match (&self.usb, &self.serial) {
            (Some(_), _) => USB_STEP_NS,
            (None, Some(_)) => SERIAL_STEP_NS,
            (None, None) => STEP_NS,
        }
    }

    /// Passes on, in both directions, what has arrived over the links.
    fn serve(&mut self, stylus: &mut VirtualStylus) {
        if let Some(serial) = &mut self.serial {
            serial.serve(stylus);
        }
        if let Some(usb) = &mut self.usb {
            usb.serve(stylus);
        }
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let (mut stylus, mut around) = match start(&arguments) {
        Ok(started) => started,
        Err(failure) => return failed(&failure, ExitCode::from(EXIT_UNUSABLE)),
    };
    let end_ns = arguments.seconds.map_or(u64::MAX, nanos);
    let ran = run(&mut stylus, &mut around, end_ns, &arguments);
    let kept = finish(&mut stylus, around.flash.as_mut());
    match ran.and(kept) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failed(&failure, ExitCode::FAILURE),
    }
}

/// Reports in one line why a run did not start or continue.
fn failed(failure: &anyhow::Error, code: ExitCode) -> ExitCode {
    eprintln!("virtual-stylus: {failure:#}");
    code
}

/// Reads the files, opens the flash's file, and opens the sockets.
fn start(arguments: &Arguments) -> Result<(VirtualStylus, Around)> {
    let (flash, contents) = match &arguments.flash {
        Some(path) => {
            let (file, contents) = FlashFile::open(path)?;
            (Some(file), contents)
        }
        None => (None, Contents::default()),
    };
    let lines = arguments
        .motion
        .as_deref()
        .map(read_csv)
        .transpose()?
        .unwrap_or_default();
    let speeds: Vec<(u64, f64)> = lines.iter().map(|line| (nanos(line.time_s), line.speed_mm_s)).collect();
    let options = options(arguments, contents, lines)?;
    let mut stylus = VirtualStylus::new(&arguments.image, options)?;
    stylus.press_button(arguments.button);
    if arguments.motion.is_some() {
        stylus.set_motion(Motion::linear(&speeds, sensors::mm_per_count())?);
    }
    let mut links = Vec::new();
    let serial = arguments.port.map(SerialSocket::listen).transpose()?;
    if let Some(serial) = &serial {
        let port = serial.port()?;
        println!("serial line on 127.0.0.1:{port}");
        // A program that has started this one learns the port from this line.
        std::io::stdout().flush()?;
        links.push(format!("tcp:127.0.0.1:{port}"));
    }
    let usb = arguments.usb_port.map(UsbSocket::listen).transpose()?;
    if let Some(usb) = &usb {
        let port = usb.port()?;
        println!("USB on 127.0.0.1:{port}");
        std::io::stdout().flush()?;
        links.push(format!("usb-virtual:127.0.0.1:{port}"));
    }
    let around = Around {
        serial,
        usb,
        flash,
        announced: announce(&links),
    };
    Ok((stylus, around))
}

/// Announces the links. If the folder cannot be used, this is reported and the run continues.
fn announce(links: &[String]) -> Option<Announcement> {
    if links.is_empty() {
        return None;
    }
    Announcement::new(links)
        .inspect_err(|failure| eprintln!("`stylus devices` will not find it: {failure}"))
        .ok()
}

fn options(arguments: &Arguments, flash: Contents, lines: Vec<MotionLine>) -> Result<Options> {
    let board = arguments.board;
    let mut pins = sensor_pins(board.inputs[3], lines);
    if let Some(source) = &arguments.plant {
        let mut parameters = Parameters::read(source)?;
        let seed = arguments.plant_seed.unwrap_or_default();
        if arguments.plant_seed.is_some() {
            parameters = parameters.varied(seed);
        }
        pins = Box::new(ActuatedPins::new(board, Plant::new(&parameters, seed), pins));
    }
    Ok(Options {
        flash,
        pins,
        ..Options::on(board)
    })
}

/// Pins of the sensors: the accelerometer at rest, and the force of the motion on the channel `force`.
fn sensor_pins(force: u8, lines: Vec<MotionLine>) -> Box<dyn Pins> {
    let (zero, scale) = (sensors::force_zero_volts(), sensors::newtons_per_volt());
    Box::new(FunctionPins(move |channel: u8, at_ns: u64| {
        let code = if channel == force {
            let volts = zero + force_at(&lines, at_ns as f64 / NANOS_PER_SECOND) / scale;
            volts / REFERENCE_VOLTS * FULL_SCALE
        } else {
            f64::from(MID_SCALE)
        };
        let code = code + noise(channel, at_ns);
        code.round().clamp(0.0, FULL_SCALE) as u16
    }))
}

/// Noise of a pin, codes, the same in every run. Without noise, the converter could not be distinguished from one that
/// is stuck.
fn noise(channel: u8, at_ns: u64) -> f64 {
    /// Largest magnitude.
    const CODES: f64 = 4.0;
    (Chance(at_ns ^ u64::from(channel) << 56).fraction() * 2.0 - 1.0) * CODES
}

fn run(stylus: &mut VirtualStylus, around: &mut Around, end_ns: u64, arguments: &Arguments) -> Result<()> {
    /// Real time between two writes of the flash to its file. These writes keep the flash if the run is interrupted.
    const KEEP_EVERY: Duration = Duration::from_secs(5);
    /// Real time between two announcements of the virtual time.
    const TELL_EVERY: Duration = Duration::from_millis(100);
    let commands = arguments.commands.then(commands);
    let began = Instant::now();
    let (mut kept, mut told) = (began, began);
    let mut operations = 0;
    let mut pace = Pace::default();
    while stylus.now_ns() < end_ns {
        match commands.as_ref().map(Receiver::try_recv) {
            Some(Ok(Command::Reset)) => stylus.reset_by_pin(),
            Some(Err(TryRecvError::Disconnected)) => return Ok(()),
            None | Some(Err(TryRecvError::Empty)) => {}
        }
        stylus.run_until((stylus.now_ns() + around.step_ns()).min(end_ns));
        around.serve(stylus);
        let virtual_time = Duration::from_nanos(stylus.now_ns());
        if let Some(announced) = (around.announced.as_mut()).filter(|_| told.elapsed() > TELL_EVERY) {
            // If the time cannot be announced, programs wait for less time than they should. That is no reason to end
            // the run.
            let _ = announced.tell_time(virtual_time);
            told = Instant::now();
        }
        if !arguments.fast {
            let real = began.elapsed();
            if let Some(share) = pace.slow(real, virtual_time) {
                eprintln!(
                    "runs at {share:.2} of real time, because this computer is busy: commands take longer by as much"
                );
            }
            std::thread::sleep(virtual_time.saturating_sub(real));
        }
        if let Some(flash) = (around.flash.as_mut()).filter(|_| kept.elapsed() > KEEP_EVERY) {
            let now = stylus.board(|board| board.part.flash.around.started());
            // Two megabytes are written only if the flash has changed.
            if now != operations {
                flash.write(&stylus.flash())?;
                operations = now;
            }
            kept = Instant::now();
        }
    }
    Ok(())
}

/// A command from the standard input.
enum Command {
    Reset,
}

/// Receives the commands from the standard input. The channel is disconnected when the input ends.
fn commands() -> Receiver<Command> {
    let (sender, commands) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            match line.as_deref().map(str::trim) {
                Ok("reset") => {
                    if sender.send(Command::Reset).is_err() {
                        return;
                    }
                }
                Ok(other) => eprintln!("no command '{other}': there is `reset`"),
                Err(_) => return,
            }
        }
    });
    commands
}

fn finish(stylus: &mut VirtualStylus, flash: Option<&mut FlashFile>) -> Result<()> {
    println!("ran {:.3} s", stylus.now_ns() as f64 / NANOS_PER_SECOND);
    for reset in stylus.resets() {
        let cause = match reset.cause {
            ResetCause::Software => "by the image",
            ResetCause::Watchdog => "by the watchdog",
            ResetCause::Other => "otherwise",
        };
        println!("reset {cause} at {:.6} s", reset.at_ns as f64 / NANOS_PER_SECOND);
    }
    let record = stylus.take_dac_record();
    println!("voice coil output: {} instants, last {:?}", record.len(), record.last());
    if let Some(ticks) = TickStatistics::of(&stylus.take_ticks()) {
        println!(
            "ticks: {}, instructions min {} median {} max {}; {} not followed",
            ticks.ticks,
            ticks.min,
            ticks.median,
            ticks.max,
            stylus.unfollowed_ticks()
        );
    }
    print(&stylus.report());
    if let Some(flash) = flash {
        flash.write(&stylus.flash())?;
    }
    Ok(())
}

fn print(report: &RunReport) {
    let parts = [
        ("registers without a model", &report.without_model),
        ("nothing there", &report.unmapped),
        ("refused by the part", &report.refused),
        ("asked of a model that leaves it out", &report.told),
        ("interrupts without a line", &report.unrouted),
    ];
    for (what, lines) in parts {
        if !lines.is_empty() {
            println!("{what}:");
            for line in lines {
                println!("  {line}");
            }
        }
    }
}

fn nanos(seconds: f64) -> u64 {
    (seconds * NANOS_PER_SECOND) as u64
}
