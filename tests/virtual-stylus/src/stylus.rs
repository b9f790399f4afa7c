//! A run of an image, stopped and looked at as a test likes.
//!
//! The emulator runs on a thread of its own and is handed instants to reach; between two of them it waits, and closures
//! can be run beside it with the board and its memory in hand.

use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use rigless::emulator::{self, Driver, Host, Settled, Start, Stop};
use rigless::image::Image;
use rigless::mcu::Operate;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::symbols::Symbols;
use rigless::time::VirtualNanos;

use crate::board::StylusBoard;
use crate::core::{Audit, Auditor};
use crate::error::{Error, Result};
use crate::model::adc::{Pins, Sample};
use crate::model::dac::Output;
use crate::model::flash::{BASE, BYTES, Contents, Kind, Moment, Operation, Unreadable, WORD_BYTES};
use crate::model::usb::host::Host as UsbHost;
use crate::motion::Motion;
use crate::pins::ConstantPins;
use crate::serial::Sent;
use crate::tick::{Tick, TickWatch};

/// 400 MHz at two cycles an instruction, where a Cortex-M7 often retires two instructions a cycle.
pub const PESSIMISTIC_INSTRUCTIONS_PER_SECOND: NonZeroU64 =
    NonZeroU64::new(200_000_000).expect("not zero");
/// The name of the tick's handler in the image.
const TICK_HANDLER: &str = "TIM6_DAC";

/// How a run begins.
#[derive(Debug)]
pub struct Options {
    /// What the flash holds before the image is put into it.
    pub flash: Contents,
    /// Leaves the image out of the flash: what it holds is what runs, as after a power cut.
    pub keep_flash: bool,
    /// How fast the core is in virtual time.
    pub instructions_per_second: NonZeroU64,
    /// What is on the converter's pins.
    pub pins: Box<dyn Pins>,
    /// Cuts the power at this flash operation, counted from 1, at this moment of it.
    pub power_cut: Option<(u64, Moment)>,
    /// Follows the ticks.
    pub watch_ticks: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            flash: Contents::default(),
            keep_flash: false,
            instructions_per_second: PESSIMISTIC_INSTRUCTIONS_PER_SECOND,
            pins: Box::new(ConstantPins::default()),
            power_cut: None,
            watch_ticks: true,
        }
    }
}

/// Why the part was reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// The image asked for it.
    Software,
    /// The watchdog ended its count.
    Watchdog,
    /// Anything else.
    Other,
}

/// A reset of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reset {
    /// When, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// Why.
    pub cause: ResetCause,
}

/// What the run met that the part would answer and no model does.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Registers without a model that were written or read, with counts.
    pub without_model: Vec<String>,
    /// Addresses where nothing is, and where they were accessed from.
    pub unmapped: Vec<String>,
    /// Accesses that the part refuses, such as of an instance whose clock is off.
    pub refused: Vec<String>,
    /// What models were asked for and do not do.
    pub told: Vec<String>,
    /// Interrupts that reach no line of the core.
    pub unrouted: Vec<String>,
}

/// What a power cut would have left in the flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PowerCut {
    /// The operation that would have been cut.
    pub operation: Operation,
    /// The moment of it.
    pub moment: Moment,
    /// What the flash would have held.
    pub contents: Contents,
}

type Job = Box<dyn FnOnce(&mut Session<StylusBoard>, &mut Hands, &mut dyn Host) + Send>;

enum Command {
    RunUntil(u64),
    Do(Job),
}

/// Where the emulator's thread stands.
#[derive(Clone, Debug)]
enum Stopped {
    At(u64),
    PowerCut {
        operation: Operation,
        contents: Box<Contents>,
    },
}

/// The thread's own side.
struct Hands {
    commands: Receiver<Command>,
    stops: Sender<Stopped>,
    ticks: TickWatch,
    power_cut: Option<(u64, Moment)>,
    cut: Option<(Operation, Contents)>,
    to_capture: Vec<(u64, Moment)>,
    captured: Vec<PowerCut>,
    unreadable: Unreadable,
    resets: usize,
}

impl Hands {
    /// What the flash holds.
    fn contents(&self, host: &mut dyn Host) -> Contents {
        let mut bytes = Vec::with_capacity(BYTES);
        for address in (u64::from(BASE)..).step_by(8).take(BYTES / 8) {
            let piece = host.read(address, Width::W64).expect("the flash is mapped");
            bytes.extend_from_slice(&piece.to_le_bytes());
        }
        Contents {
            bytes,
            unreadable: self.unreadable.words(),
        }
    }

