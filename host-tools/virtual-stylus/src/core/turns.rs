//! Several processors that take turns as one, so that translated code is kept while the MPU changes.
//!
//! The emulator drops its translations at each change of the MPU, and the image changes the MPU before and after each
//! operation on the bank with the code. So before a change, the processor that executes hands its state over to a
//! processor that has translated little, and takes the state back afterwards. Accesses to the bank's registers show
//! when.

use std::ops::{Deref, DerefMut};

use rigless::emulator::{Access, AccessKind, Checked, CoreBus, Error, Exit, InterruptLine, Processor, Queued};
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::FLASH_STATUS;

/// The register CTRL of the MPU, and the bit ENABLE of CTRL and of RASR (ARM DDI 0403E, B3.5.5 and B3.5.9).
pub(super) const MPU_CTRL: u64 = 0xE000_ED94;
pub(super) const MPU_ENABLE: u64 = 1;
/// The keys and the control of the bank with the code: FLASH_KEYR1, and FLASH_CR1 with its bit LOCK1 (sections 4.9.2
/// and 4.9.4).
const KEYS: u64 = 0x5200_2004;
const CONTROL: u64 = 0x5200_200C;
const LOCK: u64 = 1;
/// Bits of FLASH_SR1 that are set while the bank is not idle: BSY1, WBNE1 and QW1 (section 4.9.5).
const NOT_IDLE: u64 = 0b111;

/// The processor that executes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// At all other times.
    Usual,
    /// From the unlocking of the bank with the code to its locking, while the MPU changes.
    Change,
    /// Within [`Turn::Change`], from the first order to the bank until the image sees the bank idle, while the MPU
    /// hides the code.
    Hidden,
}

impl Turn {
    /// Returns the turn after an access that read or wrote `value`.
    fn after(self, access: &Access, value: u64) -> Self {
        let is_write = access.kind == AccessKind::Write;
        match access.address {
            KEYS if is_write => Self::Change,
            CONTROL if is_write && value & LOCK != 0 => Self::Usual,
            CONTROL if is_write && self == Self::Change => Self::Hidden,
            status if status == FLASH_STATUS[0] && self == Self::Hidden => {
                if value & NOT_IDLE == 0 {
                    Self::Change
                } else {
                    self
                }
            }
            _ => self,
        }
    }
}

/// Returns true for requests about memory, which every processor must receive.
fn is_of_memory(queued: Queued) -> bool {
    matches!(queued, Queued::Invalidate(..) | Queued::Route(_) | Queued::Unroute(_))
}

/// One processor per [`Turn`], in its order. Only one of them holds the machine's state at a time: the one that this
/// dereferences to. The methods here are those of [`Processor`] that concern more than one.
#[derive(Debug)]
pub(super) struct Turns {
    processors: [Box<dyn Processor>; 3],
    turn: Turn,
}

impl Turns {
    /// Creates the processors with `make`.
    pub(super) fn new(make: impl Fn() -> Result<Box<dyn Processor>, Error>) -> Result<Self, Error> {
        Ok(Self {
            processors: [make()?, make()?, make()?],
            turn: Turn::Usual,
        })
    }

    /// Returns true if the MPU is on.
    pub(super) fn is_protected(&mut self) -> bool {
        let now = VirtualNanos(0);
        let control = self.debugger_access(None, MPU_CTRL, Width::W32, now);
        control.is_some_and(|control| control & MPU_ENABLE != 0)
    }

    /// Hands the state over to another processor, unless the MPU is off. While it is off, ITCM can be written, and each
    /// processor may hold translations of ITCM's code.
    fn hand_over(&mut self, next: Turn) {
        if next == self.turn || !self.is_protected() {
            return;
        }
        let state = self.save();
        // Without the hand-over the run only becomes slower.
        if self.processors[next as usize].load(&state).is_ok() {
            self.turn = next;
        }
    }

    fn ask_others(&mut self, queued: Queued) {
        let active = self.turn as usize;
        for (place, processor) in self.processors.iter_mut().enumerate() {
            if place != active {
                processor.ask(queued);
            }
        }
    }

