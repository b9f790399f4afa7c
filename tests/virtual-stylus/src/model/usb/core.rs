//! The core itself: registers, FIFOs and endpoints, without a bus and without time. The bus calls it with what came over the
//! wire, and gets the handshake.

use std::collections::VecDeque;

use super::registers::{
    ALL_FIFOS, CID, CTL, DAINT, DAINTMSK, DCFG, DCTL, DCTL_CGINAK, DCTL_CGONAK, DCTL_GINSTS,
    DCTL_GONSTS, DCTL_SDIS, DCTL_SGINAK, DCTL_SGONAK, DIEP0, DIEPEMPMSK, DIEPINT_INEPNE,
    DIEPINT_ITTXFE, DIEPINT_TXFE, DIEPMSK, DIEPTXF0, DIEPTXF1, DOEP0, DOEPINT_B2BSTUP,
    DOEPINT_STUP, DOEPMSK, DSTS, DSTS_FULL_SPEED, DSTS_SUSPSTS, ENDPOINT_STEP, ENDPOINTS,
    EPCTL_CNAK, EPCTL_DPID, EPCTL_EPDIS, EPCTL_EPENA, EPCTL_KEPT, EPCTL_NAKSTS, EPCTL_SD0PID,
    EPCTL_SD1PID, EPCTL_SNAK, EPCTL_STALL, EPCTL_USBAEP, EPINT_EPDISD, EPINT_XFRC, FIFO_STEP,
    FIFO0, GAHBCFG, GAHBCFG_DMAEN, GAHBCFG_GINTMSK, GAHBCFG_TXFELVL, GCCFG, GCCFG_PWRDWN,
    GCCFG_VBDEN, GINTMSK, GINTSTS, GINTSTS_CIDSCHG, GINTSTS_CMOD, GINTSTS_ENUMDNE, GINTSTS_ESUSP,
    GINTSTS_GINAKEFF, GINTSTS_GONAKEFF, GINTSTS_IEPINT, GINTSTS_LATCHED, GINTSTS_NPTXFE,
    GINTSTS_OEPINT, GINTSTS_OTGINT, GINTSTS_PTXFE, GINTSTS_RXFLVL, GINTSTS_SOF, GINTSTS_USBRST,
    GINTSTS_USBSUSP, GINTSTS_WKUPINT, GOTGCTL, GOTGCTL_BSVLD, GOTGCTL_BVALOEN, GOTGCTL_BVALOVAL,
    GOTGINT, GRSTCTL, GRSTCTL_AHBIDL, GRSTCTL_CSRST, GRSTCTL_RXFFLSH, GRSTCTL_TXFFLSH, GRXFSIZ,
    GRXSTSP, GRXSTSR, GUSBCFG, GUSBCFG_FHMOD, INT, OUT_DATA, OUT_DONE, PCGCCTL, SETUP_DATA,
    SETUP_DONE, TSIZ, TSIZ_BYTES, TSIZ_PACKETS, TSIZ_PACKETS_SHIFT, TSIZ_SETUPS_SHIFT, TXFSTS, bit,
};

/// `CID` of this part's cores (section 57.14, OTG_CID).
const CORE_ID: u32 = 0x2300;
/// Words of the FIFO RAM: 4 Kbytes.
const FIFO_WORDS: u32 = 1024;

const DMA: &str =
    "RM0433 57.14, OTG_GAHBCFG: DMAEN is not modelled, the FIFOs are the core's to fill and empty";
const HOST_MODE: &str = "RM0433 57.14, OTG_GUSBCFG: FHMOD is not modelled, the core is a device";
const OUT_DISABLED: &str = "RM0433 57.14, OTG_DOEPCTLx: EPDIS without the global OUT NAK, which the manual asks for first; taken at once";
const FIFO_OVERRUN: &str =
    "more words were written to a transmit FIFO than DTXFSTS had room for; they are lost";
const FIFO_UNDERRUN: &str = "the receive FIFO was read without data; the read answers zero";
const FIFO_LAYOUT: &str = "the FIFOs do not fit the FIFO RAM of 4 Kbytes";

/// The data packet's identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pid {
    /// An even packet.
    Data0,
    /// An odd packet.
    Data1,
}

impl Pid {
    /// The one that follows.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::Data0 => Self::Data1,
            Self::Data1 => Self::Data0,
        }
    }
}

/// What a device answers with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handshake {
    /// Taken.
    Ack,
    /// Not now.
    Nak,
    /// Not like this.
    Stall,
}

