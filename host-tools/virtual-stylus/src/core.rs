//! The core, with unreadable words and busy banks of flash, and with audits of a tick instruction by instruction.
//!
//! The emulator's core reads flash as plain memory. Here pages with unreadable words are read over the bus. There, a
//! read of an unreadable word is a bus error, as in section 4.7.8, and so a precise bus fault.
//!
//! A bank that is being programmed or erased is read over the bus too. A load from a busy bank does not happen: the
//! core stands still until the bank is idle, and then the instruction begins again. The same holds for an instruction
//! that is to be fetched from a busy bank. No interrupt is taken meanwhile. This is the worst case, because the part
//! may take an interrupt during a fetch. Code that runs elsewhere stands still, too, if the MPU lets the processor
//! fetch ahead from the busy bank with the code. The instructions that the core could have executed meanwhile are
//! counted as executed, so virtual time and the cycle counter continue. Where the MPU hides the busy bank, it refuses
//! fetches from there, so the core continues to run. The MPU and the program counter are checked every [`LOOK`]
//! instructions.
//!
//! A loop that polls the status of a busy bank, or a converter's calibration, stands still from its fourth poll until
//! the next event of the part, and then polls again, because an erasure would cost millions of polls. A loop that has
//! long done nothing but read the cycle counter, or wait for an oscillator with a limit by that counter, is executed
//! once per [`polls::WAIT_INSTRUCTIONS`]. Waits that a clock limits therefore last some microseconds longer. A loop
//! that counted its polls would count fewer.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use rigless::emulator::{
    Access, AccessKind, Checked, CoreBus, CoreSpec, DataModel, Error, Exit, HostCall, InterruptLine, Processor, Queued,
};
use rigless::soc::{Endian, Width};
use rigless::time::VirtualNanos;

use crate::electrical::{Defects, Interrupt};
use crate::model::flash::{BASE, BYTES, Busy, Unreadable};
use crate::model::ram::Ram;
use crate::model::usb;

mod polls;
mod turns;

use polls::Polls;
use turns::{MPU_CTRL, MPU_ENABLE, Turns};

const FLASH: std::ops::Range<u64> = BASE as u64..BASE as u64 + BYTES as u64;
const USB: std::ops::Range<u64> = usb::BASE..usb::BASE + usb::BYTES;
const AXI_SRAM: std::ops::Range<u64> = 0x2400_0000..0x2408_0000;
/// The register AXI_TARG7_FN_MOD, and its bit READ_ISS_OVERRIDE (section 2.2, AXI interconnect registers).
const AXI_SRAM_ISSUING: u64 = 0x5100_8108;
const ONE_READ: u64 = 1;
/// Address of PWR_CSR1 (section 6.8.2).
const POWER_STATUS: u64 = 0x5802_4804;
/// Spacing of the reads that old silicon corrupts here, bytes. On the part it depends on the other reads.
const MISREAD_BYTES: u64 = 64;
/// Registers and bits that make interrupts pending: ICSR.NMIPENDSET, and the bit of interrupt 1 in NVIC_ISPR0 (ARM DDI
/// 0403E, B3.2.4 and B3.4.5).
const PENDING: [(Interrupt, u64, u64); 2] = [
    (Interrupt::NonMaskable, 0xE000_ED04, 1 << 31),
    (Interrupt::Supply, 0xE000_E200, 1 << 1),
];
/// Registers of the MPU, and the number of its regions (ARM DDI 0403E, B3.5.4).
const MPU_RNR: u64 = 0xE000_ED98;
const MPU_RBAR: u64 = 0xE000_ED9C;
const MPU_RASR: u64 = 0xE000_EDA0;
const REGIONS: u64 = 16;
/// GDB's number of the program status register, whose low nine bits are the exception under way.
const STATUS_REGISTER: usize = 16;
const EXCEPTION: u32 = 0x1FF;
/// Largest number of addresses in a report. It suffices to find the code.
const PLACES_KEPT: usize = 16;