    fn started(
        &mut self,
        operation: Operation,
        session: &mut Session<StylusBoard>,
        host: &mut dyn Host,
    ) {
        let moments = self
            .to_capture
            .iter()
            .filter(|(number, _)| *number == operation.number);
        for moment in moments.map(|(_, moment)| *moment).collect::<Vec<_>>() {
            let mut contents = self.contents(host);
            contents.cut(&operation.kind, moment);
            self.captured.push(PowerCut {
                operation: operation.clone(),
                moment,
                contents,
            });
        }
        if let Some((number, moment)) = self.power_cut
            && operation.number == number
            && self.cut.is_none()
        {
            let mut contents = self.contents(host);
            contents.cut(&operation.kind, moment);
            session.run_until(VirtualNanos(operation.at_ns));
            self.cut = Some((operation, contents));
            return;
        }
        if let Kind::Program { address, .. } = operation.kind
            && !erased(address, host)
        {
            self.unreadable.mark(address);
        }
    }
}

fn erased(address: u32, host: &mut dyn Host) -> bool {
    (u64::from(address)..)
        .step_by(8)
        .take(WORD_BYTES as usize / 8)
        .all(|piece| {
            host.read(piece, Width::W64)
                .is_ok_and(|bits| bits == u64::MAX)
        })
}

impl Driver<StylusBoard> for Hands {
    fn on_settled(
        &mut self,
        session: &mut Session<StylusBoard>,
        host: &mut dyn Host,
        settled: Settled,
    ) {
        if session.resets().len() != self.resets {
            self.resets = session.resets().len();
            self.ticks.reset();
        }
        let watch = match settled {
            Settled::Hit(hit) => self.ticks.hit(&hit),
            Settled::Stop(_) => self.ticks.audited(),
            Settled::Access { .. } => {
                while let Some(operation) = session.board_mut().part.flash.around.take_started() {
                    self.started(operation, session, host);
                }
                None
            }
            _ => None,
        };
        if let Some(watch) = watch {
            session.watch(watch);
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<StylusBoard>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        if let Some((operation, contents)) = self.cut.take() {
            let contents = Box::new(contents);
            let _ = self.stops.send(Stopped::PowerCut {
                operation,
                contents,
            });
            return None;
        }
        self.stops.send(Stopped::At(stop.at.0)).ok()?;
        loop {
            // Nobody is left to ask: the run is over.
            match self.commands.recv().ok()? {
                Command::RunUntil(at_ns) => return Some(VirtualNanos(at_ns)),
                Command::Do(job) => job(session, self, host),
            }
        }
    }
}

/// A run of an image.
#[derive(Debug)]
pub struct VirtualStylus {
    commands: Option<Sender<Command>>,
    stops: Receiver<Stopped>,
    thread: Option<JoinHandle<Result<()>>>,
    now_ns: u64,
    cut: Option<(Operation, Box<Contents>)>,
}

impl VirtualStylus {
    /// Puts the ELF file at `image` into the flash and the power on; nothing has run yet.
    ///
    /// # Errors
    /// The image cannot be read or does not fit the flash.
    pub fn new(image: &Path, options: Options) -> Result<Self> {
        let (contents, handler) = load(image, options.flash, options.keep_flash)?;
        let handler = handler.filter(|_| options.watch_ticks);
        let unreadable = Unreadable::default();
        unreadable.replace(contents.unreadable);
        let auditor = Auditor::default();
        let ticks = TickWatch::new(handler, auditor.clone());
        let board = StylusBoard::new(
            options.pins,
            options.instructions_per_second,
            unreadable.clone(),
            auditor,
        )?;
        let (commands, receiver) = channel();
        let (sender, stops) = channel();
        let hands = Hands {
            commands: receiver,
            stops: sender,
            ticks,
            power_cut: options.power_cut,
            cut: None,
            to_capture: Vec::new(),
            captured: Vec::new(),
            unreadable,
            resets: 0,
        };
        let bytes = contents.bytes;
        let thread = std::thread::spawn(move || emulate(board, bytes, hands));
        let mut stylus = Self {
            commands: Some(commands),
            stops,
            thread: Some(thread),
            now_ns: 0,
            cut: None,
        };
        stylus.wait()?;
        Ok(stylus)
    }