/// What a device answers an IN token with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum InAnswer {
    /// A data packet, which awaits its handshake.
    Data(Pid, Vec<u8>),
    /// Not now.
    Nak,
    /// Not like this.
    Stall,
}

/// An entry of the receive FIFO: its status word, and the data words behind it.
#[derive(Clone, Debug)]
struct Received {
    status: u32,
    endpoint: usize,
    kind: u32,
    words: VecDeque<u32>,
}

#[derive(Clone, Copy, Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a bit of the register"
)]
struct Endpoint {
    kept: u32,
    active: bool,
    nak: bool,
    stalled: bool,
    enabled: bool,
    odd: bool,
    bytes: u32,
    packets: u32,
    interrupts: u32,
}

impl Endpoint {
    fn pid(&self) -> Pid {
        if self.odd { Pid::Data1 } else { Pid::Data0 }
    }

    fn control(&self, index: usize) -> u32 {
        let flag = |on: bool, bit: u32| if on { bit } else { 0 };
        self.kept
            | flag(self.active || index == 0, EPCTL_USBAEP)
            | flag(self.odd && index != 0, EPCTL_DPID)
            | flag(self.nak, EPCTL_NAKSTS)
            | flag(self.stalled, EPCTL_STALL)
            | flag(self.enabled, EPCTL_EPENA)
    }

    fn size(&self) -> u32 {
        self.bytes | self.packets << TSIZ_PACKETS_SHIFT
    }

    fn max_packet_bytes(&self, index: usize) -> usize {
        if index == 0 {
            64 >> (self.kept & 3)
        } else {
            (self.kept & 0x7FF) as usize
        }
    }

    /// The bits that mean the same for both directions.
    fn write_control(&mut self, index: usize, value: u32) {
        self.kept = value & EPCTL_KEPT;
        self.active = value & EPCTL_USBAEP != 0;
        // Of a control endpoint the core alone ends a stall, when a SETUP comes.
        self.stalled = value & EPCTL_STALL != 0 || index == 0 && self.stalled;
        if value & EPCTL_CNAK != 0 {
            self.nak = false;
        }
        if value & EPCTL_SNAK != 0 {
            self.nak = true;
        }
        if index != 0 && value & EPCTL_SD0PID != 0 {
            self.odd = false;
        }
        if index != 0 && value & EPCTL_SD1PID != 0 {
            self.odd = true;
        }
        self.enabled |= value & EPCTL_EPENA != 0;
    }
}

/// What a driver asked for that the manual does not describe, or the model leaves out.
pub type Told = (&'static str, &'static str);

/// The core.
#[derive(Debug)]
pub struct Core {
    otg_control: u32,
    otg_interrupts: u32,
    bus_config: u32,
    usb_config: u32,
    latched: u32,
    mask: u32,
    receive_words: u32,
    transmit_sizes: [u32; ENDPOINTS],
    general_config: u32,
    device_config: u32,
    device_control: u32,
    in_mask: u32,
    out_mask: u32,
    all_mask: u32,
    empty_mask: u32,
    gating: u32,
    suspended: bool,
    frame: u32,
    inputs: [Endpoint; ENDPOINTS],
    outputs: [Endpoint; ENDPOINTS],
    setups: u32,
    setup_stage: bool,
    /// A control transfer is under way, so that a new address waits for its end.
    in_control: bool,
    address: u8,
    received: VecDeque<Received>,
    /// Data words of the entry that was popped last.
    popped: VecDeque<u32>,
    transmit: [VecDeque<u32>; ENDPOINTS],
    changes: u64,
    told: Vec<Told>,
}

impl Default for Core {
    fn default() -> Self {
        Self {
            otg_control: 0,
            otg_interrupts: 0,
            bus_config: 0,
            usb_config: 0x1400,
            latched: GINTSTS_CIDSCHG,
            mask: 0,
            receive_words: 0x200,
            transmit_sizes: [0x0200_0200; ENDPOINTS],
            general_config: 0,
            device_config: 0x0220_0000,
            device_control: DCTL_SDIS,
            in_mask: 0,
            out_mask: 0,
            all_mask: 0,
            empty_mask: 0,
            gating: 0,
            suspended: false,
            frame: 0,
            inputs: [Endpoint::default(); ENDPOINTS],
            outputs: [Endpoint::default(); ENDPOINTS],
            setups: 0,
            setup_stage: false,
            in_control: false,
            address: 0,
            received: VecDeque::new(),
            popped: VecDeque::new(),
            transmit: Default::default(),
            changes: 0,
            told: Vec::new(),
        }
    }
}

