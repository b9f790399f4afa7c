//! A run of an image, which a test stops and inspects.
//!
//! The emulator runs on a thread of its own from one given instant to the next. Between two instants it waits, and runs
//! closures with access to the board and its memory. If the emulator stops by itself, the next call that needs it
//! panics with the reason.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use rigless::emulator::Host;
use rigless::mcu::Operate;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use crate::Result;
use crate::board::{Line, Sent, StylusBoard, noise};
use crate::core::Audit;
use crate::emulation::{Command, Hands, Options, PowerCut, start};
use crate::model::adc::{Pins, Sample};
use crate::model::dac::Output;
use crate::model::flash::{Contents, Moment, Operation, Stalls};
use crate::model::pins::Driven;
use crate::model::usb::host::Host as UsbHost;
use crate::motion::Motion;
use crate::tick::Tick;

/// A run of an image.
#[derive(Debug)]
pub struct VirtualStylus {
    commands: Option<Sender<Command>>,
    stops: Receiver<u64>,
    thread: Option<JoinHandle<Result<()>>>,
    now_ns: u64,
}

impl VirtualStylus {
    /// Puts the ELF file at `image` into the flash and switches the power on, without running anything yet.
    pub fn new(image: &Path, options: Options) -> Result<Self> {
        let ram_noise = options.ram_noise;
        let (commands, stops, thread) = start(image, options)?;
        let mut stylus = Self {
            commands: Some(commands),
            stops,
            thread: Some(thread),
            now_ns: 0,
        };
        stylus.wait();
        if let Some(seed) = ram_noise {
            stylus.ask(move |_, _, host| {
                for (address, bits) in noise(seed) {
                    host.write(address, Width::W64, bits).expect("it is RAM");
                }
            });
        }
        Ok(stylus)
    }

    /// The instant that the run has reached, in nanoseconds of virtual time.
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Runs until `at_ns`.
    pub fn run_until(&mut self, at_ns: u64) {
        if at_ns > self.now_ns {
            self.command(Command::RunUntil(at_ns));
            self.wait();
        }
    }

    /// Runs for `nanos`.
    pub fn run_for(&mut self, nanos: u64) {
        self.run_until(self.now_ns.saturating_add(nanos));
    }

    /// Runs until `done` returns true; `done` is called every `step_ns`. Returns false if that has not happened by
    /// `until_ns`.
    pub fn run_until_true(&mut self, until_ns: u64, step_ns: u64, mut done: impl FnMut(&mut Self) -> bool) -> bool {
        loop {
            if done(self) {
                return true;
            }
            if self.now_ns >= until_ns {
                return false;
            }
            self.run_until((self.now_ns + step_ns).min(until_ns));
        }
    }

