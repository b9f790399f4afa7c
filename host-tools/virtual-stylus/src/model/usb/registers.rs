//! Offsets and bits of the core's registers that the model implements (section 57.14), with the manual's names.

/// Number of endpoints per direction, including endpoint 0.
pub const ENDPOINTS: usize = 9;

pub const GOTGCTL: u64 = 0x000;
pub const GOTGINT: u64 = 0x004;
pub const GAHBCFG: u64 = 0x008;
pub const GUSBCFG: u64 = 0x00C;
pub const GRSTCTL: u64 = 0x010;
pub const GINTSTS: u64 = 0x014;
pub const GINTMSK: u64 = 0x018;
pub const GRXSTSR: u64 = 0x01C;
pub const GRXSTSP: u64 = 0x020;
pub const GRXFSIZ: u64 = 0x024;
pub const DIEPTXF0: u64 = 0x028;
pub const GCCFG: u64 = 0x038;
pub const CID: u64 = 0x03C;
pub const DIEPTXF1: u64 = 0x104;
pub const DCFG: u64 = 0x800;
pub const DCTL: u64 = 0x804;
pub const DSTS: u64 = 0x808;
pub const DIEPMSK: u64 = 0x810;
pub const DOEPMSK: u64 = 0x814;
pub const DAINT: u64 = 0x818;
pub const DAINTMSK: u64 = 0x81C;
pub const DIEPEMPMSK: u64 = 0x834;
/// Registers of IN endpoint 0. Those of the other endpoints follow at steps of [`ENDPOINT_STEP`].
pub const DIEP0: u64 = 0x900;
/// Registers of OUT endpoint 0. Those of the other endpoints follow at steps of [`ENDPOINT_STEP`].
pub const DOEP0: u64 = 0xB00;
pub const ENDPOINT_STEP: u64 = 0x20;
/// Offset of a register within an endpoint's registers.
pub const CTL: u64 = 0x00;
pub const INT: u64 = 0x08;
pub const TSIZ: u64 = 0x10;
pub const TXFSTS: u64 = 0x18;
pub const PCGCCTL: u64 = 0xE00;
/// The windows into the FIFOs, one per endpoint.
pub const FIFO0: u64 = 0x1000;
pub const FIFO_STEP: u64 = 0x1000;

pub const GOTGCTL_BVALOEN: u32 = 1 << 6;
pub const GOTGCTL_BVALOVAL: u32 = 1 << 7;
pub const GOTGCTL_BSVLD: u32 = 1 << 19;
pub const GAHBCFG_GINTMSK: u32 = 1;
pub const GAHBCFG_TXFELVL: u32 = 1 << 7;
pub const GAHBCFG_DMAEN: u32 = 1 << 5;
pub const GUSBCFG_FHMOD: u32 = 1 << 29;
pub const GRSTCTL_CSRST: u32 = 1;
pub const GRSTCTL_RXFFLSH: u32 = 1 << 4;
pub const GRSTCTL_TXFFLSH: u32 = 1 << 5;
pub const GRSTCTL_AHBIDL: u32 = 1 << 31;
/// Value of `TXFNUM` that selects all FIFOs.
pub const ALL_FIFOS: u32 = 0x10;
pub const GINTSTS_CMOD: u32 = 1;
pub const GINTSTS_OTGINT: u32 = 1 << 2;
pub const GINTSTS_SOF: u32 = 1 << 3;
pub const GINTSTS_RXFLVL: u32 = 1 << 4;
pub const GINTSTS_NPTXFE: u32 = 1 << 5;
pub const GINTSTS_GINAKEFF: u32 = 1 << 6;
pub const GINTSTS_GONAKEFF: u32 = 1 << 7;
pub const GINTSTS_ESUSP: u32 = 1 << 10;
pub const GINTSTS_USBSUSP: u32 = 1 << 11;
pub const GINTSTS_USBRST: u32 = 1 << 12;
pub const GINTSTS_ENUMDNE: u32 = 1 << 13;
pub const GINTSTS_IEPINT: u32 = 1 << 18;
pub const GINTSTS_OEPINT: u32 = 1 << 19;
pub const GINTSTS_PTXFE: u32 = 1 << 26;
pub const GINTSTS_CIDSCHG: u32 = 1 << 28;
pub const GINTSTS_WKUPINT: u32 = 1 << 31;
/// Bits of `GINTSTS` that stay set until a one is written to them.
pub const GINTSTS_LATCHED: u32 = 0xF8F0_FC0A;
pub const GCCFG_PWRDWN: u32 = 1 << 16;
pub const GCCFG_VBDEN: u32 = 1 << 21;
pub const DCTL_SDIS: u32 = 1 << 1;
pub const DCTL_GINSTS: u32 = 1 << 2;
pub const DCTL_GONSTS: u32 = 1 << 3;
pub const DCTL_SGINAK: u32 = 1 << 7;
pub const DCTL_CGINAK: u32 = 1 << 8;
pub const DCTL_SGONAK: u32 = 1 << 9;
pub const DCTL_CGONAK: u32 = 1 << 10;
pub const DSTS_SUSPSTS: u32 = 1;
/// `ENUMSPD`: full speed by the internal PHY, 48 MHz.
pub const DSTS_FULL_SPEED: u32 = 3 << 1;
pub const EPCTL_USBAEP: u32 = 1 << 15;
pub const EPCTL_DPID: u32 = 1 << 16;
pub const EPCTL_NAKSTS: u32 = 1 << 17;
pub const EPCTL_STALL: u32 = 1 << 21;
pub const EPCTL_CNAK: u32 = 1 << 26;
pub const EPCTL_SNAK: u32 = 1 << 27;
pub const EPCTL_SD0PID: u32 = 1 << 28;
pub const EPCTL_SD1PID: u32 = 1 << 29;
pub const EPCTL_EPDIS: u32 = 1 << 30;
pub const EPCTL_EPENA: u32 = 1 << 31;
/// Bits of `DIEPCTLx` and `DOEPCTLx` that keep what is written: `MPSIZ`, `EPTYP`, `SNPM` and `TXFNUM`.
pub const EPCTL_KEPT: u32 = 0x07FF | 3 << 18 | 1 << 20 | 0xF << 22;
pub const EPINT_XFRC: u32 = 1;
pub const EPINT_EPDISD: u32 = 1 << 1;
pub const DOEPINT_STUP: u32 = 1 << 3;
pub const DIEPINT_ITTXFE: u32 = 1 << 4;
pub const DIEPINT_INEPNE: u32 = 1 << 6;
pub const DOEPINT_B2BSTUP: u32 = 1 << 6;
pub const DIEPINT_TXFE: u32 = 1 << 7;
/// `XFRSIZ` of `DIEPTSIZx` and `DOEPTSIZx`.
pub const TSIZ_BYTES: u32 = 0x7_FFFF;
pub const TSIZ_PACKETS_SHIFT: u32 = 19;
pub const TSIZ_PACKETS: u32 = 0x3FF;
pub const TSIZ_SETUPS_SHIFT: u32 = 29;

/// `PKTSTS` of an entry of the receive FIFO: data of an OUT packet.
pub const OUT_DATA: u32 = 0b0010;
/// `PKTSTS`: an OUT transfer is complete.
pub const OUT_DONE: u32 = 0b0011;
/// `PKTSTS`: a setup stage is complete.
pub const SETUP_DONE: u32 = 0b0100;
/// `PKTSTS`: data of a SETUP packet.
pub const SETUP_DATA: u32 = 0b0110;

/// Bit `index` of a mask of endpoints.
pub fn bit(index: usize) -> u32 {
    1 << index
}