/// A register of an endpoint: which endpoint, and the offset within its registers.
fn endpoint_register(offset: u64, base: u64) -> Option<(usize, u64)> {
    let within = offset.checked_sub(base)?;
    let index = (within / ENDPOINT_STEP) as usize;
    (index < ENDPOINTS).then_some((index, within % ENDPOINT_STEP))
}

/// The endpoint whose FIFO a window is of.
fn fifo(offset: u64) -> Option<usize> {
    let index = (offset.checked_sub(FIFO0)? / FIFO_STEP) as usize;
    (index < ENDPOINTS).then_some(index)
}

// Registers.
impl Core {
    /// How often anything changed that the answers to the bus depend on.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// What was asked for and is not described or not modelled, since this was asked last.
    pub fn take_told(&mut self) -> Vec<Told> {
        std::mem::take(&mut self.told)
    }

    /// Whether the core pulls its line up, so that a host sees a full-speed device.
    pub fn is_connected(&self) -> bool {
        let session = if self.otg_control & GOTGCTL_BVALOEN != 0 {
            self.otg_control & GOTGCTL_BVALOVAL != 0
        } else {
            // The pin that would sense VBUS is not wired.
            self.general_config & GCCFG_VBDEN == 0
        };
        session && self.general_config & GCCFG_PWRDWN != 0 && self.device_control & DCTL_SDIS == 0
    }

    /// The address that the core answers at.
    pub fn address(&self) -> u8 {
        self.address
    }

    fn take_address(&mut self) {
        self.address = (self.device_config >> 4 & 0x7F) as u8;
    }

    /// Whether the core asks for an interrupt.
    pub fn interrupt(&self) -> bool {
        self.bus_config & GAHBCFG_GINTMSK != 0 && self.status() & self.mask != 0
    }

    /// What a read of the register at `offset` answers, and does.
    pub fn read(&mut self, offset: u64) -> u32 {
        if offset == GRXSTSP {
            return self.pop_status();
        }
        if fifo(offset).is_some() {
            self.changes += 1;
            let word = self.popped.pop_front();
            if word.is_none() {
                self.told.push(("DFIFO", FIFO_UNDERRUN));
            }
            return word.unwrap_or(0);
        }
        self.peek(offset)
    }

    /// What a debugger sees at `offset`.
    pub fn peek(&self, offset: u64) -> u32 {
        match offset {
            GOTGCTL => {
                self.otg_control
                    | if self.otg_control & (GOTGCTL_BVALOEN | GOTGCTL_BVALOVAL)
                        == (GOTGCTL_BVALOEN | GOTGCTL_BVALOVAL)
                    {
                        GOTGCTL_BSVLD
                    } else {
                        0
                    }
            }
            GOTGINT => self.otg_interrupts,
            GAHBCFG => self.bus_config,
            GUSBCFG => self.usb_config,
            GRSTCTL => GRSTCTL_AHBIDL,
            GINTSTS => self.status(),
            GINTMSK => self.mask,
            GRXSTSR | GRXSTSP => self.received.front().map_or(0, |entry| entry.status),
            GRXFSIZ => self.receive_words,
            DIEPTXF0 => self.transmit_sizes[0],
            GCCFG => self.general_config,
            CID => CORE_ID,
            DCFG => self.device_config,
            DCTL => self.device_control,
            DSTS => {
                DSTS_FULL_SPEED | self.frame << 8 | if self.suspended { DSTS_SUSPSTS } else { 0 }
            }
            DIEPMSK => self.in_mask,
            DOEPMSK => self.out_mask,
            DAINT => self.all_interrupts(),
            DAINTMSK => self.all_mask,
            DIEPEMPMSK => self.empty_mask,
            PCGCCTL => self.gating,
            DIEPTXF1..0x124 if offset.is_multiple_of(4) => {
                self.transmit_sizes[(offset - DIEPTXF1) as usize / 4 + 1]
            }
            _ => self.peek_endpoint(offset),
        }
    }