    /// Runs `job` on the board between two stretches of the run.
    pub fn board<T: Send + 'static>(&mut self, job: impl FnOnce(&mut StylusBoard) -> T + Send + 'static) -> T {
        self.ask(|session, _, _| job(session.board_mut()))
    }

    /// Returns the outputs of the digital-to-analogue converter's channel 1 since the last call, or since power-on.
    pub fn take_dac_record(&mut self) -> Vec<Output> {
        self.board(|board| board.part.dac.take_record())
    }

    /// Returns the changes of the amplifier's enable pin since the last call, or since power-on, when it floats.
    pub fn take_amplifier_record(&mut self) -> Vec<Driven> {
        self.board(|board| board.part.amplifier.around.take_record())
    }

    /// Puts `bytes` on the serial line. The image receives them once the run continues.
    pub fn send(&mut self, bytes: &[u8]) {
        let bytes = bytes.to_vec();
        self.board(move |board| board.line().put(&bytes));
    }

    /// Returns the bytes that the image has sent on the serial line since the last call.
    pub fn receive(&mut self) -> Vec<Sent> {
        self.board(|board| Line::take(board.line()))
    }

    /// Number of bytes on the serial line that the image's receiver has not begun to receive.
    pub fn waiting(&mut self) -> usize {
        self.board(|board| board.line().waiting())
    }

    /// Makes the software of the host on USB do `work`, which also receives the present instant.
    pub fn usb<T: Send + 'static>(&mut self, work: impl FnOnce(&mut UsbHost, u64) -> T + Send + 'static) -> T {
        let now = VirtualNanos(self.now_ns);
        self.board(move |board| board.part.drive_usb(now, work))
    }

    /// Changes the signals on the converter's pins.
    pub fn set_pins(&mut self, pins: impl Pins + 'static) {
        self.board(move |board| board.part.adc.around.set_pins(Box::new(pins)));
    }

    /// Moves the tool along `motion` from now on; the motion's instants are those of the run.
    pub fn set_motion(&mut self, motion: Motion) {
        let now_ns = self.now_ns;
        self.board(move |board| board.part.encoder.around.set_motion(motion, now_ns));
    }

    /// Disturbs both tracks of the encoder at each of `instants` with pulses of `width_ns`, see `Quadrature::disturb`.
    pub fn disturb_encoder(&mut self, instants: Vec<u64>, width_ns: u64) {
        self.board(move |board| board.part.encoder.around.disturb(instants, width_ns));
    }

    /// Keeps every sample of the converter's injected sequence from now on.
    pub fn record_samples(&mut self) {
        self.board(|board| board.part.adc.around.record_samples());
    }

    /// Returns the samples of the injected sequence that were kept since the last call.
    pub fn take_samples(&mut self) -> Vec<Sample> {
        self.board(|board| board.part.adc.around.take_samples())
    }

    /// Returns the ticks since the last call.
    pub fn take_ticks(&mut self) -> Vec<Tick> {
        self.ask(|_, hands, _| hands.ticks.take_ticks())
    }

    /// Audits every `every`th tick instruction by instruction from now on.
    pub fn audit_ticks(&mut self, every: u64) {
        self.ask(move |_, hands, _| hands.ticks.audit_every(every));
    }

    /// Returns the audits of ticks since the last call.
    pub fn take_audits(&mut self) -> Vec<Audit> {
        self.ask(|_, hands, _| hands.ticks.take_audits())
    }

    /// Number of ticks whose return was not seen. They are missing from [`VirtualStylus::take_ticks`].
    pub fn unfollowed_ticks(&mut self) -> u64 {
        self.ask(|_, hands, _| hands.ticks.unfollowed())
    }

    /// The flash operations of this run so far.
    pub fn flash_operations(&mut self) -> Vec<Operation> {
        self.board(|board| board.part.flash.around.log().to_vec())
    }

    /// Keeps, for each of these operations (counted from 1) and moments, the content that the flash would have if the
    /// power were cut there. The run continues. The cuts replace those of an earlier call.
    pub fn capture_power_cuts(&mut self, cuts: Vec<(u64, Moment)>) {
        self.ask(move |_, hands, _| hands.to_capture = cuts);
    }

    /// Returns the power cuts captured since the last call, in the order of their operations.
    pub fn take_power_cuts(&mut self) -> Vec<PowerCut> {
        self.ask(|_, hands, _| std::mem::take(&mut hands.captured))
    }

    /// Number of reads of an unreadable word.
    pub fn failed_reads(&mut self) -> u64 {
        self.ask(|_, hands, _| hands.unreadable.failures())
    }

    /// Addresses of the words of RAM that were read, or written in part, before they were written after power-on; none
    /// without [`Options::ram_noise`].
    pub fn unwritten_ram(&mut self) -> Vec<u64> {
        self.board(|board| board.ram.errors())
    }

    /// Addresses of the stores to RAM that came before the image had read that the supply is valid.
    pub fn refused_stores(&mut self) -> Vec<u64> {
        self.board(|board| board.ram.refused())
    }

    /// Numbers of accesses that waited for a busy bank of the flash.
    pub fn flash_stalls(&mut self) -> Stalls {
        self.ask(|_, hands, _| hands.busy.stalls())
    }

    /// All resets of the part after the first power-on.
    pub fn resets(&mut self) -> Vec<Reset> {
        self.ask(|session, _, _| resets(session))
    }

    /// Stops the external clock.
    pub fn fail_external_clock(&mut self) {
        let now = VirtualNanos(self.now_ns);
        self.board(move |board| board.part.fail_external_clock(now));
    }

    /// Sets the supply, in millivolts.
    pub fn set_supply(&mut self, millivolts: u32) {
        self.board(move |board| board.part.set_supply(millivolts));
    }

    /// Presses or releases the button.
    pub fn press_button(&mut self, pressed: bool) {
        let now = VirtualNanos(self.now_ns);
        self.board(move |board| board.part.press_button(now, pressed));
    }

    /// Resets the part by its pin.
    pub fn reset_by_pin(&mut self) {
        let at = VirtualNanos(self.now_ns);
        self.ask(move |session, _, host| session.reset_by_pin(at, 0, host));
    }

    /// Reads a word of 32 bits from memory, or `None` if the address has no memory.
    pub fn read_word(&mut self, address: u64) -> Option<u32> {
        self.ask(move |_, _, host| host.read(address, Width::W32).ok().map(|word| word as u32))
    }

    /// Reads the register of `instance` at `offset`, as a debugger does.
    pub fn read_register(&mut self, instance: &'static str, offset: u64) -> Option<u32> {
        let now = VirtualNanos(self.now_ns);
        self.ask(move |session, _, _| {
            let mcu = session.mcu();
            let base = mcu.bus().peripheral(instance)?.base;
            mcu.peek(now, base + offset, Width::W32).ok().map(|value| value as u32)
        })
    }

    /// The present content of the flash.
    pub fn flash(&mut self) -> Contents {
        self.ask(|_, hands, host| hands.contents(host))
    }

    /// The accesses, requests and interrupts of the run so far that no model served.
    pub fn report(&mut self) -> RunReport {
        self.ask(|session, _, _| report(session))
    }

    fn ask<T: Send + 'static>(
        &mut self,
        job: impl FnOnce(&mut Session<StylusBoard>, &mut Hands, &mut dyn Host) -> T + Send + 'static,
    ) -> T {
        let (sender, answer) = channel();
        self.command(Command::Do(Box::new(move |session, hands, host| {
            // Whoever asks waits for the answer below, so this fails only if they have panicked.
            let _ = sender.send(job(session, hands, host));
        })));
        answer.recv().unwrap_or_else(|_| self.over())
    }

    fn command(&mut self, command: Command) {
        let sent = (self.commands.as_ref()).is_some_and(|commands| commands.send(command).is_ok());
        if !sent {
            self.over();
        }
    }

    fn wait(&mut self) {
        self.now_ns = self.stops.recv().unwrap_or_else(|_| self.over());
    }

    /// Panics with the reason why the run is over.
    fn over(&mut self) -> ! {
        // Without this the thread would wait for the next command, and the join would not end.
        self.commands = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Err(error))) => panic!("{error}"),
            Some(Err(_)) => panic!("the emulator's thread panicked"),
            _ => panic!("the run is over"),
        }
    }
}

