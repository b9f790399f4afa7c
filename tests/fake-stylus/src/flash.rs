//! Flash in memory that behaves like the STM32H743's: a word of 32 bytes can be programmed once per erase, a sector has
//! 128 KB, and words can fault when read, as after a power cut.
//!
//! Every erase of a sector and every write of a word yields once before it is done, because the image's driver waits
//! there too. Other tasks of the device run in between. Durations are not simulated.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::future::pending;
use std::ops::Range;
use std::rc::Rc;

use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use model_format::limits::SLOT_BYTES;
pub use stylus_app::flash::SECTOR_BYTES;
use stylus_app::flash::WORD_BYTES;
use stylus_app::slots::MappedFlash;
use stylus_plant::chance::Chance;

/// Content of the flash, which survives a loss of power.
#[derive(Clone)]
pub struct Memory {
    bytes: Vec<u8>,
    programmed: Vec<bool>,
    faulty: Vec<bool>,
    /// Words whose content changes from read to read, with their content before and after the operation that was cut.
    unstable: BTreeMap<usize, [[u8; WORD_BYTES]; 2]>,
    /// Words that fault in some of their reads, with the number of faults per thousand reads. Words behave like this if
    /// their programming was cut at its very end.
    marginal: BTreeMap<usize, u64>,
    /// A sector in which every operation meets a mishap.
    worn: Option<(usize, Mishap)>,
    /// Decides how unstable and marginal words read.
    chance: Chance,
}

/// An operation on the flash.
#[derive(Clone, Copy, Debug)]
pub enum Operation {
    /// Sets all bits of a sector to one.
    Erase {
        /// Number of the sector.
        sector: usize,
    },
    /// Programs a word.
    Write {
        /// Number of the word.
        word: usize,
        /// New content of the word.
        data: [u8; WORD_BYTES],
    },
}

/// Progress of an operation at the moment when power is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Nothing has happened yet.
    Before,
    /// Half of the operation has happened, and every word that it covers faults when read.
    Faulting,
    /// Half of the operation has happened. Its words can be read, but hold neither the old nor the new content.
    Readable,
    /// Half of the operation has happened. A read of a word returns the old content, the new content, a mixture, or a
    /// fault.
    Unstable,
    /// All of the operation has happened.
    After,
    /// Runs of words, of random lengths, are each left in one of the other states at random, because silicon need not
    /// erase all words of a sector alike.
    Mixed,
}

impl Cut {
    /// Cuts after which every read of a word has the same result.
    pub const ALL: [Self; 4] = [Self::Before, Self::Faulting, Self::Readable, Self::After];

    /// All cuts but [`Cut::Mixed`].
    pub const WITH_UNSTABLE: [Self; 5] = [
        Self::Before,
        Self::Faulting,
        Self::Readable,
        Self::Unstable,
        Self::After,
    ];

    /// All cuts.
    pub const EVERY: [Self; 6] = [
        Self::Before,
        Self::Faulting,
        Self::Readable,
        Self::Unstable,
        Self::After,
        Self::Mixed,
    ];
}

impl Memory {
    /// Creates erased flash of `bytes` bytes.
    pub fn blank(bytes: usize) -> Self {
        Self {
            bytes: vec![0xff; bytes],
            programmed: vec![false; bytes / WORD_BYTES],
            faulty: vec![false; bytes / WORD_BYTES],
            unstable: BTreeMap::new(),
            marginal: BTreeMap::new(),
            worn: None,
            chance: Chance(1),
        }
    }

    /// Returns this bank followed by `next`. No word of `next` may be unstable or marginal.
    #[must_use]
    pub fn joined(mut self, next: Self) -> Self {
        assert!(next.unstable.is_empty() && next.marginal.is_empty());
        self.bytes.extend(next.bytes);
        self.programmed.extend(next.programmed);
        self.faulty.extend(next.faulty);
        self
    }