    /// The instant reached, in nanoseconds of virtual time.
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Runs until `at_ns`.
    ///
    /// # Errors
    /// The power was cut, or the emulator stopped by itself.
    pub fn run_until(&mut self, at_ns: u64) -> Result<()> {
        if at_ns <= self.now_ns {
            return Ok(());
        }
        self.command(Command::RunUntil(at_ns))?;
        self.wait()
    }

    /// Runs for `nanos`.
    ///
    /// # Errors
    /// As [`VirtualStylus::run_until`].
    pub fn run_for(&mut self, nanos: u64) -> Result<()> {
        self.run_until(self.now_ns.saturating_add(nanos))
    }

    /// Runs until `done`, asked every `step_ns`, is true; whether it was before `until_ns`.
    ///
    /// # Errors
    /// As [`VirtualStylus::run_until`].
    pub fn run_until_true(
        &mut self,
        until_ns: u64,
        step_ns: u64,
        mut done: impl FnMut(&mut Self) -> Result<bool>,
    ) -> Result<bool> {
        loop {
            if done(self)? {
                return Ok(true);
            }
            if self.now_ns >= until_ns {
                return Ok(false);
            }
            self.run_until((self.now_ns + step_ns).min(until_ns))?;
        }
    }

    /// Runs `job` with the board in hand, while the run stands.
    ///
    /// # Errors
    /// The run is over.
    pub fn board<T: Send + 'static>(
        &mut self,
        job: impl FnOnce(&mut StylusBoard) -> T + Send + 'static,
    ) -> Result<T> {
        self.ask(|session, _, _| job(session.board_mut()))
    }