/// Length of a bank, bytes.
const BANK: u64 = BYTES as u64 / 2;
/// The bank with the code, as a bit of [`Busy::banks`].
const CODE_BANK: u8 = 1;
/// The bank without the code, as a bit of [`Busy::banks`].
const OTHER_BANK: u8 = 2;
/// Instructions between two checks of the MPU while the bank with the code is busy: about a microsecond.
const LOOK: u32 = 256;
/// The status of a bank of the flash: FLASH_SR1 and FLASH_SR2 (section 4.9.5).
const FLASH_STATUS: [u64; 2] = [0x5200_2010, 0x5200_2110];
/// Addresses of the control registers of ADC1 and ADC2, whose models end a calibration by an event (section 25.6.3).
const CONVERTER_CONTROL: [u64; 2] = [0x4002_2008, 0x4002_2108];
/// Time for which a bank's reads stay on the bus after it was busy. An upload, or an exchange of images, thus reroutes
/// the bank's pages only once. For the bank with the code this applies only while the MPU is off: then the bootloader
/// runs, which reads little besides what it moves.
const LINGER: VirtualNanos = VirtualNanos(20_000_000);

/// One run through the tick's handler, recorded instruction by instruction.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Audit {
    /// Number of instructions from the handler's first to its return, including both.
    pub instructions: u64,
    /// Address of the instruction that returned.
    pub exit: u64,
    /// Instructions fetched from flash.
    pub flash_fetches: u64,
    /// Number of loads from flash.
    pub flash_reads: u64,
    /// Addresses of the first of the instructions that used flash, each listed once.
    pub places: Vec<u64>,
}

impl Audit {
    fn place(&mut self, address: u64) {
        if self.places.len() < PLACES_KEPT && !self.places.contains(&address) {
            self.places.push(address);
        }
    }
}

#[derive(Debug, Default)]
enum Asked {
    #[default]
    Nothing,
    Running(Audit),
    Done(Audit),
}

/// A handle that requests an audit from the core and takes its outcome.
#[derive(Clone, Debug, Default)]
pub struct Auditor(Arc<Mutex<Asked>>);

impl Auditor {
    fn asked(&self) -> MutexGuard<'_, Asked> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins an audit with the next instruction; it ends when the exception under way returns.
    pub fn begin(&self) {
        *self.asked() = Asked::Running(Audit::default());
    }

    /// True while an audit is under way.
    pub fn running(&self) -> bool {
        matches!(*self.asked(), Asked::Running(_))
    }

    /// Returns the outcome of an audit that has ended. Each outcome is returned only once.
    pub fn take(&self) -> Option<Audit> {
        let mut asked = self.asked();
        match std::mem::take(&mut *asked) {
            Asked::Done(audit) => Some(audit),
            other => {
                *asked = other;
                None
            }
        }
    }
}

/// The registers that the core has read or written, and the words of memory whose pages went over the bus. Each word's
/// address maps to the bits that were ever written as ones.
#[derive(Clone, Debug, Default)]
pub struct Touched(Arc<OnceLock<Mutex<BTreeMap<u64, u64>>>>);

impl Touched {
    /// Begins to note the registers.
    pub fn begin(&self) {
        self.0.get_or_init(Mutex::default);
    }

    /// All registers and words that were noted; none before [`Touched::begin`].
    pub fn noted(&self) -> BTreeMap<u64, u64> {
        let noted = self.0.get().map(|noted| noted.lock());
        noted.map_or_else(BTreeMap::new, |noted| {
            noted.unwrap_or_else(PoisonError::into_inner).clone()
        })
    }

    fn note(&self, access: &Access) {
        if let Some(noted) = self.0.get() {
            let mut noted = noted.lock().unwrap_or_else(PoisonError::into_inner);
            let ones = access.value << (8 * (access.address & 3));
            *noted.entry(access.address & !3).or_default() |= ones & u64::from(u32::MAX);
        }
    }
}

/// Wraps this core around the core that `spec` creates.
pub fn wrap(
    spec: &mut CoreSpec,
    unreadable: Unreadable,
    ram: Ram,
    busy: Busy,
    defects: Defects,
    auditor: Auditor,
    touched: Touched,
) {
    let make = Arc::clone(&spec.processor);
    spec.processor = Arc::new(move |endian| {
        Ok(Box::new(Core {
            inner: Turns::new(|| make(endian))?,
            unreadable: unreadable.clone(),
            ram: ram.clone(),
            busy: busy.clone(),
            stalled: 0,
            stall: None,
            polls: Polls::default(),
            busy_since: 0,
            next_look: 0,
            code_region: None,
            on_bus_until: [VirtualNanos(0); 2],
            on_bus: 0,
            defects: defects.clone(),
            seen_changes: None,
            seen_misreads: false,
            auditor: auditor.clone(),
            touched: touched.clone(),
            auditing: None,
            routed: BTreeSet::new(),
        }))
    });
}