    /// Removes the bank from `offset` on and returns it. None of its words may be unstable or marginal.
    #[must_use]
    pub fn split_off(&mut self, offset: usize) -> Self {
        let word = offset / WORD_BYTES;
        let changing = [
            self.unstable.last_key_value().map(|(&word, _)| word),
            self.marginal.last_key_value().map(|(&word, _)| word),
        ];
        assert!(changing.into_iter().flatten().all(|at| at < word));
        Self {
            bytes: self.bytes.split_off(offset),
            programmed: self.programmed.split_off(word),
            faulty: self.faulty.split_off(word),
            ..Self::blank(0)
        }
    }

    /// The content.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Creates programmed flash of `bytes` bytes with arbitrary content.
    pub fn garbage(bytes: usize) -> Self {
        let mut memory = Self::blank(bytes);
        for (index, byte) in memory.bytes.iter_mut().enumerate() {
            *byte = (index.wrapping_mul(2_654_435_761) >> 13) as u8;
        }
        memory.programmed.fill(true);
        memory
    }

    /// Performs `operation` as far as `cut` allows.
    pub fn perform(&mut self, operation: Operation, cut: Cut) {
        match operation {
            Operation::Erase { sector } => {
                let words = sector * SECTOR_BYTES / WORD_BYTES..(sector + 1) * SECTOR_BYTES / WORD_BYTES;
                let (mut manner, mut run) = (cut, 0);
                for word in words {
                    if run == 0 {
                        (manner, run) = (self.drawn(cut), 1 << self.chance.below(13));
                    }
                    run -= 1;
                    self.change(word, [0xff; WORD_BYTES], manner, false);
                }
            }
            Operation::Write { word, data } => {
                let manner = self.drawn(cut);
                self.change(word, data, manner, true);
            }
        }
    }

    /// Returns the state in which `cut` leaves a word or a run of words.
    fn drawn(&mut self, cut: Cut) -> Cut {
        match cut {
            Cut::Mixed => Cut::WITH_UNSTABLE[self.chance.below(5) as usize],
            _ => cut,
        }
    }

    /// Programs `bytes` at `offset`, a multiple of the word's size. If the last word is incomplete, ones fill it.
    pub fn program(&mut self, offset: usize, bytes: &[u8]) {
        for (word, piece) in (offset / WORD_BYTES..).zip(bytes.chunks(WORD_BYTES)) {
            let mut data = [0xff; WORD_BYTES];
            data[..piece.len()].copy_from_slice(piece);
            self.change(word, data, Cut::After, true);
        }
    }

    fn change(&mut self, word: usize, data: [u8; WORD_BYTES], cut: Cut, programmed: bool) {
        // For a mixture, the caller has already chosen the state of each word.
        if matches!(cut, Cut::Before | Cut::Mixed) {
            return;
        }
        self.unstable.remove(&word);
        self.marginal.remove(&word);
        let bytes = &mut self.bytes[word * WORD_BYTES..][..WORD_BYTES];
        match cut {
            Cut::Before | Cut::Mixed => {}
            Cut::After => bytes.copy_from_slice(&data),
            Cut::Faulting | Cut::Readable | Cut::Unstable => {
                if cut == Cut::Unstable {
                    let old = bytes.first_chunk().expect("it is a word");
                    self.unstable.insert(word, [*old, data]);
                }
                // Half of the bits have changed.
                for (index, (byte, new)) in bytes.iter_mut().zip(data).enumerate() {
                    // Each mask has four bits of a byte, and the next byte has the other four.
                    let mask = if (index + word).is_multiple_of(2) { 0x5a } else { 0xa5 };
                    *byte = (*byte & mask) | (new & !mask);
                }
            }
        }
        self.faulty[word] = cut == Cut::Faulting;
        self.programmed[word] = programmed || cut != Cut::After;
    }

