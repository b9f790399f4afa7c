//! The flash as a memory that outlives a run: it counts operations, cuts the power at one of them, and knows the words
//! whose error correction no longer fits (chapter 4). The emulator's model does the programming and erasing itself.
//!
//! | What | Section |
//! |---|---|
//! | One operation: a word of 32 bytes programmed or forced out (`FW`), or a sector or bank erased | 4.3.9, 4.3.10 |
//! | An operation is counted when it starts | |
//! | A word that was not erased and is programmed over gets an error correction that does not fit | 4.3.9, 4.3.12 |
//! | So does a word torn by a power cut. Reading it is a bus error, `DBECCERRx` and `ECC_FAxR` | 4.3.12, 4.7.8, 4.9.5 |
//! | So does a word of ones that is programmed again: the manual does not say that it may be | 4.3.9 |
//! | An erase mends the words of its sector | 4.3.10 |
//!
//! A torn word always faults here. On the part it may also read as a word with one corrected error, or by chance as an
//! intact word. An erase that was interrupted leaves each word as it was, erased, or torn, at random from a seed.
//!
//! | A read or fetch from a bank that is busy waits until it is idle; the other bank continues | 4.3.7, 4.3.11 |
//!
//! The model of the core (`src/core.rs`) implements the wait, because [`Busy`] shows it which bank is busy. There are
//! no caches here, so every fetch from a busy bank waits, where the part's instruction cache may avoid some. A core
//! that may fetch from the busy bank with the code also fetches ahead from there, from wherever it runs.
//!
//! Left out: the stall of a write to a bank whose queue is full, corrected single errors (`SNECCERRx`), fetches of
//! instructions from torn words, and mass erase by `OPTCR`.

use std::collections::{BTreeSet, VecDeque};
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::device::RegisterFile;
use rigless::soc::Width;
use rigless::soc::stm32h743::generated::flash::{Register, cr1, optsr_cur, sr1};
use rigless::soc::stm32h743::peripherals::flash::Flash;

use super::around::{Around, Call};
use crate::chance::Chance;
use crate::{Error, Result};

/// Address of the flash (table 7).
pub const BASE: u32 = 0x0800_0000;
/// Length of both banks, bytes.
pub const BYTES: usize = 2 << 20;
/// Length of a flash word, bytes. It is the unit of programming and of error correction.
pub const WORD_BYTES: u32 = 32;
/// Length of a sector, bytes. It is the unit of erasing.
pub const SECTOR_BYTES: u32 = 128 << 10;
/// Bytes that probe-rs programs at once: the `page_size` in its description of the part.
const PAGE_BYTES: u32 = 0x400;
const BANK_BYTES: u32 = 1 << 20;
const ERASED: u8 = 0xFF;

/// What an operation does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A word of 32 bytes is programmed.
    Program {
        /// Address of the first byte.
        address: u32,
        /// The new content.
        word: [u8; WORD_BYTES as usize],
    },
    /// The bytes of this range of addresses are erased.
    Erase(Range<u32>),
}

/// An operation as it starts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Operation {
    /// Number of the operation in this run, from 1.
    pub number: u64,
    /// Instant of its start, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The operation.
    pub kind: Kind,
}

/// How far an operation has come at the power cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// The cells are as they were.
    Before,
    /// The operation is in progress; its outcome is random.
    During {
        /// Seed of the outcome; any number.
        seed: u64,
    },
    /// The cells have their new content, but the image does not know yet.
    After,
}

/// Content of the flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contents {
    /// Bytes of both banks.
    pub bytes: Vec<u8>,
    /// Addresses of unreadable words.
    pub unreadable: BTreeSet<u32>,
    /// Addresses of words that were programmed with ones.
    pub filled: BTreeSet<u32>,
}

impl Default for Contents {
    fn default() -> Self {
        Self {
            bytes: vec![ERASED; BYTES],
            unreadable: BTreeSet::new(),
            filled: BTreeSet::new(),
        }
    }
}

/// Flag for a word that was programmed with ones. In a file it is the lowest bit of the word's address.
const FILLED: u32 = 1;