impl Drop for VirtualStylus {
    fn drop(&mut self) {
        // The thread ends when nobody can send commands any more.
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            // If the thread panicked, it has printed its own message.
            let _ = thread.join();
        }
    }
}

/// Cause of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// The image requested the reset.
    Software,
    /// The watchdog's count ended.
    Watchdog,
    /// Anything else.
    Other,
}

/// A reset of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reset {
    /// Instant, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The cause.
    pub cause: ResetCause,
}

/// Accesses, requests and interrupts of a run that no model served.
#[derive(Clone, Debug, Default)]
pub struct RunReport {
    /// Registers without a model, and addresses of an instance at which no register is described, with the numbers of
    /// their reads and writes.
    pub without_model: Vec<String>,
    /// Unmapped addresses, and the addresses of the instructions that accessed them.
    pub unmapped: Vec<String>,
    /// Accesses that the part refuses, for example to an instance whose clock is off.
    pub refused: Vec<String>,
    /// Requests that the models do not carry out.
    pub told: Vec<String>,
    /// Interrupts that are connected to no line of the core.
    pub unrouted: Vec<String>,
}

/// All resets of the part after the first power-on.
fn resets(session: &Session<StylusBoard>) -> Vec<Reset> {
    session
        .resets()
        .iter()
        .map(|reset| Reset {
            at_ns: reset.at.0,
            cause: match reset.cause {
                rigless::device::ResetCause::Core => ResetCause::Software,
                rigless::device::ResetCause::Model("IWDG") => ResetCause::Watchdog,
                _ => ResetCause::Other,
            },
        })
        .collect()
}

/// The accesses, requests and interrupts of the run that no model served.
fn report(session: &mut Session<StylusBoard>) -> RunReport {
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
    let mut report = RunReport {
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
