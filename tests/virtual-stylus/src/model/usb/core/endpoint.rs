//! One endpoint, in one direction.

use crate::model::usb::packets::Pid;
use crate::model::usb::registers::{
    EPCTL_CNAK, EPCTL_DPID, EPCTL_EPENA, EPCTL_KEPT, EPCTL_NAKSTS, EPCTL_SD0PID, EPCTL_SD1PID,
    EPCTL_SNAK, EPCTL_STALL, EPCTL_USBAEP, TSIZ_PACKETS_SHIFT,
};

#[derive(Clone, Copy, Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a bit of the register"
)]
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
            | flag(self.odd && index != 0, EPCTL_DPID)
            | flag(self.nak, EPCTL_NAKSTS)
            | flag(self.stalled, EPCTL_STALL)
            | flag(self.enabled, EPCTL_EPENA)
    }

    pub(super) fn size(&self) -> u32 {
        self.bytes | self.packets << TSIZ_PACKETS_SHIFT
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
        // The stall of a control endpoint is ended by the core only, when a SETUP comes.
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