/// A word of ones.
pub const ONES: [u8; WORD_BYTES as usize] = [ERASED; WORD_BYTES as usize];

impl Contents {
    /// Reads a file that [`Contents::write`] has written.
    ///
    /// # Errors
    /// The file cannot be read, its length is not that of both banks and of marks of four bytes, or a mark is not that
    /// of a word.
    pub fn read(path: &Path) -> Result<Self> {
        let told = |reason: String| Error::FlashFile {
            path: path.to_owned(),
            reason,
        };
        // A file is longest if every word has both flags, which take four bytes each.
        let most = BYTES + BYTES / WORD_BYTES as usize * 8;
        let mut bytes = Vec::new();
        let mut file = std::fs::File::open(path)
            .map_err(|error| told(error.to_string()))?
            .take(most as u64 + 1);
        file.read_to_end(&mut bytes).map_err(|error| told(error.to_string()))?;
        if bytes.len() > most {
            return Err(told(format!("is longer than a flash's {most} bytes")));
        }
        if bytes.len() < BYTES || bytes.len() % 4 != 0 {
            return Err(told(format!("has {} bytes, not the flash's {BYTES}", bytes.len())));
        }
        let (words, _) = bytes[BYTES..].as_chunks::<4>();
        let marks = words.iter().map(|word| u32::from_le_bytes(*word));
        let is_word = |mark: u32| {
            let address = mark & !FILLED;
            word_of(address) == address && bank_of(address.into()).is_some()
        };
        if let Some(mark) = marks.clone().find(|mark| !is_word(*mark)) {
            return Err(told(format!("marks {mark:#010x}, which is no word of the flash")));
        }
        let (filled, unreadable) = marks.partition::<BTreeSet<_>, _>(|mark| mark & FILLED != 0);
        let filled = filled.into_iter().map(|mark| mark & !FILLED).collect();
        bytes.truncate(BYTES);
        Ok(Self {
            bytes,
            unreadable,
            filled,
        })
    }

    /// The bytes of a file with this content: both banks, then the addresses of unreadable and of filled words.
    pub fn to_bytes(&self) -> Vec<u8> {
        let filled = self.filled.iter().map(|address| address | FILLED);
        let marks = self.unreadable.iter().copied().chain(filled).flat_map(u32::to_le_bytes);
        self.bytes.iter().copied().chain(marks).collect()
    }

    /// Writes the content to the file at `path`.
    pub fn write(&self, path: &Path) -> Result<()> {
        std::fs::write(path, self.to_bytes()).map_err(|error| Error::FlashFile {
            path: path.to_owned(),
            reason: error.to_string(),
        })
    }

    /// Puts `bytes` at `address`, whatever the flash held there.
    pub fn place(&mut self, address: u64, bytes: &[u8]) -> std::result::Result<(), String> {
        let place = in_flash(address, bytes)?;
        self.bytes[offsets(&place)].copy_from_slice(bytes);
        // The first word may be covered in part only.
        self.mend(&(word_of(place.start)..place.end));
        Ok(())
    }

    /// Flashes `segments`, each with its address, like probe-rs. It erases every sector that a segment touches. Then it
    /// programs every page that a segment touches, with ones in the page's remaining bytes.
    pub fn flash(&mut self, segments: &[(u64, &[u8])]) -> std::result::Result<(), String> {
        let units = |unit: u32| -> std::result::Result<BTreeSet<u32>, String> {
            let mut units = BTreeSet::new();
            for (address, bytes) in segments {
                let place = in_flash(*address, bytes)?;
                units.extend((place.start / unit * unit..place.end).step_by(unit as usize));
            }
            Ok(units)
        };
        // Both lists are made before anything is erased, so that a segment outside of the flash changes nothing.
        let pages = units(PAGE_BYTES)?;
        for sector in units(SECTOR_BYTES)? {
            self.erase(&(sector..sector + SECTOR_BYTES));
        }
        for (address, bytes) in segments {
            self.place(*address, bytes)?;
        }
        for page in pages {
            for address in (page..page + PAGE_BYTES).step_by(WORD_BYTES as usize) {
                let word = address..address + WORD_BYTES;
                if self.bytes[offsets(&word)] == ONES {
                    self.filled.insert(address);
                }
            }
        }
        Ok(())
    }