#[derive(Debug)]
struct Core {
    inner: Turns,
    unreadable: Unreadable,
    ram: Ram,
    busy: Busy,
    /// Instructions that count as executed because the core stood still.
    stalled: u64,
    /// An address in the bank for which the core waits.
    stall: Option<u64>,
    polls: Polls,
    /// Number of instructions retired when the bank with the code became busy.
    busy_since: u64,
    /// Number of retired instructions at which the MPU is checked next.
    next_look: u64,
    /// The MPU's region that covers the code in the busy bank.
    code_region: Option<u64>,
    /// Instant per bank until which the bank's reads go over the bus after it was busy.
    on_bus_until: [VirtualNanos; 2],
    /// The banks whose reads go over the bus, a bit per bank.
    on_bus: u8,
    defects: Defects,
    seen_changes: Option<[u64; 2]>,
    seen_misreads: bool,
    auditor: Auditor,
    touched: Touched,
    /// The exception that is being audited.
    auditing: Option<u32>,
    /// Pages that go over the bus.
    routed: BTreeSet<u64>,
}

impl Core {
    /// Routes over the bus: pages with unreadable words, banks that are or were just busy, all of the flash during an
    /// audit, the pages that [`Ram::pages`] names, and the AXI SRAM while its reads are corrupted.
    fn route(&mut self) {
        let page = self.inner.page_size();
        // Plain memory is read past the bus, so an audit could not count loads from it.
        let mut wanted: BTreeSet<u64> = if self.auditing.is_some() {
            FLASH.step_by(page as usize).collect()
        } else {
            let words = self.unreadable.words();
            let unreadable = words.iter().map(|&word| u64::from(word) & !(page - 1));
            let banks = (0..2)
                .filter(|bank| self.on_bus & 1 << bank != 0)
                .map(|bank| FLASH.start + bank * BANK)
                .flat_map(|start| (start..start + BANK).step_by(page as usize));
            unreadable.chain(banks).collect()
        };
        wanted.extend(self.ram.pages(page));
        if self.defects.misreads() {
            wanted.extend(AXI_SRAM.step_by(page as usize));
        }
        for &address in wanted.difference(&self.routed) {
            self.inner.ask(Queued::Route(address));
        }
        for &address in self.routed.difference(&wanted) {
            self.inner.ask(Queued::Unroute(address));
        }
        self.routed = wanted;
    }

    /// Updates the routing for the banks that became busy or idle at `now`.
    fn follow_busy(&mut self, now: VirtualNanos) {
        let busy = self.busy.banks();
        if busy & CODE_BANK != 0 && self.on_bus & CODE_BANK == 0 {
            self.busy_since = self.inner.retired();
            self.next_look = self.busy_since;
        }
        let lingering = if busy & CODE_BANK != 0 && self.inner.is_protected() {
            busy & OTHER_BANK
        } else {
            busy
        };
        let mut wanted = busy;
        for (bank, until) in (0..).zip(&mut self.on_bus_until) {
            if lingering & 1 << bank != 0 {
                *until = VirtualNanos(now.0 + LINGER.0);
            }
            wanted |= u8::from(now < *until) << bank;
        }
        if wanted != self.on_bus {
            self.on_bus = wanted;
            self.route();
        }
    }

    /// Returns whether the core stands still: because of a load that it has put off, because of its next instruction,
    /// or because it may fetch ahead from the busy bank with the code.
    fn stands_still(&mut self) -> bool {
        if let Some(address) = self.stall {
            if self.busy.holds(address) {
                return true;
            }
            self.stall = None;
        }
        // A core that sleeps fetches nothing.
        if self.inner.waiting() {
            return false;
        }
        let at = self.inner.pc();
        if self.busy.holds(at) {
            self.busy.count_fetch();
            self.stall = Some(at);
        } else if self.busy.banks() & CODE_BANK != 0 && self.may_fetch_ahead() {
            self.busy.count_ahead();
            // Any address in the bank with the code serves: the core waits until the bank is idle.
            self.stall = Some(FLASH.start);
        }
        self.stall.is_some()
    }