    /// Makes the word at `offset` fault when read.
    pub fn set_faulty(&mut self, offset: usize) {
        self.faulty[offset / WORD_BYTES] = true;
    }

    /// Makes the word at `offset` unstable: each read returns its content, another content, or a fault.
    pub fn set_unstable(&mut self, offset: usize) {
        let word = offset / WORD_BYTES;
        let bytes = self.bytes[word * WORD_BYTES..].first_chunk();
        let content = *bytes.expect("it is in the flash");
        self.unstable.insert(word, [content, content.map(|byte| byte ^ 0x10)]);
    }

    /// Makes the word number `word` fault in `per_mille` of a thousand reads.
    pub fn set_marginal(&mut self, word: usize, per_mille: u64) {
        self.marginal.insert(word, per_mille);
    }

    /// Makes every operation in the sector of `worn` meet its mishap from now on.
    pub fn wear(&mut self, worn: Option<(usize, Mishap)>) {
        self.worn = worn;
    }

    /// Seeds the random numbers that decide how unstable and marginal words read.
    pub fn seed(&mut self, seed: u64) {
        self.chance = Chance(seed);
    }

    /// Returns the content of `word` for this read; `None` if the word faults.
    fn read_word(&mut self, word: usize) -> Option<[u8; WORD_BYTES]> {
        let share = self.marginal.get(&word).copied();
        if self.faulty[word] || share.is_some_and(|share| self.chance.below(1000) < share) {
            return None;
        }
        let stable = *self.bytes[word * WORD_BYTES..].first_chunk()?;
        let Some([old, new]) = self.unstable.get(&word).copied() else {
            return Some(stable);
        };
        match self.chance.below(4) {
            0 => None,
            1 => Some(old),
            2 => Some(new),
            _ => Some(stable),
        }
    }

    /// Damages the word at `offset`.
    pub fn damage(&mut self, offset: usize, damage: Damage) {
        match damage {
            Damage::Faulting => self.set_faulty(offset),
            Damage::Flipped => self.flip_bit(offset),
            Damage::Unstable => self.set_unstable(offset),
        }
    }

    /// Returns true if a word of `range` always faults or is unstable. Marginal words do not count.
    pub fn is_damaged(&self, range: Range<usize>) -> bool {
        let words = range.start / WORD_BYTES..range.end.div_ceil(WORD_BYTES);
        self.faulty[words.clone()].contains(&true) || self.unstable.range(words).next().is_some()
    }

    /// Returns the number of the last word of `range` that is not erased; `None` if all are.
    pub fn last_programmed(&self, range: Range<usize>) -> Option<usize> {
        let words = range.start / WORD_BYTES..range.end / WORD_BYTES;
        words.rev().find(|&word| self.programmed[word])
    }

    /// Flips a bit of the byte at `offset`.
    pub fn flip_bit(&mut self, offset: usize) {
        self.bytes[offset] ^= 1;
    }
}

/// Damage that a word suffers after it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// Each read faults.
    Faulting,
    /// A bit is wrong, and the flash's error correction does not detect it.
    Flipped,
    /// Each read returns the content, another content, or a fault.
    Unstable,
}

impl Damage {
    /// All kinds of damage.
    pub const ALL: [Self; 3] = [Self::Faulting, Self::Flipped, Self::Unstable];
}

/// How an operation ends if a test has asked for a mishap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mishap {
    /// Power is lost, and nothing happens after that.
    Cut(Cut),
    /// The operation changes nothing and reports the failure.
    Protect,
    /// The operation fails halfway and reports the failure.
    Refuse,
    /// This operation and every later one fail halfway and report the failure.
    RefuseFrom,
    /// A write has a wrong bit and reports success. An erase is done as it should be.
    Corrupt,
}

#[derive(Default)]
struct ToCome {
    /// Number of operations before the mishap, and the mishap itself.
    mishap: Cell<Option<(usize, Mishap)>>,
    damage: RefCell<Vec<(usize, Damage)>>,
    is_off: Cell<bool>,
}