    fn erase(&mut self, range: &Range<u32>) {
        self.bytes[offsets(range)].fill(ERASED);
        self.mend(range);
    }

    fn mend(&mut self, range: &Range<u32>) {
        for marks in [&mut self.unreadable, &mut self.filled] {
            marks.retain(|word| !range.contains(word));
        }
    }

    /// Applies a power cut of `operation` at `moment`.
    pub fn cut(&mut self, operation: &Kind, moment: Moment) {
        match (operation, moment) {
            (_, Moment::Before) => {}
            (Kind::Program { address, word }, Moment::After) => self.program(*address, word),
            (Kind::Program { address, word }, Moment::During { seed }) => {
                self.tear(*address, word, &mut Chance(seed));
            }
            (Kind::Erase(range), Moment::After) => self.erase(range),
            (Kind::Erase(range), Moment::During { seed }) => {
                let mut chance = Chance(seed);
                for address in range.clone().step_by(WORD_BYTES as usize) {
                    match chance.draw() % 3 {
                        0 => {}
                        1 => self.erase(&(address..address + WORD_BYTES)),
                        _ => self.half_erase(address, &mut chance),
                    }
                }
            }
        }
    }

    fn program(&mut self, address: u32, word: &[u8; WORD_BYTES as usize]) {
        let cells = &mut self.bytes[offsets(&(address..address + WORD_BYTES))];
        if cells.iter().any(|cell| *cell != ERASED) || self.filled.contains(&address) {
            self.unreadable.insert(address);
        } else if *word == ONES {
            self.filled.insert(address);
        }
        // Programming can only turn ones into zeros.
        for (cell, bits) in cells.iter_mut().zip(word) {
            *cell &= bits;
        }
    }

    fn tear(&mut self, address: u32, word: &[u8; WORD_BYTES as usize], chance: &mut Chance) {
        let cells = &mut self.bytes[offsets(&(address..address + WORD_BYTES))];
        // Of the bits that were to become zeros, some at random still are ones.
        for (cell, bits) in cells.iter_mut().zip(word) {
            *cell &= bits | chance.draw() as u8;
        }
        self.unreadable.insert(address);
    }

    fn half_erase(&mut self, address: u32, chance: &mut Chance) {
        for cell in &mut self.bytes[offsets(&(address..address + WORD_BYTES))] {
            *cell |= chance.draw() as u8;
        }
        self.unreadable.insert(address);
    }
}

/// Returns the addresses of `bytes` placed at `address`, or the reason why they do not lie in the flash.
fn in_flash(address: u64, bytes: &[u8]) -> std::result::Result<Range<u32>, String> {
    let flash = u64::from(BASE)..=u64::from(BASE) + BYTES as u64;
    let end = address.saturating_add(bytes.len() as u64);
    if flash.contains(&address) && flash.contains(&end) {
        return Ok(address as u32..end as u32);
    }
    Err(format!(
        "{} bytes at {address:#010x} do not lie in the flash",
        bytes.len()
    ))
}

fn offsets(range: &Range<u32>) -> Range<usize> {
    (range.start - BASE) as usize..(range.end - BASE) as usize
}

const fn word_of(address: u32) -> u32 {
    address & !(WORD_BYTES - 1)
}

/// The unreadable words, and the words that were programmed with ones. The flash's registers and the core share them.
#[derive(Clone, Debug, Default)]
pub struct Unreadable(Arc<Mutex<Marks>>);

#[derive(Debug, Default)]
struct Marks {
    words: BTreeSet<u32>,
    filled: BTreeSet<u32>,
    changes: u64,
    /// Addresses of failed reads that the registers do not show yet.
    failed: Vec<u32>,
    failures: u64,
}

impl Unreadable {
    fn marks(&self) -> MutexGuard<'_, Marks> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Replaces all unreadable words by `words`, and all words programmed with ones by `filled`.
    pub fn replace(&self, words: BTreeSet<u32>, filled: BTreeSet<u32>) {
        let mut marks = self.marks();
        marks.words = words;
        marks.filled = filled;
        marks.changes += 1;
    }