    pub(super) fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let turn = self.turn;
        let mut followed = FollowedBus {
            bus,
            turn,
            next: turn,
            asked: Vec::new(),
        };
        let ran = self.processors[turn as usize].run(budget, &mut followed);
        let FollowedBus { next, asked, .. } = followed;
        // The processor that ran has taken these itself; the others must know the same memory when their turn comes.
        for queued in asked {
            self.ask_others(queued);
        }
        self.hand_over(next);
        ran
    }

    pub(super) fn ask(&mut self, queued: Queued) {
        if is_of_memory(queued) {
            self.ask_others(queued);
        }
        (**self).ask(queued);
    }

    #[expect(
        unsafe_code,
        reason = "the emulator's trait hands memory over by pointer; here it is only passed on"
    )]
    pub(super) unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        for processor in &mut self.processors {
            // SAFETY: the caller gives this method the promises that each processor's method requires. All processors
            // are dropped together with this one, so every promise that lasts until the drop lasts long enough. Only
            // one runs at a time.
            unsafe { processor.map(start, length, host, writable) }
        }
    }

    pub(super) fn reset(&mut self) {
        // The saved state includes everything that a reset keeps.
        let state = self.save();
        for processor in &mut self.processors {
            processor.load(&state).expect("a state of this machine");
            processor.reset();
        }
        self.turn = Turn::Usual;
    }

    pub(super) fn add_breakpoint(&mut self, address: u64) -> bool {
        let mut processors = self.processors.iter_mut();
        processors.all(|processor| processor.add_breakpoint(address))
    }

    pub(super) fn remove_breakpoint(&mut self, address: u64) {
        for processor in &mut self.processors {
            processor.remove_breakpoint(address);
        }
    }

    pub(super) fn check_reads(&mut self, every: bool) {
        for processor in &mut self.processors {
            processor.check_reads(every);
        }
    }

    pub(super) fn check_words(&mut self, words: &[u64]) {
        for processor in &mut self.processors {
            processor.check_words(words);
        }
    }
}

impl Deref for Turns {
    type Target = dyn Processor;

    fn deref(&self) -> &Self::Target {
        &*self.processors[self.turn as usize]
    }
}

impl DerefMut for Turns {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut *self.processors[self.turn as usize]
    }
}

/// The bus. It follows the turn after each access, and collects the requests about memory.
struct FollowedBus<'a> {
    bus: &'a mut dyn CoreBus,
    turn: Turn,
    next: Turn,
    asked: Vec<Queued>,
}

impl CoreBus for FollowedBus<'_> {
    fn access(&mut self, access: Access, from_code: bool) -> Option<u64> {
        let value = self.bus.access(access, from_code)?;
        let is_write = access.kind == AccessKind::Write;
        let value_seen = if is_write { access.value } else { value };
        self.next = self.next.after(&access, value_seen);
        Some(value)
    }

    fn time(&self, instructions: u64) -> VirtualNanos {
        self.bus.time(instructions)
    }

    fn queued(&mut self) -> Vec<Queued> {
        let queued = self.bus.queued();
        let of_memory = queued.iter().filter(|queued| is_of_memory(**queued));
        self.asked.extend(of_memory);
        queued
    }

    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        // A change of turn ends the stretch, because the state can be handed over only between two stretches.
        if self.next == self.turn {
            self.bus.carry_on(instructions, event)
        } else {
            None
        }
    }

    fn acknowledge(&mut self, line: InterruptLine, instructions: u64) -> Option<u64> {
        self.bus.acknowledge(line, instructions)
    }

    fn read_checked(&mut self, access: Access, report: bool) -> Option<Checked> {
        self.bus.read_checked(access, report)
    }

    fn write_checked(&mut self, access: Access) -> Option<bool> {
        self.bus.write_checked(access)
    }

    fn stops_before(&mut self, access: &Access) -> bool {
        self.bus.stops_before(access)
    }

    fn send_trace(&mut self, bytes: &[u8]) {
        self.bus.send_trace(bytes);
    }
}