    fn peek_endpoint(&self, offset: u64) -> u32 {
        if let Some((index, register)) = endpoint_register(offset, DIEP0) {
            let endpoint = &self.inputs[index];
            return match register {
                CTL => endpoint.control(index),
                INT => self.in_interrupts(index),
                TSIZ => endpoint.size(),
                TXFSTS => self.free_words(self.fifo_of(index)),
                _ => 0,
            };
        }
        if let Some((index, register)) = endpoint_register(offset, DOEP0) {
            let endpoint = &self.outputs[index];
            return match register {
                CTL => endpoint.control(index),
                INT => endpoint.interrupts,
                TSIZ if index == 0 => endpoint.size() | self.setups << TSIZ_SETUPS_SHIFT,
                TSIZ => endpoint.size(),
                _ => 0,
            };
        }
        0
    }

    /// A write of `value` to the register at `offset`.
    pub fn write(&mut self, offset: u64, value: u32) {
        self.changes += 1;
        match offset {
            GOTGCTL => self.otg_control = value & !GOTGCTL_BSVLD,
            GOTGINT => self.otg_interrupts &= !value,
            GAHBCFG => {
                if value & GAHBCFG_DMAEN != 0 {
                    self.told.push(("GAHBCFG", DMA));
                }
                self.bus_config = value;
            }
            GUSBCFG => {
                if value & GUSBCFG_FHMOD != 0 {
                    self.told.push(("GUSBCFG", HOST_MODE));
                }
                self.usb_config = value;
            }
            GRSTCTL => self.write_reset(value),
            GINTSTS => self.latched &= !(value & GINTSTS_LATCHED),
            GINTMSK => self.mask = value,
            GRXFSIZ => self.receive_words = value & 0xFFFF,
            DIEPTXF0 => self.transmit_sizes[0] = value,
            GCCFG => self.general_config = value,
            DCFG => {
                self.device_config = value;
                // Section 57.15, SetAddress: written before the status stage, which still goes to the old one.
                if !self.in_control {
                    self.take_address();
                }
            }
            DCTL => self.write_device_control(value),
            DIEPMSK => self.in_mask = value,
            DOEPMSK => self.out_mask = value,
            DAINTMSK => self.all_mask = value,
            DIEPEMPMSK => self.empty_mask = value,
            PCGCCTL => self.gating = value,
            DIEPTXF1..0x124 if offset.is_multiple_of(4) => {
                self.transmit_sizes[(offset - DIEPTXF1) as usize / 4 + 1] = value;
            }
            _ => self.write_endpoint(offset, value),
        }
    }

    fn write_reset(&mut self, value: u32) {
        if value & GRSTCTL_CSRST != 0 {
            // Section 57.14, OTG_GRSTCTL.CSRST: interrupts and all control and status registers, but for the PHY's.
            let (general_config, changes) = (self.general_config, self.changes);
            let told = std::mem::take(&mut self.told);
            *self = Self {
                general_config,
                changes,
                told,
                ..Self::default()
            };
        }
        if value & GRSTCTL_RXFFLSH != 0 {
            self.received.clear();
            self.popped.clear();
        }
        if value & GRSTCTL_TXFFLSH != 0 {
            let number = value >> 6 & 0x1F;
            for (index, fifo) in self.transmit.iter_mut().enumerate() {
                if number == ALL_FIFOS || number as usize == index {
                    fifo.clear();
                }
            }
        }
        let used = self.receive_words
            + (self.transmit_sizes.iter().enumerate())
                .filter(|(index, _)| *index == 0 || self.inputs[*index].kept != 0)
                .map(|(_, size)| size >> 16)
                .sum::<u32>();
        if used > FIFO_WORDS {
            self.told.push(("GRXFSIZ", FIFO_LAYOUT));
        }
    }

    fn write_device_control(&mut self, value: u32) {
        let statuses = DCTL_GINSTS | DCTL_GONSTS;
        let mut global = self.device_control & statuses;
        for (asked, bit, on) in [
            (DCTL_SGINAK, DCTL_GINSTS, true),
            (DCTL_CGINAK, DCTL_GINSTS, false),
            (DCTL_SGONAK, DCTL_GONSTS, true),
            (DCTL_CGONAK, DCTL_GONSTS, false),
        ] {
            if value & asked != 0 {
                global = if on { global | bit } else { global & !bit };
            }
        }
        let orders = DCTL_SGINAK | DCTL_CGINAK | DCTL_SGONAK | DCTL_CGONAK;
        self.device_control = value & !(orders | statuses) | global;
    }