    /// All words that were programmed with ones.
    pub fn filled(&self) -> BTreeSet<u32> {
        self.marks().filled.clone()
    }

    /// All unreadable words.
    pub fn words(&self) -> BTreeSet<u32> {
        self.marks().words.clone()
    }

    /// Number of changes of the unreadable words. A caller compares it with an earlier number to notice a change.
    pub fn changes(&self) -> u64 {
        self.marks().changes
    }

    /// Number of failed reads in this run.
    pub fn failures(&self) -> u64 {
        self.marks().failures
    }

    /// Notes that `word` is programmed at `address`, where `is_erased` is true if the cells were erased before. A word
    /// that may not be programmed again becomes unreadable.
    pub fn program(&self, address: u32, word: &[u8], is_erased: bool) {
        let mut marks = self.marks();
        if !is_erased || marks.filled.contains(&address) {
            marks.changes += u64::from(marks.words.insert(address));
        } else if word == ONES {
            marks.filled.insert(address);
        }
    }

    /// Handles an access to a number of `bytes` at `address`, and returns true if the access fails.
    pub fn fails(&self, address: u32, bytes: u32) -> bool {
        let mut marks = self.marks();
        // An unaligned load may reach into the next word.
        let last = word_of(address.saturating_add(bytes - 1));
        let failed = marks.words.contains(&word_of(address)) || marks.words.contains(&last);
        if failed {
            marks.failed.push(address);
            marks.failures += 1;
        }
        failed
    }

    fn mend(&self, range: &Range<u32>) {
        let mut marks = self.marks();
        let before = marks.words.len();
        marks.words.retain(|word| !range.contains(word));
        marks.filled.retain(|word| !range.contains(word));
        marks.changes += u64::from(marks.words.len() != before);
    }

    fn take_failed(&self) -> Vec<u32> {
        std::mem::take(&mut self.marks().failed)
    }
}

/// Returns the bank that contains `address`, if it is in the flash.
pub fn bank_of(address: u64) -> Option<usize> {
    let offset = address.checked_sub(u64::from(BASE))?;
    let bank = usize::try_from(offset / u64::from(BANK_BYTES)).ok()?;
    (bank < 2).then_some(bank)
}

/// Numbers of accesses that waited for a busy bank.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stalls {
    /// Fetches of instructions.
    pub fetches: u64,
    /// Fetches ahead from the bank, by code outside of it.
    pub ahead: u64,
    /// Loads.
    pub reads: u64,
}

/// The banks that are being programmed or erased, and the accesses that waited for them. The flash's registers and the
/// core share them.
#[derive(Clone, Debug, Default)]
pub struct Busy(Arc<BusyState>);

#[derive(Debug, Default)]
struct BusyState {
    /// The busy banks, a bit per bank.
    banks: AtomicU8,
    fetches: AtomicU64,
    ahead: AtomicU64,
    reads: AtomicU64,
}

impl Busy {
    fn set(&self, bank: usize, busy: bool) {
        let bit = 1 << bank;
        if busy {
            self.0.banks.fetch_or(bit, Ordering::Relaxed);
        } else {
            self.0.banks.fetch_and(!bit, Ordering::Relaxed);
        }
    }

    /// The busy banks, a bit per bank.
    pub fn banks(&self) -> u8 {
        self.0.banks.load(Ordering::Relaxed)
    }

    /// True while `address` is in a bank that is busy.
    pub fn holds(&self, address: u64) -> bool {
        bank_of(address).is_some_and(|bank| self.banks() & 1 << bank != 0)
    }

