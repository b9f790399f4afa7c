//! The FIFOs: one for everything received, and one per endpoint for transmission.

use super::state::{Core, Received};
use crate::model::usb::packets::Pid;
use crate::model::usb::registers::{DOEPINT_STUP, EPINT_XFRC, OUT_DONE, SETUP_DONE};

const FIFO_OVERRUN: &str =
    "more words were written to a transmit FIFO than DTXFSTS had room for; they are lost";

impl Core {
    pub(super) fn free_words(&self, fifo: usize) -> u32 {
        (self.transmit_sizes[fifo] >> 16).saturating_sub(self.transmit[fifo].len() as u32)
    }

    pub(super) fn push(&mut self, index: usize, word: u32) {
        let fifo = self.fifo_of(index);
        if self.free_words(fifo) == 0 {
            self.told.push(("DFIFO", FIFO_OVERRUN));
            return;
        }
        self.transmit[fifo].push_back(word);
    }

    pub(super) fn pop_status(&mut self) -> u32 {
        self.changes += 1;
        // Data words that were not read stay queued; the next status is that of the next entry.
        let Some(entry) = self.received.pop_front() else {
            return 0;
        };
        self.popped.extend(entry.words);
        let endpoint = &mut self.outputs[entry.endpoint];
        match entry.kind {
            OUT_DONE => {
                endpoint.interrupts |= EPINT_XFRC;
                endpoint.enabled = false;
            }
            SETUP_DONE => {
                endpoint.interrupts |= DOEPINT_STUP;
                endpoint.enabled = false;
            }
            _ => {}
        }
        entry.status
    }

    pub(super) fn held_words(&self) -> u32 {
        let entries = self.received.iter();
        self.popped.len() as u32
            + entries
                .map(|entry| 1 + entry.words.len() as u32)
                .sum::<u32>()
    }

    pub(super) fn has_room(&self, bytes: usize) -> bool {
        // One word for its status, and one for the status of the transfer's end.
        self.held_words() + bytes.div_ceil(4) as u32 + 2 <= self.receive_words
    }

    pub(super) fn receive(&mut self, endpoint: usize, kind: u32, pid: Pid, data: &[u8]) {
        let odd = if pid == Pid::Data1 { 0b10 } else { 0 };
        let status = endpoint as u32
            | (data.len() as u32) << 4
            | odd << 15
            | kind << 17
            | (self.frame & 0xF) << 21;
        let words = data.chunks(4).map(|chunk| {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            u32::from_le_bytes(word)
        });
        self.received.push_back(Received {
            status,
            endpoint,
            kind,
            words: words.collect(),
        });
    }
}