    fn write_endpoint(&mut self, offset: u64, value: u32) {
        if let Some(index) = fifo(offset) {
            return self.push(index, value);
        }
        if let Some((index, register)) = endpoint_register(offset, DIEP0) {
            let endpoint = &mut self.inputs[index];
            match register {
                CTL => {
                    endpoint.write_control(index, value);
                    if endpoint.nak {
                        endpoint.interrupts |= DIEPINT_INEPNE;
                    }
                    if value & EPCTL_EPDIS != 0 && endpoint.enabled {
                        endpoint.enabled = false;
                        endpoint.interrupts |= EPINT_EPDISD;
                    }
                }
                INT => endpoint.interrupts &= !value,
                TSIZ => {
                    endpoint.bytes = value & TSIZ_BYTES;
                    endpoint.packets = value >> TSIZ_PACKETS_SHIFT & TSIZ_PACKETS;
                }
                _ => {}
            }
        } else if let Some((index, register)) = endpoint_register(offset, DOEP0) {
            let endpoint = &mut self.outputs[index];
            match register {
                CTL => {
                    endpoint.write_control(index, value);
                    // Endpoint 0 cannot be disabled (section 57.14, OTG_DOEPCTL0).
                    if value & EPCTL_EPDIS != 0 && endpoint.enabled && index != 0 {
                        if self.device_control & DCTL_GONSTS == 0 {
                            self.told.push(("DOEPCTLx", OUT_DISABLED));
                        }
                        endpoint.enabled = false;
                        endpoint.interrupts |= EPINT_EPDISD;
                    }
                }
                INT => endpoint.interrupts &= !value,
                TSIZ => {
                    endpoint.bytes = value & TSIZ_BYTES;
                    endpoint.packets = value >> TSIZ_PACKETS_SHIFT & TSIZ_PACKETS;
                    if index == 0 {
                        endpoint.packets &= 1;
                        self.setups = value >> TSIZ_SETUPS_SHIFT & 3;
                    }
                }
                _ => {}
            }
        }
    }

    fn status(&self) -> u32 {
        let all = self.all_interrupts() & self.all_mask;
        let flag = |on: bool, bit: u32| if on { bit } else { 0 };
        self.latched
            | GINTSTS_NPTXFE
            | GINTSTS_PTXFE
            | flag(self.otg_interrupts != 0, GINTSTS_OTGINT)
            | flag(!self.received.is_empty(), GINTSTS_RXFLVL)
            | flag(self.device_control & DCTL_GINSTS != 0, GINTSTS_GINAKEFF)
            | flag(self.device_control & DCTL_GONSTS != 0, GINTSTS_GONAKEFF)
            | flag(all & 0xFFFF != 0, GINTSTS_IEPINT)
            | flag(all >> 16 != 0, GINTSTS_OEPINT)
            | flag(self.usb_config & GUSBCFG_FHMOD != 0, GINTSTS_CMOD)
    }

    fn all_interrupts(&self) -> u32 {
        (0..ENDPOINTS).fold(0, |all, index| {
            let empty = if self.empty_mask & bit(index) != 0 {
                DIEPINT_TXFE
            } else {
                0
            };
            let input = self.in_interrupts(index) & (self.in_mask & !DIEPINT_TXFE | empty) != 0;
            let output = self.outputs[index].interrupts & self.out_mask != 0;
            all | u32::from(input) << index | u32::from(output) << (16 + index)
        })
    }

    fn in_interrupts(&self, index: usize) -> u32 {
        let endpoint = &self.inputs[index];
        let fifo = self.fifo_of(index);
        let held = self.transmit[fifo].len() as u32;
        let half = (self.transmit_sizes[fifo] >> 16) / 2;
        let is_empty = held == 0 || self.bus_config & GAHBCFG_TXFELVL == 0 && held <= half;
        endpoint.interrupts | if is_empty { DIEPINT_TXFE } else { 0 }
    }
}

// FIFOs.
impl Core {
    fn fifo_of(&self, index: usize) -> usize {
        if index == 0 {
            0
        } else {
            ((self.inputs[index].kept >> 22 & 0xF) as usize).min(ENDPOINTS - 1)
        }
    }

    fn free_words(&self, fifo: usize) -> u32 {
        (self.transmit_sizes[fifo] >> 16).saturating_sub(self.transmit[fifo].len() as u32)
    }

    fn push(&mut self, index: usize, word: u32) {
        let fifo = self.fifo_of(index);
        if self.free_words(fifo) == 0 {
            self.told.push(("DFIFO", FIFO_OVERRUN));
            return;
        }
        self.transmit[fifo].push_back(word);
    }

