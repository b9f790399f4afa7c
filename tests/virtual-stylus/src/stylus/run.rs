//! The test's handle of a run.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use rigless::emulator::Host;
use rigless::mcu::Operate;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::emulation::{Command, Hands, PowerCut, Stopped, start};
use super::options::Options;
use super::report::{Reset, RunReport, report, resets};
use crate::board::StylusBoard;
use crate::core::Audit;
use crate::error::{Error, Result};
use crate::model::adc::{Pins, Sample};
use crate::model::dac::Output;
use crate::model::flash::{Contents, Moment, Operation, Stalls};
use crate::model::pin::Driven;
use crate::model::usb::host::Host as UsbHost;
use crate::motion::Motion;
use crate::serial::Sent;
use crate::tick::Tick;

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
    /// Puts the ELF file at `image` into the flash and switches the power on; nothing has run yet.
    ///
    /// # Errors
    /// The image cannot be read or does not fit the flash.
    pub fn new(image: &Path, options: Options) -> Result<Self> {
        let (commands, stops, thread) = start(image, options)?;
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

    /// Runs until `done` is true, which is evaluated every `step_ns`; false if it is not by `until_ns`.
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

    /// Runs `job` on the board between two stretches of the run.
    ///
    /// # Errors
    /// The run is over.
    pub fn board<T: Send + 'static>(
        &mut self,
        job: impl FnOnce(&mut StylusBoard) -> T + Send + 'static,
    ) -> Result<T> {
        self.ask(|session, _, _| job(session.board_mut()))
    }

    /// Takes the outputs of the converter's channel 1 since the last call, or since power-on.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_dac_record(&mut self) -> Result<Vec<Output>> {
        self.board(|board| board.part.dac.take_record())
    }

    /// Takes the changes of the amplifier's enable since the last call, or since power-on. At power-on it floats.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_amplifier_record(&mut self) -> Result<Vec<Driven>> {
        self.board(|board| board.part.amplifier.around.take_record())
    }

    /// Puts `bytes` on the serial line; the image receives them as the run goes on.
    ///
    /// # Errors
    /// The run is over, or something else is on the line.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        let bytes = bytes.to_vec();
        self.board(move |board| board.line().map(|line| line.put(&bytes)))?
            .ok_or_else(other_end)
    }

    /// Takes the bytes that the image has sent on the serial line since the last call.
    ///
    /// # Errors
    /// The run is over, or something else is on the line.
    pub fn receive(&mut self) -> Result<Vec<Sent>> {
        self.board(|board| board.line().map(crate::serial::Line::take))?
            .ok_or_else(other_end)
    }

    /// Bytes on the serial line that the image's receiver has not begun to take.
    ///
    /// # Errors
    /// The run is over, or something else is on the line.
    pub fn waiting(&mut self) -> Result<usize> {
        self.board(|board| board.line().map(|line| line.waiting()))?
            .ok_or_else(other_end)
    }

    /// Has the software of the host on USB do `work`, which is also given the instant.
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

    /// Changes the signals on the converter's pins.
    ///
    /// # Errors
    /// The run is over.
    pub fn set_pins(&mut self, pins: impl Pins + 'static) -> Result<()> {
        self.board(move |board| board.part.adc.around.set_pins(Box::new(pins)))
    }

    /// Moves the tool along `motion` from now on; the motion's instants are those of the run.
    ///
    /// # Errors
    /// The run is over.
    pub fn set_motion(&mut self, motion: Motion) -> Result<()> {
        let now_ns = self.now_ns;
        self.board(move |board| board.part.encoder.around.set_motion(motion, now_ns))
    }

    /// Disturbs both tracks of the encoder at each of `instants` by pulses of `width_ns`, see `Quadrature::disturb`.
    ///
    /// # Errors
    /// The run is over.
    pub fn disturb_encoder(&mut self, instants: Vec<u64>, width_ns: u64) -> Result<()> {
        self.board(move |board| board.part.encoder.around.disturb(instants, width_ns))
    }

    /// Keeps every sample of the converter's injected sequence from now on.
    ///
    /// # Errors
    /// The run is over.
    pub fn record_samples(&mut self) -> Result<()> {
        self.board(|board| board.part.adc.around.record_samples())
    }

    /// Takes the samples kept since the last call.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_samples(&mut self) -> Result<Vec<Sample>> {
        self.board(|board| board.part.adc.around.take_samples())
    }

    /// Takes the ticks since the last call.
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

    /// Takes the audits since the last call.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_audits(&mut self) -> Result<Vec<Audit>> {
        self.ask(|_, hands, _| hands.ticks.take_audits())
    }

    /// Number of ticks whose return was not seen, which are in no figure.
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

    /// Keeps the content that the flash would have if the power were cut at each of these operations (counted from 1)
    /// and moments, while the run goes on. Replaces the cuts of the call before.
    ///
    /// # Errors
    /// The run is over.
    pub fn capture_power_cuts(&mut self, cuts: Vec<(u64, Moment)>) -> Result<()> {
        self.ask(move |_, hands, _| hands.to_capture = cuts)
    }

    /// Takes the power cuts captured since the last call, in the order of their operations.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_power_cuts(&mut self) -> Result<Vec<PowerCut>> {
        self.ask(|_, hands, _| std::mem::take(&mut hands.captured))
    }

    /// Number of reads of an unreadable word.
    ///
    /// # Errors
    /// The run is over.
    pub fn failed_reads(&mut self) -> Result<u64> {
        self.ask(|_, hands, _| hands.unreadable.failures())
    }

    /// Accesses that waited for a busy bank of the flash.
    ///
    /// # Errors
    /// The run is over.
    pub fn flash_stalls(&mut self) -> Result<Stalls> {
        self.ask(|_, hands, _| hands.busy.stalls())
    }

    /// The resets of the part, the first power-on left out.
    ///
    /// # Errors
    /// The run is over.
    pub fn resets(&mut self) -> Result<Vec<Reset>> {
        self.ask(|session, _, _| resets(session))
    }

    /// Stops the external clock.
    ///
    /// # Errors
    /// The run is over.
    pub fn fail_external_clock(&mut self) -> Result<()> {
        let now = VirtualNanos(self.now_ns);
        self.board(move |board| board.part.fail_external_clock(now))
    }

    /// Sets the supply, in millivolts.
    ///
    /// # Errors
    /// The run is over.
    pub fn set_supply(&mut self, millivolts: u32) -> Result<()> {
        self.board(move |board| board.part.rest.set_supply(millivolts))
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

    /// The present content of the flash.
    ///
    /// # Errors
    /// The run is over.
    pub fn flash(&mut self) -> Result<Contents> {
        self.ask(|_, hands, host| hands.contents(host))
    }

    /// The operation that the power cut interrupted and the content of the flash after it, once the power was cut.
    pub fn after_power_cut(&self) -> Option<(&Operation, &Contents)> {
        self.cut
            .as_ref()
            .map(|(operation, contents)| (operation, &**contents))
    }

    /// The accesses of the run that no model answered.
    ///
    /// # Errors
    /// The run is over.
    pub fn report(&mut self) -> Result<RunReport> {
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

    /// The reason for which the run is over.
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

/// The error of a line with another far end than this process.
fn other_end() -> Error {
    Error::Emulator("something else is on the serial line".to_owned())
}

impl Drop for VirtualStylus {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has printed its own message.
            let _ = thread.join();
        }
    }
}
