//! Accesses of the firmware to registers and FIFOs.

use super::state::Core;
use crate::model::usb::registers::{
    ALL_FIFOS, CID, CTL, DAINT, DAINTMSK, DCFG, DCTL, DCTL_CGINAK, DCTL_CGONAK, DCTL_GINSTS, DCTL_GONSTS, DCTL_SGINAK,
    DCTL_SGONAK, DIEP0, DIEPEMPMSK, DIEPINT_INEPNE, DIEPMSK, DIEPTXF0, DIEPTXF1, DOEP0, DOEPMSK, DSTS, DSTS_FULL_SPEED,
    DSTS_SUSPSTS, ENDPOINT_STEP, ENDPOINTS, EPCTL_EPDIS, EPINT_EPDISD, FIFO_STEP, FIFO0, GAHBCFG, GAHBCFG_DMAEN, GCCFG,
    GINTMSK, GINTSTS, GINTSTS_LATCHED, GOTGCTL, GOTGCTL_BSVLD, GOTGCTL_BVALOEN, GOTGCTL_BVALOVAL, GOTGINT, GRSTCTL,
    GRSTCTL_AHBIDL, GRSTCTL_CSRST, GRSTCTL_RXFFLSH, GRSTCTL_TXFFLSH, GRXFSIZ, GRXSTSP, GRXSTSR, GUSBCFG, GUSBCFG_FHMOD,
    INT, PCGCCTL, TSIZ, TSIZ_SETUPS_SHIFT, TXFSTS,
};

/// `CID` of this part's cores (section 57.14, OTG_CID).
const CORE_ID: u32 = 0x2300;
/// Words of the FIFO RAM: 4 Kbytes.
const FIFO_WORDS: u32 = 1024;

const DMA: &str = "RM0433 57.14, OTG_GAHBCFG: DMAEN is not modelled, the FIFOs are the core's to fill and empty";
const HOST_MODE: &str = "RM0433 57.14, OTG_GUSBCFG: FHMOD is not modelled, the core is a device";
const OUT_DISABLED: &str = "RM0433 57.14, OTG_DOEPCTLx: EPDIS without the global OUT NAK, \
                            which the manual asks for first; taken at once";
const FIFO_UNDERRUN: &str = "the receive FIFO was read without data; the read answers zero";
const FIFO_LAYOUT: &str = "the FIFOs do not fit the FIFO RAM of 4 Kbytes";

/// The endpoint to which a register belongs, and the offset within the endpoint's registers.
fn endpoint_register(offset: u64, base: u64) -> Option<(usize, u64)> {
    let within = offset.checked_sub(base)?;
    let index = (within / ENDPOINT_STEP) as usize;
    (index < ENDPOINTS).then_some((index, within % ENDPOINT_STEP))
}

/// The endpoint whose FIFO is at `offset`.
fn fifo(offset: u64) -> Option<usize> {
    let index = (offset.checked_sub(FIFO0)? / FIFO_STEP) as usize;
    (index < ENDPOINTS).then_some(index)
}

impl Core {
    /// Reads the register at `offset`, with the effects of the read.
    pub fn read(&mut self, offset: u64) -> u32 {
        if offset == GRXSTSP {
            return self.pop_status();
        }
        // There is one receive FIFO, which every endpoint's window reads.
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

    /// The value at `offset`, without the effects of a read.
    pub fn peek(&self, offset: u64) -> u32 {
        match offset {
            GOTGCTL => {
                self.otg_control
                    | if self.otg_control & (GOTGCTL_BVALOEN | GOTGCTL_BVALOVAL) == (GOTGCTL_BVALOEN | GOTGCTL_BVALOVAL)
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
            DSTS => DSTS_FULL_SPEED | self.frame << 8 | if self.suspended { DSTS_SUSPSTS } else { 0 },
            DIEPMSK => self.in_mask,
            DOEPMSK => self.out_mask,
            DAINT => self.all_interrupts(),
            DAINTMSK => self.all_mask,
            DIEPEMPMSK => self.empty_mask,
            PCGCCTL => self.gating,
            DIEPTXF1..0x124 if offset.is_multiple_of(4) => self.transmit_sizes[(offset - DIEPTXF1) as usize / 4 + 1],
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

    /// Writes `value` to the register at `offset`.
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
                // Section 57.15, SetAddress: the address is written before the status stage, which still uses the old
                // address.
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
            // Section 57.14, OTG_GRSTCTL.CSRST: it resets interrupts and all control and status registers, except the
            // PHY's.
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
        // A driver flushes the FIFOs once it has set all their sizes, so the layout is checked here. The size of an
        // endpoint that is not in use still has its reset value.
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
                TSIZ => endpoint.write_size(value),
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
                    endpoint.write_size(value);
                    if index == 0 {
                        // OTG_DOEPTSIZ0 has one bit for packets, and the number of SETUPs in a row.
                        endpoint.packets &= 1;
                        self.setups = value >> TSIZ_SETUPS_SHIFT & 3;
                    }
                }
                _ => {}
            }
        }
    }
}
