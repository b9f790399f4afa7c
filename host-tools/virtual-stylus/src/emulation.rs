//! The emulator's thread, which runs the image up to given instants and executes jobs between them.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use rigless::emulator::{self, Driver, Host, Settled, Start, Stop};
use rigless::image::Image;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::symbols::Symbols;
use rigless::time::VirtualNanos;
use stylus_board::{ALL, Board};

use crate::board::StylusBoard;
use crate::core::Auditor;
use crate::electrical::Electrical;
use crate::model::adc::Pins;
use crate::model::flash::{BASE, BYTES, Busy, Contents, Kind, Moment, Operation, Unreadable, WORD_BYTES};
use crate::sensors::ConstantPins;
use crate::tick::TickWatch;
use crate::{Error, Result};

/// The name of the tick's handler in the image.
const TICK_HANDLER: &str = "TIM6_DAC";

/// Options of a run.
#[derive(Debug)]
pub struct Options {
    /// The board.
    pub board: &'static Board,
    /// Content of the flash before the image is put into it.
    pub flash: Contents,
    /// Does not put the image into the flash, and runs the flash's own content, as after a power cut.
    pub keep_flash: bool,
    /// Signals on the converter's pins.
    pub pins: Box<dyn Pins>,
    /// Fills all RAM with noise from this seed before the start. Without a seed, RAM holds zeros.
    pub ram_noise: Option<u64>,
    /// Silicon, clocks and supply.
    pub electrical: Electrical,
    /// Follows the ticks.
    pub watch_ticks: bool,
    /// Notes the registers that the core touches.
    pub note_registers: bool,
}

impl Default for Options {
    /// The first board.
    fn default() -> Self {
        Self::on(&ALL[0])
    }
}

impl Options {
    /// Options on `board`.
    pub fn on(board: &'static Board) -> Self {
        Self {
            board,
            flash: Contents::default(),
            keep_flash: false,
            pins: Box::new(ConstantPins::default()),
            ram_noise: None,
            electrical: Electrical::of(board),
            watch_ticks: true,
            note_registers: false,
        }
    }
}

/// A power cut that was captured, and the content of the flash after it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PowerCut {
    /// The operation that would have been interrupted.
    pub operation: Operation,
    /// Progress of the operation at the cut.
    pub moment: Moment,
    /// The content of the flash after the cut.
    pub contents: Contents,
}

pub(crate) type Job = Box<dyn FnOnce(&mut Session<StylusBoard>, &mut Hands, &mut dyn Host) + Send>;

/// A command to the thread.
pub(crate) enum Command {
    RunUntil(u64),
    Do(Job),
}

/// What the thread owns between two stretches of the run.
pub(crate) struct Hands {
    commands: Receiver<Command>,
    stops: Sender<u64>,
    pub(crate) ticks: TickWatch,
    pub(crate) to_capture: Vec<(u64, Moment)>,
    pub(crate) captured: Vec<PowerCut>,
    pub(crate) unreadable: Unreadable,
    pub(crate) busy: Busy,
    resets: usize,
}

impl Hands {
    /// The content of the flash.
    pub(crate) fn contents(&self, host: &mut dyn Host) -> Contents {
        let mut bytes = Vec::with_capacity(BYTES);
        for address in (u64::from(BASE)..).step_by(8).take(BYTES / 8) {
            let piece = host.read(address, Width::W64).expect("the flash is mapped");
            bytes.extend_from_slice(&piece.to_le_bytes());
        }
        Contents {
            bytes,
            unreadable: self.unreadable.words(),
            filled: self.unreadable.filled(),
        }
    }

    fn started(&mut self, operation: &Operation, host: &mut dyn Host) {
        for moment in self
            .to_capture
            .iter()
            .filter(|(number, _)| *number == operation.number)
            .map(|(_, moment)| *moment)
            .collect::<Vec<_>>()
        {
            let mut contents = self.contents(host);
            contents.cut(&operation.kind, moment);
            self.captured.push(PowerCut {
                operation: operation.clone(),
                moment,
                contents,
            });
        }
        // The operation has just started, so the cells still hold what they held before.
        if let Kind::Program { address, word } = &operation.kind {
            self.unreadable.program(*address, word, erased(*address, host));
        }
    }
}