    /// Returns true if a check of the MPU is due and the MPU lets the processor fetch from the bank with the code. The
    /// region with the highest number that covers the bank's first address decides; it is determined when the bank
    /// becomes busy. Subregions are ignored.
    fn may_fetch_ahead(&mut self) -> bool {
        // PRIVDEFENA of MPU_CTRL, and XN and AP of MPU_RASR (ARM DDI 0403E, B3.5.5 and B3.5.9).
        const BACKGROUND: u64 = 1 << 2;
        const NEVER: u64 = 1 << 28;
        const ACCESS: u64 = 0b111 << 24;
        if self.inner.retired() < self.next_look {
            return false;
        }
        let is_first = self.next_look == self.busy_since;
        self.next_look = self.inner.retired() + u64::from(LOOK);
        if !self.inner.is_protected() {
            return true;
        }
        let control = self.mpu(None, MPU_CTRL);
        let selected = self.mpu(None, MPU_RNR);
        if is_first {
            // To find the region takes 48 accesses, too many for each look.
            self.code_region = (0..REGIONS).rev().find(|&region| {
                self.mpu(Some(region), MPU_RNR);
                let attributes = self.mpu(None, MPU_RASR);
                // A region has 2^(SIZE + 1) bytes.
                let length_log2 = (attributes >> 1 & 0x1F) + 1;
                let base = self.mpu(None, MPU_RBAR);
                attributes & MPU_ENABLE != 0 && FLASH.start >> length_log2 == base >> length_log2
            });
        }
        let attributes = self.code_region.map(|region| {
            self.mpu(Some(region), MPU_RNR);
            self.mpu(None, MPU_RASR)
        });
        // The image may be between its own write of RNR and the registers that RNR selects.
        self.mpu(Some(selected), MPU_RNR);
        attributes.map_or(control & BACKGROUND != 0, |attributes| {
            attributes & NEVER == 0 && attributes & ACCESS != 0
        })
    }

    /// Reads a register of the MPU, or writes it.
    fn mpu(&mut self, write: Option<u64>, register: u64) -> u64 {
        let now = VirtualNanos(0);
        (self.inner)
            .debugger_access(write, register, Width::W32, now)
            .unwrap_or_default()
    }

    /// Runs at most [`LOOK`] instructions while the bank with the code is busy, so that the next fetch is checked soon.
    fn run_beside_busy_code(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let step = budget.min(LOOK);
        let (exit, retired, _) = self.run_inner(step, bus, true);
        match exit {
            // `Budget` would say that the whole budget was used.
            Exit::Budget if step < budget => (Exit::Returned, retired),
            other => (other, retired),
        }
    }

    /// Runs the inner core, and puts off a load that has to wait for its bank. Returns the number of loads from flash,
    /// too. If `goes_on`, the stretch continues past an event unless a model has changed what is routed.
    fn run_inner(&mut self, budget: u32, bus: &mut dyn CoreBus, goes_on: bool) -> (Exit, u64, u64) {
        let changes = (self.unreadable.changes(), self.ram.changes(), self.busy.banks());
        let mut seen = Seen {
            bus,
            unreadable: &self.unreadable,
            ram: &self.ram,
            busy: &self.busy,
            polls: &mut self.polls,
            stalled: self.stalled,
            put_off: None,
            defects: &self.defects,
            touched: &self.touched,
            changes: goes_on.then_some(changes),
            flash_reads: 0,
        };
        let (exit, retired) = self.inner.run(budget, &mut seen);
        let flash_reads = seen.flash_reads;
        // A load that was put off has not happened; its instruction begins again once the bank is idle.
        let Some(address) = seen.put_off else {
            return (exit, retired, flash_reads);
        };
        self.busy.count_read();
        self.stall = Some(address);
        (Exit::Returned, retired, flash_reads)
    }

    fn exception(&self) -> u32 {
        let bytes = self.inner.gdb_register(STATUS_REGISTER).unwrap_or_default();
        bytes
            .first_chunk()
            .map_or(0, |bytes| u32::from_le_bytes(*bytes) & EXCEPTION)
    }

    fn step(&mut self, exception: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let at = self.inner.pc();
        let (exit, retired, flash_reads) = self.run_inner(1, bus, false);
        if self.stall.is_some() {
            return (exit, retired);
        }
        // Only a fault preempts the tick, so another exception number means that the handler has returned.
        let left = self.exception() != exception;
        let mut asked = self.auditor.asked();
        if let Asked::Running(audit) = &mut *asked {
            audit.instructions += retired;
            audit.flash_reads += flash_reads;
            let fetched = retired != 0 && FLASH.contains(&at);
            audit.flash_fetches += u64::from(fetched);
            if fetched || flash_reads != 0 {
                audit.place(at);
            }
            if left {
                audit.exit = at;
                let done = std::mem::take(audit);
                *asked = Asked::Done(done);
            }
        }
        drop(asked);
        if left {
            self.auditing = None;
            self.route();
        }
        match exit {
            Exit::Budget => (Exit::Returned, retired),
            other => (other, retired),
        }
    }
}