/// Handle by which a test causes mishaps in a flash that a device owns.
#[derive(Clone, Default)]
pub struct Fate(Rc<ToCome>);

impl Fate {
    /// Makes `mishap` happen to the operation after the next `operations` ones.
    pub fn strike(&self, operations: usize, mishap: Mishap) {
        self.0.mishap.set(Some((operations, mishap)));
    }

    /// Cancels the mishap of [`Fate::strike`] if it has not happened yet.
    pub fn spare(&self) {
        self.0.mishap.set(None);
    }

    /// Damages the word at `offset` before the next read or operation.
    pub fn damage(&self, offset: usize, damage: Damage) {
        self.0.damage.borrow_mut().push((offset, damage));
    }

    /// Returns true once power was lost. The device does nothing after that.
    pub fn is_off(&self) -> bool {
        self.0.is_off.get()
    }

    fn next(&self) -> Option<Mishap> {
        let (before, mishap) = self.0.mishap.get()?;
        let Some(fewer) = before.checked_sub(1) else {
            let goes_on = mishap == Mishap::RefuseFrom;
            self.0.mishap.set(goes_on.then_some((0, mishap)));
            return Some(mishap);
        };
        self.0.mishap.set(Some((fewer, mishap)));
        None
    }

    fn age(&self, memory: &mut Memory) {
        for (offset, damage) in self.0.damage.take() {
            memory.damage(offset, damage);
        }
    }
}

type Observer<'a> = Box<dyn FnMut(&Memory, Operation) + 'a>;

/// A driver of flash in memory.
pub struct SimulatedFlash<'a> {
    /// The content.
    pub memory: Memory,
    /// Number of operations so far.
    pub operations: usize,
    /// Offset of a byte, and the number of reads that reach it before its word faults for good.
    pub wears_out: Option<(usize, usize)>,
    /// Offset of a byte, and the number of the next reads that reach it and fault; later reads succeed.
    pub recovers: Option<(usize, usize)>,
    /// Number of reads so far.
    pub reads: usize,
    /// Mishaps that the test has asked for.
    pub fate: Fate,
    observer: Option<Observer<'a>>,
}

impl<'a> SimulatedFlash<'a> {
    /// Creates a driver of `memory`, without mishaps.
    pub fn new(memory: Memory) -> Self {
        Self {
            memory,
            operations: 0,
            wears_out: None,
            recovers: None,
            reads: 0,
            fate: Fate::default(),
            observer: None,
        }
    }

    /// Creates a driver of `memory` that calls `observer` before each operation.
    pub fn observed(memory: Memory, observer: impl FnMut(&Memory, Operation) + 'a) -> Self {
        Self {
            observer: Some(Box::new(observer)),
            ..Self::new(memory)
        }
    }

    /// Creates blank flash for both slots of libraries.
    pub fn two_slots() -> Self {
        Self::new(Memory::blank(2 * SLOT_BYTES))
    }

    async fn operate(&mut self, operation: Operation) -> Result<(), SimulatedError> {
        yield_now().await;
        if let Some(observer) = &mut self.observer {
            observer(&self.memory, operation);
        }
        self.fate.age(&mut self.memory);
        self.operations += 1;
        let sector = match operation {
            Operation::Erase { sector } => sector,
            Operation::Write { word, .. } => word * WORD_BYTES / SECTOR_BYTES,
        };
        let worn = self.memory.worn.filter(|(worn, _)| *worn == sector);
        match self.fate.next().or(worn.map(|(_, mishap)| mishap)) {
            Some(Mishap::Protect) => return Err(SimulatedError("the sector is protected")),
            Some(Mishap::Cut(cut)) => {
                self.memory.perform(operation, cut);
                self.fate.0.is_off.set(true);
                // Without power nothing goes on, so the caller never learns of the operation.
                return pending().await;
            }
            Some(Mishap::Refuse | Mishap::RefuseFrom) => {
                self.memory.perform(operation, Cut::Faulting);
                return Err(SimulatedError("the operation failed"));
            }
            Some(Mishap::Corrupt) => {
                self.memory.perform(operation, Cut::After);
                if let Operation::Write { word, .. } = operation {
                    self.memory.flip_bit(word * WORD_BYTES + 5);
                }
            }
            None => self.memory.perform(operation, Cut::After),
        }
        Ok(())
    }
}

