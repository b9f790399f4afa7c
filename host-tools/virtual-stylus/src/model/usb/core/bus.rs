//! Events on the bus, the core's answers, and the FIFOs: one for everything received, and one per endpoint for
//! transmission.

use super::state::{Core, Received};
use crate::model::usb::registers::{
    DCTL_GINSTS, DCTL_GONSTS, DIEPINT_ITTXFE, DOEPINT_B2BSTUP, DOEPINT_STUP, EPINT_XFRC, GINTSTS_ENUMDNE,
    GINTSTS_ESUSP, GINTSTS_SOF, GINTSTS_USBRST, GINTSTS_USBSUSP, GINTSTS_WKUPINT, OUT_DATA, OUT_DONE, SETUP_DATA,
    SETUP_DONE,
};
use crate::model::usb::{Handshake, InAnswer, Pid};

const FIFO_OVERRUN: &str = "more words were written to a transmit FIFO than DTXFSTS had room for; they are lost";

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
        // Data words that were not read stay queued; the next status is the status of the next entry.
        let Some(entry) = self.received.pop_front() else {
            return 0;
        };
        self.popped.extend(entry.words);
        // Section 57.15: these interrupts come as the entry is popped, not as the packet arrives.
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
        self.popped.len() as u32 + entries.map(|entry| 1 + entry.words.len() as u32).sum::<u32>()
    }

    pub(super) fn has_room(&self, bytes: usize) -> bool {
        // Besides the data, one word for the packet's status, and one for the status at the transfer's end.
        self.held_words() + bytes.div_ceil(4) as u32 + 2 <= self.receive_words
    }

    pub(super) fn receive(&mut self, endpoint: usize, kind: u32, pid: Pid, data: &[u8]) {
        let odd = if pid == Pid::Data1 { 0b10 } else { 0 };
        let status = endpoint as u32 | (data.len() as u32) << 4 | odd << 15 | kind << 17 | (self.frame & 0xF) << 21;
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

impl Core {
    /// Handles the start of frame `number`.
    pub fn start_of_frame(&mut self, number: u32) {
        self.frame = number & 0x3FFF;
        self.latched |= GINTSTS_SOF;
    }

    /// Suspends the core, after 3 ms of silence.
    pub fn suspend(&mut self) {
        self.suspended = true;
        self.latched |= GINTSTS_ESUSP | GINTSTS_USBSUSP;
    }

    /// Resumes the core.
    pub fn resume(&mut self) {
        if self.suspended {
            self.suspended = false;
            self.latched |= GINTSTS_WKUPINT;
        }
    }

    /// Begins a reset of the bus.
    pub fn bus_reset_begins(&mut self) {
        self.changes += 1;
        if self.suspended {
            self.resume();
        }
        self.latched |= GINTSTS_USBRST;
        self.in_control = false;
        self.setup_stage = false;
        // Section 57.14, OTG_DIEPCTLx.USBAEP: a reset of the bus clears it for all endpoints but endpoint 0.
        for endpoint in self.inputs.iter_mut().chain(&mut self.outputs) {
            endpoint.active = false;
        }
    }

    /// Ends a reset of the bus; the speed is known from then on.
    pub fn bus_reset_ends(&mut self) {
        self.latched |= GINTSTS_ENUMDNE;
    }

    /// Receives a SETUP packet, and acknowledges it if the receive FIFO has space.
    pub fn setup(&mut self, data: [u8; 8]) -> Option<Handshake> {
        self.changes += 1;
        if !self.has_room(data.len()) {
            return None;
        }
        self.receive(0, SETUP_DATA, Pid::Data0, &data);
        if self.setups == 0 {
            self.outputs[0].interrupts |= DOEPINT_B2BSTUP;
        }
        self.setups = self.setups.saturating_sub(1);
        self.setup_stage = true;
        self.in_control = true;
        for endpoint in [&mut self.inputs[0], &mut self.outputs[0]] {
            endpoint.stalled = false;
            endpoint.nak = true;
            // The stages that follow begin with DATA1 (USB 2.0, section 8.5.3).
            endpoint.odd = true;
        }
        Some(Handshake::Ack)
    }

    /// Returns true from a SETUP packet until the next token.
    pub fn in_setup_stage(&self) -> bool {
        self.setup_stage
    }

    /// Ends the setup stage at the first token after a SETUP.
    fn end_setup_stage(&mut self) {
        if std::mem::take(&mut self.setup_stage) {
            self.changes += 1;
            self.receive(0, SETUP_DONE, Pid::Data0, &[]);
        }
    }

    /// Returns the handshake that an OUT packet of `bytes` would receive, or `None` if the device would be silent.
    pub fn answer_out(&self, index: usize, bytes: usize) -> Option<Handshake> {
        let endpoint = self.outputs.get(index)?;
        if index != 0 && !endpoint.active {
            return None;
        }
        Some(if endpoint.stalled {
            Handshake::Stall
        } else if endpoint.nak
            || index == 0 && self.setup_stage
            || self.device_control & DCTL_GONSTS != 0
            || !self.has_room(bytes)
        {
            Handshake::Nak
        } else {
            Handshake::Ack
        })
    }

    /// Receives an intact OUT packet, and returns the handshake, or `None` if the device is silent.
    pub fn out(&mut self, index: usize, pid: Pid, data: &[u8]) -> Option<Handshake> {
        if index == 0 {
            self.end_setup_stage();
        }
        let answer = self.answer_out(index, data.len())?;
        if answer == Handshake::Ack {
            self.changes += 1;
            let endpoint = &mut self.outputs[index];
            // A packet that arrives twice is acknowledged twice, but accepted only once.
            if endpoint.pid() == pid {
                endpoint.odd = !endpoint.odd;
                endpoint.packets = endpoint.packets.saturating_sub(1);
                endpoint.bytes = endpoint.bytes.saturating_sub(data.len() as u32);
                let is_last = endpoint.packets == 0 || data.len() < endpoint.max_packet_bytes(index);
                endpoint.nak |= is_last;
                self.receive(index, OUT_DATA, pid, data);
                if is_last {
                    self.receive(index, OUT_DONE, pid, &[]);
                }
            }
        }
        Some(answer)
    }

    /// Returns the answer that an IN token would receive, or `None` if the device would be silent.
    pub fn answer_in(&self, index: usize) -> Option<InAnswer> {
        let endpoint = self.inputs.get(index)?;
        if index != 0 && !endpoint.active {
            return None;
        }
        if endpoint.stalled {
            return Some(InAnswer::Stall);
        }
        let bytes = (endpoint.bytes as usize).min(endpoint.max_packet_bytes(index));
        let held = &self.transmit[self.fifo_of(index)];
        let refuses = !endpoint.enabled
            || endpoint.nak
            || endpoint.packets == 0
            || index == 0 && self.setup_stage
            || self.device_control & DCTL_GINSTS != 0;
        // A packet leaves only once all of it is in the FIFO.
        if refuses || held.len() < bytes.div_ceil(4) {
            return Some(InAnswer::Nak);
        }
        let mut data: Vec<u8> = (held.iter().take(bytes.div_ceil(4)))
            .flat_map(|word| word.to_le_bytes())
            .collect();
        data.truncate(bytes);
        Some(InAnswer::Data(endpoint.pid(), data))
    }

    /// Receives an IN token, and returns the device's answer, or `None` if the device is silent.
    pub fn token_in(&mut self, index: usize) -> Option<InAnswer> {
        if index == 0 {
            self.end_setup_stage();
        }
        let answer = self.answer_in(index)?;
        if answer == InAnswer::Nak && self.transmit[self.fifo_of(index)].is_empty() {
            self.inputs[index].interrupts |= DIEPINT_ITTXFE;
        }
        Some(answer)
    }

    /// Handles the host's acknowledgement of the packet that answered the last IN token.
    pub fn acknowledged(&mut self, index: usize) {
        let Some(InAnswer::Data(_, data)) = self.answer_in(index) else {
            // The firmware has withdrawn the packet meanwhile.
            return;
        };
        self.changes += 1;
        let fifo = self.fifo_of(index);
        self.transmit[fifo].drain(..data.len().div_ceil(4));
        let endpoint = &mut self.inputs[index];
        endpoint.odd = !endpoint.odd;
        endpoint.packets -= 1;
        endpoint.bytes -= data.len() as u32;
        if endpoint.packets == 0 {
            endpoint.enabled = false;
            endpoint.interrupts |= EPINT_XFRC;
        }
        // The status stage of a request that sends nothing, such as SetAddress.
        if index == 0 && data.is_empty() {
            self.in_control = false;
            self.take_address();
        }
    }
}
