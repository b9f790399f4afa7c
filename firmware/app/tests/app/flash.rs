//! Flash in memory with the manners of the STM32H743's: words of 32 bytes that are programmed once after an erase, sectors
//! of 128 KB, and words that fault when they are read, as after a power cut.

use std::ops::Range;

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use model_format::limits::SLOT_BYTES;
pub use stylus_app::flash::SECTOR_BYTES;
use stylus_app::flash::WORD_BYTES;
use stylus_app::slots::MappedFlash;

/// What is in the flash when power is gone.
#[derive(Clone)]
pub struct Memory {
    bytes: Vec<u8>,
    programmed: Vec<bool>,
    faulty: Vec<bool>,
}

/// What the flash is asked to do, just before it does.
#[derive(Clone, Copy, Debug)]
pub enum Operation {
    Erase { sector: usize },
    Write { word: usize, data: [u8; WORD_BYTES] },
}

/// How far an operation came when power was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Nothing has happened yet.
    Before,
    /// Half way, and every word of it faults when read.
    Faulting,
    /// Half way, and it can be read, but is neither the old nor the new.
    Readable,
    /// All of it has happened.
    After,
}

impl Cut {
    pub const ALL: [Self; 4] = [Self::Before, Self::Faulting, Self::Readable, Self::After];
}

impl Memory {
    pub fn blank(bytes: usize) -> Self {
        Self {
            bytes: vec![0xff; bytes],
            programmed: vec![false; bytes / WORD_BYTES],
            faulty: vec![false; bytes / WORD_BYTES],
        }
    }

    /// Anything but flash that was erased.
    pub fn garbage(bytes: usize) -> Self {
        let mut memory = Self::blank(bytes);
        for (index, byte) in memory.bytes.iter_mut().enumerate() {
            *byte = (index.wrapping_mul(2_654_435_761) >> 13) as u8;
        }
        memory.programmed.fill(true);
        memory
    }

    /// Does `operation` as far as `cut` says.
    pub fn perform(&mut self, operation: Operation, cut: Cut) {
        match operation {
            Operation::Erase { sector } => {
                let words =
                    sector * SECTOR_BYTES / WORD_BYTES..(sector + 1) * SECTOR_BYTES / WORD_BYTES;
                for word in words {
                    self.change(word, [0xff; WORD_BYTES], cut, false);
                }
            }
            Operation::Write { word, data } => self.change(word, data, cut, true),
        }
    }

    fn change(&mut self, word: usize, data: [u8; WORD_BYTES], cut: Cut, programmed: bool) {
        let bytes = &mut self.bytes[word * WORD_BYTES..][..WORD_BYTES];
        match cut {
            Cut::Before => return,
            Cut::After => bytes.copy_from_slice(&data),
            Cut::Faulting | Cut::Readable => {
                // Half of the bits have changed.
                for (index, (byte, new)) in bytes.iter_mut().zip(data).enumerate() {
                    let mask = if (index + word).is_multiple_of(2) {
                        0x5a
                    } else {
                        0xa5
                    };
                    *byte = (*byte & mask) | (new & !mask);
                }
            }
        }
        self.faulty[word] = cut == Cut::Faulting;
        self.programmed[word] = programmed || cut != Cut::After;
    }

    pub fn set_faulty(&mut self, offset: usize) {
        self.faulty[offset / WORD_BYTES] = true;
    }

    pub fn flip_bit(&mut self, offset: usize) {
        self.bytes[offset] ^= 1;
    }
}

/// What goes wrong on purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fault {
    #[default]
    None,
    /// The operation of this number is refused.
    Refuse(usize),
    /// The write of this number is wrong, and nothing tells.
    Corrupt(usize),
}

type Observer<'a> = Box<dyn FnMut(&Memory, Operation) + 'a>;

/// The flash as a driver shows it.
pub struct SimulatedFlash<'a> {
    pub memory: Memory,
    pub fault: Fault,
    pub operations: usize,
    /// A word, by its offset, that can be read so often and no more.
    pub wears_out: Option<(usize, usize)>,
    observer: Option<Observer<'a>>,
}

impl<'a> SimulatedFlash<'a> {
    pub fn new(memory: Memory) -> Self {
        Self {
            memory,
            fault: Fault::None,
            operations: 0,
            wears_out: None,
            observer: None,
        }
    }

    /// Calls `observer` before each operation.
    pub fn observed(memory: Memory, observer: impl FnMut(&Memory, Operation) + 'a) -> Self {
        Self {
            observer: Some(Box::new(observer)),
            ..Self::new(memory)
        }
    }

    pub fn two_slots() -> Self {
        Self::new(Memory::blank(2 * SLOT_BYTES))
    }

    fn operate(&mut self, operation: Operation) -> Result<(), SimulatedError> {
        if let Some(observer) = &mut self.observer {
            observer(&self.memory, operation);
        }
        let number = self.operations;
        self.operations += 1;
        if self.fault == Fault::Refuse(number) {
            self.memory.perform(operation, Cut::Faulting);
            return Err(SimulatedError::Refused);
        }
        self.memory.perform(operation, Cut::After);
        if let (Fault::Corrupt(at), Operation::Write { word, .. }) = (self.fault, operation)
            && at == number
        {
            self.memory.flip_bit(word * WORD_BYTES + 5);
        }
        Ok(())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimulatedError {
    Bounds,
    Aligned,
    NotErased,
    Ecc,
    Refused,
}

impl NorFlashError for SimulatedError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Bounds => NorFlashErrorKind::OutOfBounds,
            Self::Aligned => NorFlashErrorKind::NotAligned,
            Self::NotErased | Self::Ecc | Self::Refused => NorFlashErrorKind::Other,
        }
    }
}

impl ErrorType for SimulatedFlash<'_> {
    type Error = SimulatedError;
}

impl ReadNorFlash for SimulatedFlash<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), SimulatedError> {
        let from = offset as usize;
        let to = from + bytes.len();
        let source = self
            .memory
            .bytes
            .get(from..to)
            .ok_or(SimulatedError::Bounds)?;
        let words = from / WORD_BYTES..to.div_ceil(WORD_BYTES);
        if self.memory.faulty[words].contains(&true) {
            return Err(SimulatedError::Ecc);
        }
        bytes.copy_from_slice(source);
        if let Some((offset, left)) = self.wears_out
            && (from..to).contains(&offset)
        {
            let Some(left) = left.checked_sub(1) else {
                self.memory.set_faulty(offset);
                return Err(SimulatedError::Ecc);
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
            return Err(SimulatedError::Aligned);
        }
        if to > self.memory.bytes.len() {
            return Err(SimulatedError::Bounds);
        }
        for sector in from / SECTOR_BYTES..to / SECTOR_BYTES {
            self.operate(Operation::Erase { sector })?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), SimulatedError> {
        let first = offset as usize / WORD_BYTES;
        let (words, rest) = bytes.as_chunks::<WORD_BYTES>();
        if !(offset as usize).is_multiple_of(WORD_BYTES) || !rest.is_empty() {
            return Err(SimulatedError::Aligned);
        }
        for (index, &data) in words.iter().enumerate() {
            let word = first + index;
            match self.memory.programmed.get(word) {
                None => return Err(SimulatedError::Bounds),
                Some(true) => return Err(SimulatedError::NotErased),
                Some(false) => self.operate(Operation::Write { word, data })?,
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
        self.memory.bytes.get(range).ok_or(SimulatedError::Bounds)
    }
}