/// An error of the driver, with its reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimulatedError(&'static str);

const BOUNDS: SimulatedError = SimulatedError("the place is outside of the flash");
const ALIGNED: SimulatedError = SimulatedError("the place is not of whole words or sectors");
const NOT_ERASED: SimulatedError = SimulatedError("the word was programmed since its last erase");
const ECC: SimulatedError = SimulatedError("a word that was read faults");

impl NorFlashError for SimulatedError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for SimulatedFlash<'_> {
    type Error = SimulatedError;
}

impl ReadNorFlash for SimulatedFlash<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), SimulatedError> {
        self.reads += 1;
        self.fate.age(&mut self.memory);
        let from = offset as usize;
        let to = from + bytes.len();
        if to > self.memory.bytes.len() {
            return Err(BOUNDS);
        }
        for word in from / WORD_BYTES..to.div_ceil(WORD_BYTES) {
            let content = self.memory.read_word(word).ok_or(ECC)?;
            let first = word * WORD_BYTES;
            let part = from.max(first)..to.min(first + WORD_BYTES);
            bytes[part.start - from..part.end - from].copy_from_slice(&content[part.start - first..part.end - first]);
        }
        if let Some((offset, left)) = self.recovers
            && (from..to).contains(&offset)
            && let Some(fewer) = left.checked_sub(1)
        {
            self.recovers = Some((offset, fewer));
            return Err(ECC);
        }
        if let Some((offset, left)) = self.wears_out
            && (from..to).contains(&offset)
        {
            // Later reads fault by themselves.
            let Some(left) = left.checked_sub(1) else {
                self.memory.set_faulty(offset);
                return Err(ECC);
            };
            self.wears_out = Some((offset, left));
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.memory.bytes.len()
    }
}

impl NorFlash for SimulatedFlash<'_> {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), SimulatedError> {
        let (from, to) = (from as usize, to as usize);
        if !from.is_multiple_of(SECTOR_BYTES) || !to.is_multiple_of(SECTOR_BYTES) {
            return Err(ALIGNED);
        }
        if to > self.memory.bytes.len() {
            return Err(BOUNDS);
        }
        for sector in from / SECTOR_BYTES..to / SECTOR_BYTES {
            self.operate(Operation::Erase { sector }).await?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), SimulatedError> {
        let first = offset as usize / WORD_BYTES;
        let (words, rest) = bytes.as_chunks::<WORD_BYTES>();
        if !(offset as usize).is_multiple_of(WORD_BYTES) || !rest.is_empty() {
            return Err(ALIGNED);
        }
        for (index, &data) in words.iter().enumerate() {
            let word = first + index;
            match self.memory.programmed.get(word) {
                None => return Err(BOUNDS),
                Some(true) => return Err(NOT_ERASED),
                Some(false) => self.operate(Operation::Write { word, data }).await?,
            }
        }
        Ok(())
    }
}

impl MappedFlash for SimulatedFlash<'_> {
    fn bytes(&self, range: Range<u32>) -> Result<&[u8], SimulatedError> {
        let range = range.start as usize..range.end as usize;
        let words = range.start / WORD_BYTES..range.end.div_ceil(WORD_BYTES);
        // On the processor this would be a bus fault.
        assert!(
            !self.memory.faulty[words].contains(&true),
            "a word that faults was read where it lies"
        );
        self.memory.bytes.get(range).ok_or(BOUNDS)
    }
}