/// The bus, with checks of each access, such as reads of flash.
struct Seen<'a> {
    bus: &'a mut dyn CoreBus,
    unreadable: &'a Unreadable,
    ram: &'a Ram,
    busy: &'a Busy,
    polls: &'a mut Polls,
    /// Instructions that count as executed in addition to those of the inner core.
    stalled: u64,
    /// Address of a load that was put off because its bank is busy.
    put_off: Option<u64>,
    /// Number of changes of the unreadable words, number of changes of the RAM's codes, and the busy banks, all as the
    /// stretch began. `None` for a stretch that has to end.
    changes: Option<(u64, u64, u8)>,
    defects: &'a Defects,
    touched: &'a Touched,
    flash_reads: u64,
}

impl CoreBus for Seen<'_> {
    fn access(&mut self, mut access: Access, from_code: bool) -> Option<u64> {
        if !self.ram.takes(&access) {
            return Some(0);
        }
        self.touched.note(&access);
        // To the rest of the machine the core has executed what it could have executed while it stood still.
        access.instruction_count += self.stalled;
        let status = FLASH_STATUS.iter().position(|&status| status == access.address);
        let is_status = status.is_some_and(|bank| self.busy.banks() & 1 << bank != 0);
        let is_poll = is_status || CONVERTER_CONTROL.contains(&access.address);
        self.polls.follow(&access, is_poll);
        if access.kind == AccessKind::Read && FLASH.contains(&access.address) {
            self.flash_reads += 1;
            if self.unreadable.fails(access.address as u32, access.width.bytes()) {
                return None;
            }
        }
        if access.address == AXI_SRAM_ISSUING && access.kind == AccessKind::Write {
            self.defects.issue_one_read(access.value & ONE_READ != 0);
        }
        if AXI_SRAM.contains(&access.address)
            && access.kind == AccessKind::Read
            && access.address.is_multiple_of(MISREAD_BYTES)
            && self.defects.misreads()
        {
            // One wrong bit suffices: the image compares the library's checksum.
            return self.bus.access(access, from_code).map(|value| value ^ 1);
        }
        if USB.contains(&access.address) {
            let mut redirected = access;
            redirected.address = access.address - usb::BASE + usb::WINDOW_BASE;
            return self.bus.access(redirected, from_code);
        }
        let value = self.bus.access(access, from_code);
        if access.address == POWER_STATUS && access.kind == AccessKind::Read {
            self.ram.power_status(value.unwrap_or(0));
        }
        value
    }

    fn time(&self, instructions: u64) -> VirtualNanos {
        self.bus.time(instructions + self.stalled)
    }

    fn queued(&mut self) -> Vec<Queued> {
        self.bus.queued()
    }

    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        // A word that a model has just marked as unreadable must be routed before the core continues.
        let changes = (self.unreadable.changes(), self.ram.changes(), self.busy.banks());
        if Some(changes) == self.changes && !self.polls.are_all() {
            self.bus.carry_on(instructions + self.stalled, event)
        } else {
            None
        }
    }

    fn acknowledge(&mut self, line: InterruptLine, instructions: u64) -> Option<u64> {
        self.bus.acknowledge(line, instructions + self.stalled)
    }

    fn read_checked(&mut self, access: Access, report: bool) -> Option<Checked> {
        self.bus.read_checked(access, report)
    }

    fn write_checked(&mut self, access: Access) -> Option<bool> {
        self.bus.write_checked(access)
    }

    fn stops_before(&mut self, access: &Access) -> bool {
        if access.kind == AccessKind::Read && self.busy.holds(access.address) {
            self.put_off = Some(access.address);
            return true;
        }
        let mut counted = *access;
        counted.instruction_count += self.stalled;
        self.bus.stops_before(&counted)
    }

    fn send_trace(&mut self, bytes: &[u8]) {
        self.bus.send_trace(bytes);
    }
}