    /// What channel 1 of the converter gave its pin since this was asked last, or since the power came on.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_dac_record(&mut self) -> Result<Vec<Output>> {
        self.board(|board| board.part.dac.take_record())
    }

    /// Puts `bytes` on the serial line; the image hears them as the run goes on.
    ///
    /// # Errors
    /// The run is over, or a socket is on the line.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        let bytes = bytes.to_vec();
        self.board(move |board| board.line().map(|line| line.put(&bytes)))?
            .ok_or_else(|| Error::Emulator("a socket is on the serial line".to_owned()))
    }

    /// What the image sent on the serial line since this was asked last.
    ///
    /// # Errors
    /// The run is over, or a socket is on the line.
    pub fn receive(&mut self) -> Result<Vec<Sent>> {
        self.board(|board| board.line().map(crate::serial::Line::take))?
            .ok_or_else(|| Error::Emulator("a socket is on the serial line".to_owned()))
    }

    /// Puts a socket on the serial line that listens on `port` of the loopback interface (0 for any): its port.
    ///
    /// # Errors
    /// The run is over, or the port cannot be listened on.
    pub fn listen(&mut self, port: u16) -> Result<u16> {
        self.board(move |board| board.listen(port))?
    }

    /// Has `work` done by the software of the host on USB, which gets the instant too.
    ///
    /// # Errors
    /// The run is over.
    pub fn usb<T: Send + 'static>(
        &mut self,
        work: impl FnOnce(&mut UsbHost, u64) -> T + Send + 'static,
    ) -> Result<T> {
        let now = VirtualNanos(self.now_ns);
        self.board(move |board| board.part.drive_usb(now, work))
    }

    /// Puts others on the converter's pins.
    ///
    /// # Errors
    /// The run is over.
    pub fn set_pins(&mut self, pins: impl Pins + 'static) -> Result<()> {
        self.board(move |board| board.part.adc.around.set_pins(Box::new(pins)))
    }

    /// Moves the tool so from now on; the motion's instants are those of the run.
    ///
    /// # Errors
    /// The run is over.
    pub fn set_motion(&mut self, motion: Motion) -> Result<()> {
        let now_ns = self.now_ns;
        self.board(move |board| board.part.encoder.around.set_motion(motion, now_ns))
    }

    /// Keeps every sample of the converter's injected sequence from now on.
    ///
    /// # Errors
    /// The run is over.
    pub fn record_samples(&mut self) -> Result<()> {
        self.board(|board| board.part.adc.around.record_samples())
    }

    /// The samples kept since this was asked last.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_samples(&mut self) -> Result<Vec<Sample>> {
        self.board(|board| board.part.adc.around.take_samples())
    }

    /// The ticks since this was asked last.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_ticks(&mut self) -> Result<Vec<Tick>> {
        self.ask(|_, hands, _| hands.ticks.take_ticks())
    }

    /// Audits every `every`th tick instruction by instruction from now on.
    ///
    /// # Errors
    /// The run is over.
    pub fn audit_ticks(&mut self, every: u64) -> Result<()> {
        self.ask(move |_, hands, _| hands.ticks.audit_every(Some(every)))
    }

    /// The audits since this was asked last.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_audits(&mut self) -> Result<Vec<Audit>> {
        self.ask(|_, hands, _| hands.ticks.take_audits())
    }

    /// Ticks whose return was not seen, so that they are in no figure.
    ///
    /// # Errors
    /// The run is over.
    pub fn unfollowed_ticks(&mut self) -> Result<u64> {
        self.ask(|_, hands, _| hands.ticks.unfollowed())
    }

    /// The flash operations of this run so far.
    ///
    /// # Errors
    /// The run is over.
    pub fn flash_operations(&mut self) -> Result<Vec<Operation>> {
        self.board(|board| board.part.flash.around.log().to_vec())
    }

    /// Cuts the power at the flash operation `number` of this run, counted from 1, at `moment` of it.
    ///
    /// # Errors
    /// The run is over.
    pub fn cut_power_at(&mut self, number: u64, moment: Moment) -> Result<()> {
        self.ask(move |_, hands, _| hands.power_cut = Some((number, moment)))
    }

    /// Keeps what the flash would hold if the power were cut at each of these operations (counted from 1) and moments,
    /// while the run goes on; what was asked for before is dropped.
    ///
    /// # Errors
    /// The run is over.
    pub fn capture_power_cuts(&mut self, cuts: Vec<(u64, Moment)>) -> Result<()> {
        self.ask(move |_, hands, _| hands.to_capture = cuts)
    }

    /// The power cuts captured since this was asked last, in the order of their operations.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_power_cuts(&mut self) -> Result<Vec<PowerCut>> {
        self.ask(|_, hands, _| std::mem::take(&mut hands.captured))
    }

    /// Reads that met a word which cannot be read.
    ///
    /// # Errors
    /// The run is over.
    pub fn failed_reads(&mut self) -> Result<u64> {
        self.ask(|_, hands, _| hands.unreadable.failures())
    }

    /// The resets of the part, the first power-on left out.
    ///
    /// # Errors
    /// The run is over.
    pub fn resets(&mut self) -> Result<Vec<Reset>> {
        self.ask(|session, _, _| {
            let resets = session.resets().iter();
            resets
                .map(|reset| Reset {
                    at_ns: reset.at.0,
                    cause: match reset.cause {
                        rigless::device::ResetCause::Core => ResetCause::Software,
                        rigless::device::ResetCause::Model("IWDG") => ResetCause::Watchdog,
                        _ => ResetCause::Other,
                    },
                })
                .collect()
        })
    }

    /// Resets the part by its pin.
    ///
    /// # Errors
    /// The run is over.
    pub fn reset_by_pin(&mut self) -> Result<()> {
        let at = VirtualNanos(self.now_ns);
        self.ask(move |session, _, host| session.reset_by_pin(at, 0, host))
    }

    /// A word of 32 bits in memory, or `None` where there is no memory.
    ///
    /// # Errors
    /// The run is over.
    pub fn read_word(&mut self, address: u64) -> Result<Option<u32>> {
        self.ask(move |_, _, host| host.read(address, Width::W32).ok().map(|word| word as u32))
    }

    /// The register of `instance` at `offset`, as a debugger sees it.
    ///
    /// # Errors
    /// The run is over.
    pub fn read_register(&mut self, instance: &'static str, offset: u64) -> Result<Option<u32>> {
        let now = VirtualNanos(self.now_ns);
        self.ask(move |session, _, _| {
            let mcu = session.mcu();
            let base = mcu.bus().peripheral(instance)?.base;
            mcu.peek(now, base + offset, Width::W32)
                .ok()
                .map(|value| value as u32)
        })
    }

    /// What the flash holds now.
    ///
    /// # Errors
    /// The run is over.
    pub fn flash(&mut self) -> Result<Contents> {
        self.ask(|_, hands, host| hands.contents(host))
    }

    /// What a power cut left in the flash, once it came, and the operation it cut.
    pub fn after_power_cut(&self) -> Option<(&Operation, &Contents)> {
        self.cut
            .as_ref()
            .map(|(operation, contents)| (operation, &**contents))
    }

    /// What the run met and no model answers.
    ///
    /// # Errors
    /// The run is over.
    pub fn report(&mut self) -> Result<Report> {
        self.ask(|session, _, _| report(session))
    }

    fn ask<T: Send + 'static>(
        &mut self,
        job: impl FnOnce(&mut Session<StylusBoard>, &mut Hands, &mut dyn Host) -> T + Send + 'static,
    ) -> Result<T> {
        let (sender, answer) = channel();
        self.command(Command::Do(Box::new(move |session, hands, host| {
            let _ = sender.send(job(session, hands, host));
        })))?;
        answer.recv().map_err(|_| self.over())
    }

    fn command(&mut self, command: Command) -> Result<()> {
        let sent = self
            .commands
            .as_ref()
            .is_some_and(|commands| commands.send(command).is_ok());
        if sent && self.cut.is_none() {
            Ok(())
        } else {
            Err(self.over())
        }
    }

    fn wait(&mut self) -> Result<()> {
        match self.stops.recv() {
            Ok(Stopped::At(at_ns)) => {
                self.now_ns = at_ns;
                Ok(())
            }
            Ok(Stopped::PowerCut {
                operation,
                contents,
            }) => {
                self.now_ns = operation.at_ns;
                self.cut = Some((operation, contents));
                Err(self.over())
            }
            Err(_) => Err(self.over()),
        }
    }

    /// Why the run is over.
    fn over(&mut self) -> Error {
        if let Some((operation, _)) = &self.cut {
            return Error::PowerCut {
                at_ns: operation.at_ns,
                operation: operation.number,
            };
        }
        self.commands = None;
        let ended = self.thread.take().map(JoinHandle::join);
        match ended {
            Some(Ok(Err(error))) => error,
            Some(Err(_)) => Error::Emulator("its thread panicked".to_owned()),
            _ => Error::Emulator("it has ended already".to_owned()),
        }
    }
}