fn erased(address: u32, host: &mut dyn Host) -> bool {
    (u64::from(address)..)
        .step_by(8)
        .take(WORD_BYTES as usize / 8)
        .all(|piece| host.read(piece, Width::W64).is_ok_and(|bits| bits == u64::MAX))
}

impl Driver<StylusBoard> for Hands {
    fn on_settled(&mut self, session: &mut Session<StylusBoard>, host: &mut dyn Host, settled: Settled) {
        // A reset is seen only here; the tick that it cut short would otherwise be taken for one that has not returned.
        if session.resets().len() != self.resets {
            self.resets = session.resets().len();
            self.ticks.reset();
        }
        let watch = match settled {
            Settled::Hit(hit) => self.ticks.hit(&hit),
            Settled::Stop(_) => self.ticks.audited(),
            Settled::Access { .. } => {
                while let Some(operation) = session.board_mut().part.flash.around.take_started() {
                    self.started(&operation, host);
                }
                None
            }
            _ => None,
        };
        if let Some(watch) = watch {
            session.watch(watch);
        }
    }

    fn on_stop(&mut self, session: &mut Session<StylusBoard>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        self.stops.send(stop.at.0).ok()?;
        loop {
            // If the other end of the channel is gone, the run is over.
            match self.commands.recv().ok()? {
                Command::RunUntil(at_ns) => return Some(VirtualNanos(at_ns)),
                Command::Do(job) => job(session, self, host),
            }
        }
    }
}

/// The ends that the test keeps of the channels of commands and of stops, and the thread.
pub(crate) type Ends = (Sender<Command>, Receiver<u64>, JoinHandle<Result<()>>);

/// Puts the ELF file at `image` into the flash and switches the power on, on a new thread. Returns the channel of its
/// commands, the channel of its stops, and the thread.
pub(crate) fn start(image: &Path, options: Options) -> Result<Ends> {
    let (contents, handler) = load(image, options.flash, options.keep_flash)?;
    let handler = handler.filter(|_| options.watch_ticks);
    let unreadable = Unreadable::default();
    unreadable.replace(contents.unreadable, contents.filled);
    let auditor = Auditor::default();
    let ticks = TickWatch::new(handler, auditor.clone());
    let busy = Busy::default();
    let board = StylusBoard::new(
        options.board,
        options.pins,
        options.electrical,
        unreadable.clone(),
        busy.clone(),
        auditor,
    )?;
    if options.ram_noise.is_some() {
        board.ram.power_on();
    }
    if options.note_registers {
        board.touched.begin();
    }
    let (commands, receiver) = channel();
    let (sender, stops) = channel();
    let hands = Hands {
        commands: receiver,
        stops: sender,
        ticks,
        to_capture: Vec::new(),
        captured: Vec::new(),
        unreadable,
        busy,
        resets: 0,
    };
    let bytes = contents.bytes;
    let thread = std::thread::spawn(move || emulate(board, bytes, hands));
    Ok((commands, stops, thread))
}

/// The flash with the image in it, and the address of the tick's handler.
fn load(path: &Path, mut contents: Contents, keep: bool) -> Result<(Contents, Option<u64>)> {
    let told = |reason: String| Error::Image {
        path: path.to_owned(),
        reason,
    };
    let image = Image::read(path, None).map_err(|error| told(error.to_string()))?;
    if !keep {
        let segments: Vec<_> = image.segments().collect();
        contents.flash(&segments).map_err(told)?;
    }
    // Bit 0 of a function's symbol marks Thumb code and is not part of its address.
    let symbols = Symbols::read(image.bytes(), |value| value & !1).map_err(|error| told(error.to_string()))?;
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
