//! State of the core and of its endpoints, and the interrupts, address and pull-up that follow from it.

use std::collections::VecDeque;

use crate::model::usb::Pid;
use crate::model::usb::registers::{
    DCTL_GINSTS, DCTL_GONSTS, DCTL_SDIS, DIEPINT_TXFE, ENDPOINTS, EPCTL_CNAK, EPCTL_DPID, EPCTL_EPENA, EPCTL_KEPT,
    EPCTL_NAKSTS, EPCTL_SD0PID, EPCTL_SD1PID, EPCTL_SNAK, EPCTL_STALL, EPCTL_USBAEP, GAHBCFG_GINTMSK, GAHBCFG_TXFELVL,
    GCCFG_PWRDWN, GCCFG_VBDEN, GINTSTS_CIDSCHG, GINTSTS_CMOD, GINTSTS_GINAKEFF, GINTSTS_GONAKEFF, GINTSTS_IEPINT,
    GINTSTS_NPTXFE, GINTSTS_OEPINT, GINTSTS_OTGINT, GINTSTS_PTXFE, GINTSTS_RXFLVL, GOTGCTL_BVALOEN, GOTGCTL_BVALOVAL,
    GUSBCFG_FHMOD, TSIZ_BYTES, TSIZ_PACKETS, TSIZ_PACKETS_SHIFT, bit,
};

/// One endpoint in one direction.
#[derive(Clone, Copy, Debug, Default)]
#[expect(clippy::struct_excessive_bools, reason = "each is a bit of the register")]
pub(super) struct Endpoint {
    pub(super) kept: u32,
    pub(super) active: bool,
    pub(super) nak: bool,
    pub(super) stalled: bool,
    pub(super) enabled: bool,
    pub(super) odd: bool,
    pub(super) bytes: u32,
    pub(super) packets: u32,
    pub(super) interrupts: u32,
}

impl Endpoint {
    pub(super) fn pid(&self) -> Pid {
        if self.odd { Pid::Data1 } else { Pid::Data0 }
    }

    pub(super) fn control(&self, index: usize) -> u32 {
        let flag = |on: bool, bit: u32| if on { bit } else { 0 };
        self.kept
            | flag(self.active || index == 0, EPCTL_USBAEP)
            // Endpoint 0 has no such bit; its toggles follow from the stages.
            | flag(self.odd && index != 0, EPCTL_DPID)
            | flag(self.nak, EPCTL_NAKSTS)
            | flag(self.stalled, EPCTL_STALL)
            | flag(self.enabled, EPCTL_EPENA)
    }

    pub(super) fn size(&self) -> u32 {
        self.bytes | self.packets << TSIZ_PACKETS_SHIFT
    }

    pub(super) fn write_size(&mut self, value: u32) {
        self.bytes = value & TSIZ_BYTES;
        self.packets = value >> TSIZ_PACKETS_SHIFT & TSIZ_PACKETS;
    }

    pub(super) fn max_packet_bytes(&self, index: usize) -> usize {
        if index == 0 {
            64 >> (self.kept & 3)
        } else {
            (self.kept & 0x7FF) as usize
        }
    }

    /// Writes the bits that both directions have in common.
    pub(super) fn write_control(&mut self, index: usize, value: u32) {
        self.kept = value & EPCTL_KEPT;
        self.active = value & EPCTL_USBAEP != 0;
        // Only the core ends the stall of a control endpoint, when a SETUP packet arrives.
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

/// An entry of the receive FIFO: its status word, followed by its data words.
#[derive(Clone, Debug)]
pub(super) struct Received {
    pub(super) status: u32,
    pub(super) endpoint: usize,
    pub(super) kind: u32,
    pub(super) words: VecDeque<u32>,
}

/// A register, and a request to it that the manual forbids or does not describe, or that the model does not carry out.
pub type RegisterMisuse = (&'static str, &'static str);

/// The core.
#[derive(Debug)]
pub struct Core {
    pub(super) otg_control: u32,
    pub(super) otg_interrupts: u32,
    pub(super) bus_config: u32,
    pub(super) usb_config: u32,
    pub(super) latched: u32,
    pub(super) mask: u32,
    pub(super) receive_words: u32,
    pub(super) transmit_sizes: [u32; ENDPOINTS],
    pub(super) general_config: u32,
    pub(super) device_config: u32,
    pub(super) device_control: u32,
    pub(super) in_mask: u32,
    pub(super) out_mask: u32,
    pub(super) all_mask: u32,
    pub(super) empty_mask: u32,
    pub(super) gating: u32,
    pub(super) suspended: bool,
    pub(super) frame: u32,
    pub(super) inputs: [Endpoint; ENDPOINTS],
    pub(super) outputs: [Endpoint; ENDPOINTS],
    pub(super) setups: u32,
    pub(super) setup_stage: bool,
    /// True while a control transfer is under way, so that a new address waits for the transfer's end.
    pub(super) in_control: bool,
    pub(super) address: u8,
    pub(super) received: VecDeque<Received>,
    /// Data words of popped entries that the firmware has not read yet.
    pub(super) popped: VecDeque<u32>,
    pub(super) transmit: [VecDeque<u32>; ENDPOINTS],
    pub(super) changes: u64,
    pub(super) told: Vec<RegisterMisuse>,
}

impl Default for Core {
    fn default() -> Self {
        // Values after a reset (section 57.14). The places of the FIFOs in their RAM are not modelled.
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

impl Core {
    /// Number of changes of the state on which the answers to the bus depend.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Returns the requests since the last call that the manual forbids or does not describe, or that the model does
    /// not carry out.
    pub fn take_told(&mut self) -> Vec<RegisterMisuse> {
        std::mem::take(&mut self.told)
    }

    /// True while the core pulls its line up, so that a host sees a full-speed device.
    pub fn is_connected(&self) -> bool {
        let session = if self.otg_control & GOTGCTL_BVALOEN != 0 {
            self.otg_control & GOTGCTL_BVALOVAL != 0
        } else {
            // The pin that senses VBUS is not connected.
            self.general_config & GCCFG_VBDEN == 0
        };
        session && self.general_config & GCCFG_PWRDWN != 0 && self.device_control & DCTL_SDIS == 0
    }

    /// The address at which the core answers.
    pub fn address(&self) -> u8 {
        self.address
    }

    pub(super) fn take_address(&mut self) {
        self.address = (self.device_config >> 4 & 0x7F) as u8;
    }

    /// True while the core asserts its interrupt.
    pub fn interrupt(&self) -> bool {
        self.bus_config & GAHBCFG_GINTMSK != 0 && self.status() & self.mask != 0
    }

    pub(super) fn status(&self) -> u32 {
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

    pub(super) fn all_interrupts(&self) -> u32 {
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

    pub(super) fn in_interrupts(&self, index: usize) -> u32 {
        let endpoint = &self.inputs[index];
        let fifo = self.fifo_of(index);
        let held = self.transmit[fifo].len() as u32;
        let half = (self.transmit_sizes[fifo] >> 16) / 2;
        let is_empty = held == 0 || self.bus_config & GAHBCFG_TXFELVL == 0 && held <= half;
        // A level: it cannot be cleared while the FIFO is empty.
        endpoint.interrupts | if is_empty { DIEPINT_TXFE } else { 0 }
    }

    pub(super) fn fifo_of(&self, index: usize) -> usize {
        if index == 0 {
            0
        } else {
            ((self.inputs[index].kept >> 22 & 0xF) as usize).min(ENDPOINTS - 1)
        }
    }
}
