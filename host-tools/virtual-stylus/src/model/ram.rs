//! RAM that may not be written yet after a reset, and the RAM's error-correcting codes, which do not fit the noise that
//! it holds after power-on.
//!
//! Until `ACTVOSRDY` of `PWR_CSR1` is set after a reset, RAM may not be written (RM0433 section 6.4.1). Here a store of
//! the core changes nothing until the core has read that bit as set. The emulator's model of PWR sets the bit some time
//! after the first write of `PWR_CR3` since power-on, and some time after each later reset.
//!
//! A code covers 64 bits in ITCM and AXI SRAM, and 32 bits elsewhere. A read of bits that were never written is an
//! error, which RAMECC notes. A store to only some of a code's bits is an error too, because it reads the others
//! (RM0433 chapter 3).
//!
//! Left out: errors that noise happens to hide, fetches of instructions, reads ahead, fills of cache lines, DMA.

use std::collections::{BTreeSet, HashMap};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::emulator::{Access, AccessKind};
use rigless::soc::stm32h743::generated::pwr::csr1;

/// Memories with error-correcting codes, and the number of bytes that one code covers (RM0433 sections 2.4 and 3.2).
const MEMORIES: [(Range<u64>, u64); 5] = [
    (0..0x1_0000, 8),
    (0x2000_0000..0x2002_0000, 4),
    (0x2400_0000..0x2408_0000, 8),
    (0x3000_0000..0x3004_8000, 4),
    (0x3800_0000..0x3801_0000, 4),
];

/// The RAM. The core and its observers share it. Until [`Ram::power_on`] is called, all codes fit.
#[derive(Clone, Debug, Default)]
pub struct Ram(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    /// Pages that hold words whose code does not fit. For each page: whether each of its words was written, and the
    /// number of words that were not.
    pages: HashMap<u64, (Vec<bool>, usize)>,
    /// Length of a page, bytes: 0 before [`Ram::power_on`], and `u64::MAX` from then until the core has told it.
    page_bytes: u64,
    /// A word of which one instruction has written only some bytes so far.
    part: Option<Part>,
    errors: BTreeSet<u64>,
    is_writable: bool,
    /// Addresses of stores that were refused because they came too early.
    refused: BTreeSet<u64>,
    changes: u64,
}

/// The bytes of a word that one instruction has written, a bit per byte.
#[derive(Clone, Copy, Debug)]
struct Part {
    word: u64,
    instruction: u64,
    bytes: u8,
}

impl Ram {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes all codes invalid, as the noise after power-on does.
    pub fn power_on(&self) {
        self.state().page_bytes = u64::MAX;
    }

    /// Handles a reset, after which RAM may not be written.
    pub fn reset(&self) {
        self.state().is_writable = false;
    }

    /// Follows a read of `PWR_CSR1` by the core, which returned `value`.
    pub fn power_status(&self, value: u64) {
        let mut state = self.state();
        if csr1::ACTVOSRDY.is_set(value) && !state.is_writable {
            state.is_writable = true;
            state.changes += 1;
        }
    }

    /// Addresses of stores that were refused.
    pub fn refused(&self) -> Vec<u64> {
        self.state().refused.iter().copied().collect()
    }

    /// Addresses of the pages, of `page_bytes` bytes, whose accesses must be passed to [`Ram::takes`]: all of RAM until
    /// it may be written, then those with a word that was not written.
    pub fn pages(&self, page_bytes: u64) -> Vec<u64> {
        let mut state = self.state();
        if !state.is_writable {
            return MEMORIES
                .into_iter()
                .map(|(memory, _)| memory)
                .flat_map(|memory| memory.step_by(page_bytes as usize))
                .collect();
        }
        if state.page_bytes == u64::MAX {
            state.page_bytes = page_bytes;
            for (memory, word_bytes) in MEMORIES {
                for page in memory.step_by(page_bytes as usize) {
                    let words = (page_bytes / word_bytes) as usize;
                    state.pages.insert(page, (vec![false; words], words));
                }
            }
        }
        state.pages.keys().copied().collect()
    }

    /// Number of changes of the pages. A caller compares it with an earlier number to notice a change.
    pub fn changes(&self) -> u64 {
        self.state().changes
    }

    /// Addresses of words that were read, or written in part, before they were written.
    pub fn errors(&self) -> Vec<u64> {
        self.state().errors.iter().copied().collect()
    }

    /// Follows an access of an instruction. Returns false if the access is a store that is refused.
    pub fn takes(&self, access: &Access) -> bool {
        let within = |(memory, _): &(Range<u64>, u64)| memory.contains(&access.address);
        let Some(word_bytes) = MEMORIES.iter().find(|memory| within(memory)).map(|found| found.1) else {
            return true;
        };
        let mut state = self.state();
        if access.kind == AccessKind::Write && !state.is_writable {
            state.refused.insert(access.address);
            return false;
        }
        state.follow(access, word_bytes);
        true
    }
}

impl State {
    fn follow(&mut self, access: &Access, word_bytes: u64) {
        let word = access.address - access.address % word_bytes;
        let (page, index) = self.place(word, word_bytes);
        let is_written = (self.pages.get(&page)).is_none_or(|(written, _)| written[index]);
        if is_written {
            return;
        }
        // Two stores to the same word by one instruction count as one store of 64 bits.
        let part = self.part.take();
        // A part that was not completed by its own instruction is an error, even if a later store completes the word.
        let earlier = part.filter(|part| part.word == word && part.instruction == access.instruction_count);
        if let (Some(part), None) = (part, earlier) {
            self.errors.insert(part.word);
        }
        if access.kind == AccessKind::Read {
            self.errors.insert(word);
            self.write(page, index);
            return;
        }
        let first = access.address % word_bytes;
        let count = u64::from(access.width.bytes()).min(word_bytes - first);
        let bytes = earlier.map_or(0, |part| part.bytes) | (((1u16 << count) - 1) << first) as u8;
        if u64::from(bytes.count_ones()) == word_bytes {
            self.write(page, index);
        } else {
            let instruction = access.instruction_count;
            self.part = Some(Part {
                word,
                instruction,
                bytes,
            });
        }
    }

    fn place(&self, word: u64, word_bytes: u64) -> (u64, usize) {
        let page = word - word % self.page_bytes.max(1);
        (page, ((word - page) / word_bytes) as usize)
    }

    /// Notes that a word's code fits. This is also done after an error, so that each error is reported only once.
    fn write(&mut self, page: u64, index: usize) {
        if let Some((written, left)) = self.pages.get_mut(&page) {
            written[index] = true;
            *left -= 1;
            if *left == 0 {
                self.pages.remove(&page);
                self.changes += 1;
            }
        }
    }
}