    /// Counts a fetch that waits.
    pub fn count_fetch(&self) {
        self.0.fetches.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a fetch ahead that waits.
    pub fn count_ahead(&self) {
        self.0.ahead.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a load that waits.
    pub fn count_read(&self) {
        self.0.reads.fetch_add(1, Ordering::Relaxed);
    }

    /// Number of accesses that waited in this run.
    pub fn stalls(&self) -> Stalls {
        Stalls {
            fetches: self.0.fetches.load(Ordering::Relaxed),
            ahead: self.0.ahead.load(Ordering::Relaxed),
            reads: self.0.reads.load(Ordering::Relaxed),
        }
    }
}

/// The word that the image is writing to a bank.
#[derive(Debug, Default)]
struct Buffer {
    address: u32,
    bytes: [Option<u8>; WORD_BYTES as usize],
}

impl Buffer {
    fn store(&mut self, address: u32, width: Width, value: u64) {
        if word_of(address) != self.address {
            *self = Self {
                address: word_of(address),
                bytes: [None; WORD_BYTES as usize],
            };
        }
        let start = (address - self.address) as usize;
        let bytes = value.to_le_bytes();
        for (place, byte) in self.bytes[start..].iter_mut().zip(&bytes[..width.bytes() as usize]) {
            *place = Some(*byte);
        }
    }

    fn full(&self) -> bool {
        self.bytes.iter().all(Option::is_some)
    }

    fn take(&mut self) -> Kind {
        let word = std::mem::take(self);
        Kind::Program {
            address: word.address,
            word: word.bytes.map(|byte| byte.unwrap_or(ERASED)),
        }
    }
}

/// An operation that a write requested, until the model accepts or refuses it.
#[derive(Debug)]
enum Asked {
    Store { bank: usize },
    Force { bank: usize },
    Erase { bank: usize, range: Range<u32> },
}

/// The operations of a run.
#[derive(Debug, Default)]
pub struct Journal {
    /// The unreadable words.
    pub unreadable: Unreadable,
    /// True if the flash begins no erasure; `RDSERRx` shows the refusal.
    pub refuses_erasures: bool,
    busy: Busy,
    buffers: [Buffer; 2],
    asked: Option<Asked>,
    started: u64,
    running: [Vec<Range<u32>>; 2],
    /// BOR_LEV of the option bytes.
    brown_out_level: u8,
    log: Vec<Operation>,
    unseen: VecDeque<Operation>,
}

impl Journal {
    /// An empty journal. `unreadable` are the words that are unreadable from the start, and `brown_out_level` is in the
    /// option bytes. The journal keeps `busy` up to date.
    pub fn new(unreadable: Unreadable, busy: Busy, brown_out_level: u8) -> Self {
        Self {
            unreadable,
            busy,
            brown_out_level,
            ..Self::default()
        }
    }

    /// All operations of this run so far.
    pub fn log(&self) -> &[Operation] {
        &self.log
    }

    /// Number of operations that have started in this run.
    pub fn started(&self) -> u64 {
        self.started
    }

    /// Returns the oldest started operation that no earlier call has returned.
    pub fn take_started(&mut self) -> Option<Operation> {
        self.unseen.pop_front()
    }

    fn start(&mut self, kind: Kind, at_ns: u64) {
        self.started += 1;
        let operation = Operation {
            number: self.started,
            at_ns,
            kind,
        };
        self.unseen.push_back(operation.clone());
        self.log.push(operation);
    }

    fn settle(&mut self, asked: &Asked, registers: &RegisterFile, at_ns: u64) {
        let (Asked::Store { bank } | Asked::Force { bank } | Asked::Erase { bank, .. }) = *asked;
        let status = registers.get(status(bank));
        // If the emulator's model has accepted the request, the bank is busy now.
        let busy = status & (sr1::QW1.mask() | sr1::BSY1.mask()) != 0;
        match asked {
            Asked::Store { .. } if busy && self.buffers[bank].full() => {
                let kind = self.buffers[bank].take();
                self.start(kind, at_ns);
            }
            Asked::Force { .. } if busy && self.buffers[bank].bytes.iter().any(Option::is_some) => {
                let kind = self.buffers[bank].take();
                self.start(kind, at_ns);
            }
            Asked::Erase { range, .. } if busy => {
                self.running[bank].push(range.clone());
                self.start(Kind::Erase(range.clone()), at_ns);
            }
            _ => {}
        }
    }

    fn show_failures(&self, registers: &mut RegisterFile) {
        for address in self.unreadable.take_failed() {
            let bank = usize::from(address >= BASE + BANK_BYTES);
            let flags = registers.get(status(bank));
            registers.set(status(bank), sr1::DBECCERR1.set(flags, 1));
            let word = (address - BASE - bank as u32 * BANK_BYTES) / WORD_BYTES;
            registers.set([Register::EccFa1r, Register::EccFa2r][bank], u64::from(word));
        }
    }
}

const fn status(bank: usize) -> Register {
    if bank == 0 { Register::Sr1 } else { Register::Sr2 }
}

impl Around<Flash> for Journal {
    fn before_store(&mut self, address: u64, width: Width, value: u64, registers: &RegisterFile) {
        let address = address as u32;
        let bank = usize::from(address >= BASE + BANK_BYTES);
        let control = registers.get(if bank == 0 { Register::Cr1 } else { Register::Cr2 });
        if cr1::PG1.is_set(control) {
            self.buffers[bank].store(address, width, value);
            self.asked = Some(Asked::Store { bank });
        }
    }

    fn before_write(&mut self, register: Register, _value: u64, registers: &mut RegisterFile) {
        // This write may clear the flags, so they must be set before.
        self.show_failures(registers);
        let bank = match register {
            Register::Cr1 => 0,
            Register::Cr2 => 1,
            _ => return,
        };
        let control = registers.get(register);
        // A locked register takes no request.
        if cr1::LOCK1.is_set(control) {
            return;
        }
        if self.refuses_erasures && cr1::START1.is_set(control) {
            registers.set(register, cr1::START1.set(control, 0));
            let flags = registers.get(status(bank));
            registers.set(status(bank), sr1::RDSERR1.set(flags, 1));
            return;
        }
        let start = BASE + bank as u32 * BANK_BYTES;
        if cr1::FW1.is_set(control) {
            self.asked = Some(Asked::Force { bank });
        } else if cr1::START1.is_set(control) && cr1::BER1.is_set(control) {
            let range = start..start + BANK_BYTES;
            self.asked = Some(Asked::Erase { bank, range });
        } else if cr1::START1.is_set(control) && cr1::SER1.is_set(control) {
            let sector = start + cr1::SNB1.get(control) as u32 * SECTOR_BYTES;
            let range = sector..sector + SECTOR_BYTES;
            self.asked = Some(Asked::Erase { bank, range });
        }
        if !cr1::PG1.is_set(control) && !cr1::FW1.is_set(control) {
            self.buffers[bank] = Buffer::default();
        }
    }

    fn answer(&mut self, register: Register, value: u64, _registers: &RegisterFile) -> Option<u64> {
        if matches!(register, Register::OptsrCur | Register::OptsrCur_) {
            return Some(optsr_cur::BOR_LEV.set(value, u64::from(self.brown_out_level)));
        }
        // The register file shows a failed read only from the next call on, so the read of this call is answered here.
        let failed = self.unreadable.marks();
        let bank = match register {
            Register::Sr1 => 0,
            Register::Sr2 => 1,
            _ => return None,
        };
        let mut failed = failed.failed.iter();
        failed
            .any(|&address| usize::from(address >= BASE + BANK_BYTES) == bank)
            .then(|| sr1::DBECCERR1.set(value, 1))
    }

    fn after(&mut self, _inner: &mut Flash, call: &mut Call<'_, '_>) {
        let registers = &mut *call.registers;
        if let Some(asked) = self.asked.take() {
            self.settle(&asked, registers, call.context.now().0);
        }
        for bank in 0..2 {
            let pending = registers.get(status(bank)) & (sr1::QW1.mask() | sr1::BSY1.mask()) != 0;
            self.busy.set(bank, pending);
            if !pending {
                for range in std::mem::take(&mut self.running[bank]) {
                    self.unreadable.mend(&range);
                }
            }
        }
        self.show_failures(registers);
    }

    fn reset(&mut self) {
        self.buffers = Default::default();
        self.asked = None;
        // A reset during an operation ends it somewhere in the middle. The emulator's model then leaves the cells as
        // they were.
        self.running = Default::default();
        for bank in 0..2 {
            self.busy.set(bank, false);
        }
    }
}