    fn pop_status(&mut self) -> u32 {
        self.changes += 1;
        // Data that was not read is behind; the next status is the next entry's.
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

    fn held_words(&self) -> u32 {
        let entries = self.received.iter();
        self.popped.len() as u32
            + entries
                .map(|entry| 1 + entry.words.len() as u32)
                .sum::<u32>()
    }

    fn has_room(&self, bytes: usize) -> bool {
        // Its status, and that of the transfer's end.
        self.held_words() + bytes.div_ceil(4) as u32 + 2 <= self.receive_words
    }

    fn receive(&mut self, endpoint: usize, kind: u32, pid: Pid, data: &[u8]) {
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

// What comes over the bus.
impl Core {
    /// The frame that began.
    pub fn start_of_frame(&mut self, number: u32) {
        self.frame = number & 0x3FFF;
        self.latched |= GINTSTS_SOF;
    }

    /// The bus has been idle for 3 ms.
    pub fn suspend(&mut self) {
        self.suspended = true;
        self.latched |= GINTSTS_ESUSP | GINTSTS_USBSUSP;
    }

    /// The host drives a resume.
    pub fn resume(&mut self) {
        if self.suspended {
            self.suspended = false;
            self.latched |= GINTSTS_WKUPINT;
        }
    }

    /// A reset of the bus begins.
    pub fn bus_reset_begins(&mut self) {
        self.changes += 1;
        if self.suspended {
            self.resume();
        }
        self.latched |= GINTSTS_USBRST;
        self.in_control = false;
        self.setup_stage = false;
        // Section 57.14, OTG_DIEPCTLx.USBAEP: cleared for all endpoints but 0 by a reset of the bus.
        for endpoint in self.inputs.iter_mut().chain(&mut self.outputs) {
            endpoint.active = false;
        }
    }

    /// A reset of the bus ends, and the speed is known.
    pub fn bus_reset_ends(&mut self) {
        self.latched |= GINTSTS_ENUMDNE;
    }

    /// A SETUP packet: acknowledged if there is room for it.
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
            endpoint.odd = true;
        }
        Some(Handshake::Ack)
    }

    /// Whether a SETUP came, and no token since.
    pub fn in_setup_stage(&self) -> bool {
        self.setup_stage
    }

    /// The first token after a SETUP ends the setup stage.
    fn end_setup_stage(&mut self) {
        if std::mem::take(&mut self.setup_stage) {
            self.changes += 1;
            self.receive(0, SETUP_DONE, Pid::Data0, &[]);
        }
    }

    /// What an OUT packet of `bytes` would be answered with; none where the device is silent.
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

    /// An OUT packet that came whole, and its handshake; none where the device is silent.
    pub fn out(&mut self, index: usize, pid: Pid, data: &[u8]) -> Option<Handshake> {
        if index == 0 {
            self.end_setup_stage();
        }
        let answer = self.answer_out(index, data.len())?;
        if answer == Handshake::Ack {
            self.changes += 1;
            let endpoint = &mut self.outputs[index];
            // One that came twice is acknowledged twice, and taken once.
            if endpoint.pid() == pid {
                endpoint.odd = !endpoint.odd;
                endpoint.packets = endpoint.packets.saturating_sub(1);
                endpoint.bytes = endpoint.bytes.saturating_sub(data.len() as u32);
                let is_last =
                    endpoint.packets == 0 || data.len() < endpoint.max_packet_bytes(index);
                endpoint.nak |= is_last;
                self.receive(index, OUT_DATA, pid, data);
                if is_last {
                    self.receive(index, OUT_DONE, pid, &[]);
                }
            }
        }
        Some(answer)
    }

    /// What an IN token would be answered with; none where the device is silent.
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
        if refuses || held.len() < bytes.div_ceil(4) {
            return Some(InAnswer::Nak);
        }
        let mut data: Vec<u8> = (held.iter().take(bytes.div_ceil(4)))
            .flat_map(|word| word.to_le_bytes())
            .collect();
        data.truncate(bytes);
        Some(InAnswer::Data(endpoint.pid(), data))
    }

    /// An IN token; none where the device is silent.
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

    /// The host acknowledged the packet that the last IN token got.
    pub fn acknowledged(&mut self, index: usize) {
        let Some(InAnswer::Data(_, data)) = self.answer_in(index) else {
            // The firmware took it back meanwhile.
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
        if index == 0 && data.is_empty() {
            self.in_control = false;
            self.take_address();
        }
    }
}