impl Drop for VirtualStylus {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            // A panic there has told about itself.
            let _ = thread.join();
        }
    }
}

/// The flash with the image in it, and where the tick's handler is.
fn load(path: &Path, mut contents: Contents, keep: bool) -> Result<(Contents, Option<u64>)> {
    let told = |reason: String| Error::Image {
        path: path.to_owned(),
        reason,
    };
    let image = Image::read(path, None).map_err(|error| told(error.to_string()))?;
    if !keep {
        for (address, bytes) in image.segments() {
            contents.place(address, bytes).map_err(told)?;
        }
    }
    let symbols = Symbols::read(image.bytes(), |value| value & !1)
        .map_err(|error| told(error.to_string()))?;
    Ok((contents, symbols.get(TICK_HANDLER).ok()))
}

fn emulate(board: StylusBoard, flash: Vec<u8>, hands: Hands) -> Result<()> {
    let told = |error: emulator::Error| Error::Emulator(error.to_string());
    let flash = Image::new(&PathBuf::from("flash"), flash, Some(u64::from(BASE)))
        .map_err(|error| Error::Emulator(error.to_string()))?;
    let watch = hands.ticks.watches();
    let mut session = Session::new(Box::new(board), 0, VirtualNanos(0)).map_err(told)?;
    if let Some(watch) = watch {
        session.watch(watch);
    }
    emulator::run(session, &Start::new(&[flash]), hands).map_err(told)?;
    Ok(())
}

fn report(session: &mut Session<StylusBoard>) -> Report {
    let without_model = session.unimplemented().iter().map(|(address, met)| {
        format!(
            "{}.{} ({address:#010x}): {} reads, {} writes, last {:#x}, first from {:#010x}",
            met.instance,
            met.register,
            met.reads,
            met.writes,
            met.written.unwrap_or_default(),
            met.program_counter
        )
    });
    let undefined = session.undefined().iter().map(|(address, met)| {
        format!(
            "{} ({address:#010x}), no register: {} reads, {} writes, first from {:#010x}",
            met.instance, met.reads, met.writes, met.program_counter
        )
    });
    let mut report = Report {
        without_model: without_model.chain(undefined).collect(),
        unmapped: session.unmapped().iter().map(ToString::to_string).collect(),
        refused: (session.refused().iter())
            .map(|(address, fault)| format!("{address:#010x}: {fault}"))
            .collect(),
        told: session
            .told()
            .map(|told| format!("{}.{}: {}", told.instance, told.register, told.reason))
            .collect(),
        unrouted: session
            .unrouted()
            .iter()
            .map(|(instance, line)| format!("{instance}: {line}"))
            .collect(),
    };
    report.told.sort();
    report
}