// Methods that only a debugger calls are left out, because none attaches to this core.
impl Processor for Core {
    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let now = bus.time(self.retired());
        self.follow_busy(now);
        if self.stands_still() {
            self.stalled += u64::from(budget);
            return (Exit::Budget, u64::from(budget));
        }
        let changes = [self.unreadable.changes(), self.ram.changes()];
        // No line of the emulator's core leads to these interrupts, so they are made pending as a debugger does it.
        for (interrupt, address, bit) in PENDING {
            if self.defects.take_interrupt(interrupt) {
                let now = bus.time(0);
                (self.inner).debugger_access(Some(bit), address, Width::W32, now);
            }
        }
        let misreads = self.defects.misreads();
        if self.auditing.is_none() && self.auditor.running() {
            self.auditing = Some(self.exception());
            self.route();
        } else if self.seen_changes != Some(changes) || self.seen_misreads != misreads {
            self.seen_changes = Some(changes);
            self.seen_misreads = misreads;
            self.route();
        }
        if let Some(exception) = self.auditing {
            return self.step(exception, bus);
        }
        if let Some(left_out) = self.polls.take(budget) {
            // An interrupt that has become pending meanwhile is taken before the next poll.
            self.stalled += u64::from(left_out);
            let is_whole = left_out == budget;
            let exit = if is_whole { Exit::Budget } else { Exit::Returned };
            return (exit, u64::from(left_out));
        }
        if self.busy.banks() & CODE_BANK != 0 {
            return self.run_beside_busy_code(budget, bus);
        }
        let (exit, retired, _) = self.run_inner(budget, bus, true);
        (exit, retired)
    }

    fn retired(&self) -> u64 {
        self.inner.retired() + self.stalled
    }

    fn ask(&mut self, queued: Queued) {
        self.inner.ask(queued);
    }

    fn maps(&self, start: u64, length: u64) -> bool {
        self.inner.maps(start, length)
    }

    fn page_size(&self) -> u64 {
        self.inner.page_size()
    }

    #[expect(
        unsafe_code,
        reason = "the emulator's trait hands memory over by pointer; here it is only passed on"
    )]
    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        // SAFETY: the caller gives this method the promises that the inner method requires. The inner processor is
        // dropped together with this one, so every promise that lasts until the drop lasts long enough.
        unsafe { self.inner.map(start, length, host, writable) }
    }

    fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>) {
        self.inner.boot(table, read);
    }

    fn reset(&mut self) {
        self.inner.reset();
        // The tick that was being audited never returns.
        self.auditing = None;
        if self.auditor.running() {
            *self.auditor.asked() = Asked::Nothing;
        }
        // Pages are routed anew: after a reset RAM may not be written.
        self.seen_changes = None;
        self.stall = None;
        self.ram.reset();
        self.defects.issue_one_read(false);
    }

    fn take_reset_request(&mut self) -> bool {
        self.inner.take_reset_request()
    }

    fn next_event(&self) -> Option<VirtualNanos> {
        self.inner.next_event()
    }

    fn on_event(&mut self, now: VirtualNanos) {
        self.inner.on_event(now);
    }

    fn waiting(&self) -> bool {
        self.inner.waiting()
    }

    fn pc(&self) -> u64 {
        self.inner.pc()
    }

    fn add_breakpoint(&mut self, address: u64) -> bool {
        self.inner.add_breakpoint(address)
    }

    fn remove_breakpoint(&mut self, address: u64) {
        self.inner.remove_breakpoint(address);
    }

    fn pass_breakpoint(&mut self, address: u64) {
        self.inner.pass_breakpoint(address);
    }

    fn gdb_register(&self, number: usize) -> Option<Vec<u8>> {
        self.inner.gdb_register(number)
    }

    fn debugger_access(&mut self, write: Option<u64>, address: u64, width: Width, now: VirtualNanos) -> Option<u64> {
        self.inner.debugger_access(write, address, width, now)
    }

    fn data_model(&self) -> DataModel {
        self.inner.data_model()
    }

    fn byte_order(&self, address: u64) -> Endian {
        self.inner.byte_order(address)
    }

    fn save(&self) -> Vec<u8> {
        self.inner.save()
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.inner.load(bytes)
    }

    fn bit_alias(&self, address: u64, width: Width) -> Option<rigless::emulator::BitAlias> {
        self.inner.bit_alias(address, width)
    }

    fn own_ranges(&self) -> Vec<std::ops::Range<u64>> {
        self.inner.own_ranges()
    }

    fn check_reads(&mut self, every: bool) {
        self.inner.check_reads(every);
    }

    fn check_words(&mut self, words: &[u64]) {
        self.inner.check_words(words);
    }

    fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall> {
        self.inner.host_call(read)
    }

    fn answer_host_call(&mut self, answer: Option<u64>) {
        self.inner.answer_host_call(answer);
    }
}
