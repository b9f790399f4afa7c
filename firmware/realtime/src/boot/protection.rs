//! Memory protection: the regions of the processor's MPU (ARM DDI 0403E, B3.5).
//!
//! Without the MPU, all memory can be executed and address 0 can be written. Only the bus notices a stack that
//! overflows: late, and without the place of the store, because a store's bus fault is asynchronous (PM0253 section
//! 2.5.3). A refusal by the MPU is always precise.
//!
//! | region | access | memory | reason |
//! |---|---|---|---|
//! | all addresses | none | strongly ordered | 1 |
//! | ITCM | read, execute | normal | code of the tick, copied before |
//! | null: the first KB | none | strongly ordered | left free in `tick.x`, so that a null pointer faults |
//! | flash, bank 1 | read, execute; none while it is busy | write-back | code; 2, 5 |
//! | record of updates, and settings, in bank 1 | read, write | not cached | 3 |
//! | flash, bank 2 | read, write | not cached | slots of libraries; 3 |
//! | identity | read | not cached | serial number and factory calibration (RM0433 chapter 61) |
//! | DTCM | read, write | normal | stack, data, vectors; 4 |
//! | AXI SRAM | read, write | write-back | the library that is played |
//! | SRAM 1 | read, write | not cached, shareable | memory for DMA, which does not see the cache |
//! | SRAM 4 | read, write | write-back | large values of tasks |
//! | peripherals | read, write | device | |
//!
//! 1. The processor fetches and reads ahead in normal memory. External memory is normal by default, though no memory
//!    controller is in use (AN4838). A region with an attribute that forbids such reads is safer than no region. The
//!    background map is off.
//! 2. No region is write-through, which is the default of bank 1, because a Cortex-M7 can corrupt data in a sequence of
//!    stores and loads in such memory (ES0392, on the data cache in write-through). Nothing is stored to bank 1, so its
//!    write-back lines are never dirty.
//! 3. Stores must reach the bank as they are, and reads must see what was programmed. With the data cache on, erases
//!    were found unreliable (NuttX issue 7397). The memory is normal, not device, because slices of bytes are read
//!    unaligned, which device memory refuses (ARM DDI 0403E, A3.2.1). The bank's lock, which is off only while a word
//!    is programmed or a sector erased, refuses stray stores.
//! 4. No region lies below DTCM, so the first store of a stack that overflows is refused. TCMs are never cached.
//! 5. A fetch from a busy bank stalls until the bank is idle, which can take longer than the watchdog allows. The
//!    processor also fetches ahead along the path that it predicts, from wherever execution is allowed (ARM DDI 0489F,
//!    5.2.1): see [`hide_code`].
//!
//! SRAM 2 and 3, the backup SRAM and the rest of the system memory are not used, so they have no region. The
//! processor's own registers, from 0xE0000000 on, are not subject to the MPU.
//!
//! Handlers of HardFault and NMI run without the MPU (HFNMIENA = 0), so that nothing stops them. MemManage is not
//! enabled: it arrives as HardFault, with its status.

#[cfg(target_arch = "arm")]
use cortex_m::peripheral::MPU;

/// Permissions of a region, in the encoding of RASR.AP. Nothing runs unprivileged, so both privilege levels have the
/// same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// None.
    Nothing = 0b000,
    /// Reads and writes.
    ReadWrite = 0b011,
    /// Reads.
    Read = 0b110,
}

/// Type of memory (ARM DDI 0403E, table B3-13).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Strongly ordered.
    StronglyOrdered,
    /// Device, shareable.
    Device,
    /// Normal, not cached.
    NotCached,
    /// Normal, not cached, shareable.
    NotCachedShareable,
    /// Normal, cached with write-back and allocation at reads and writes.
    WriteBack,
}

impl Memory {
    /// TEX, S, C and B at their positions in RASR.
    const fn bits(self) -> u32 {
        const B: u32 = 1 << 16;
        const C: u32 = 1 << 17;
        const S: u32 = 1 << 18;
        const TEX_1: u32 = 1 << 19;
        match self {
            Self::StronglyOrdered => 0,
            Self::Device => S | B,
            Self::NotCached => TEX_1,
            Self::NotCachedShareable => TEX_1 | S,
            Self::WriteBack => TEX_1 | C | B,
        }
    }
}

/// A region. Where several regions overlap, the last of them in [`REGIONS`] applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First address, a multiple of the length.
    pub start: u32,
    /// Binary logarithm of the length in bytes.
    pub length_log2: u32,
    /// Permissions.
    pub access: Access,
    /// True if instructions may be fetched.
    pub executable: bool,
    /// Type of memory.
    pub memory: Memory,
}

impl Region {
    const fn new(start: u32, length_log2: u32, access: Access, memory: Memory) -> Self {
        Self {
            start,
            length_log2,
            access,
            executable: false,
            memory,
        }
    }

    const fn of_code(start: u32, length_log2: u32, memory: Memory) -> Self {
        Self {
            executable: true,
            ..Self::new(start, length_log2, Access::Read, memory)
        }
    }

    /// Value of the register RASR.
    pub const fn attributes(&self) -> u32 {
        const ENABLE: u32 = 1;
        const XN: u32 = 1 << 28;
        let never = if self.executable { 0 } else { XN };
        never | (self.access as u32) << 24 | self.memory.bits() | (self.length_log2 - 1) << 1 | ENABLE
    }
}

/// The regions, see the table above. The part supports 16 (DS12110 section 3.2).
pub const REGIONS: [Region; 13] = [
    Region::new(0, 32, Access::Nothing, Memory::StronglyOrdered),
    Region::of_code(0x0000_0000, 16, Memory::NotCached),
    Region::new(0x0000_0000, 10, Access::Nothing, Memory::StronglyOrdered),
    Region::of_code(0x0800_0000, 20, Memory::WriteBack),
    Region::new(0x0808_0000, 18, Access::ReadWrite, Memory::NotCached),
    Region::new(0x080C_0000, 18, Access::ReadWrite, Memory::NotCached),
    Region::new(0x0810_0000, 20, Access::ReadWrite, Memory::NotCached),
    Region::new(0x1FF1_E800, 11, Access::Read, Memory::NotCached),
    Region::new(0x2000_0000, 17, Access::ReadWrite, Memory::NotCached),
    Region::new(0x2400_0000, 19, Access::ReadWrite, Memory::WriteBack),
    Region::new(0x3000_0000, 17, Access::ReadWrite, Memory::NotCachedShareable),
    Region::new(0x3800_0000, 16, Access::ReadWrite, Memory::WriteBack),
    Region::new(0x4000_0000, 29, Access::ReadWrite, Memory::Device),
];

/// Index of the code's region in [`REGIONS`].
#[cfg(target_arch = "arm")]
const CODE: usize = 3;

/// Hides bank 1, except for the record of updates and the settings, from the processor. The region becomes strongly
/// ordered, without access and execution, so that the processor fetches and reads nothing ahead from there (ARM DDI
/// 0489F, 5.2.1). Must be inlined into code outside bank 1.
#[cfg(target_arch = "arm")]
#[inline(always)]
pub fn hide_code() {
    const HIDDEN: Region = Region::new(
        REGIONS[CODE].start,
        REGIONS[CODE].length_log2,
        Access::Nothing,
        Memory::StronglyOrdered,
    );
    set_code(HIDDEN.attributes());
}

/// Ends [`hide_code`].
#[cfg(target_arch = "arm")]
#[inline(always)]
pub fn show_code() {
    set_code(const { REGIONS[CODE].attributes() });
}

/// Sets the attributes of the code's region; everything after this call is fetched under these attributes.
#[cfg(target_arch = "arm")]
#[inline(always)]
#[expect(unsafe_code, reason = "the processor's own registers")]
fn set_code(attributes: u32) {
    // SAFETY: the registers exist, and after the start nothing else writes them. The caller runs outside of the region.
    unsafe {
        (*MPU::PTR).rnr.write(CODE as u32);
        (*MPU::PTR).rasr.write(attributes);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Turns the MPU on. Code must have been copied to ITCM before. The caches are turned on afterwards, so that they hold
/// no line of memory that must not be cached.
#[cfg(target_arch = "arm")]
#[expect(unsafe_code, reason = "the processor's own registers")]
pub fn enable(mpu: &mut MPU) {
    /// Field VALID of RBAR: the write selects the region in its lowest bits (ARM DDI 0403E, B3.5.8).
    const VALID: u32 = 1 << 4;
    const ENABLE: u32 = 1;
    cortex_m::asm::dmb();
    for (number, region) in (0..).zip(&REGIONS) {
        // SAFETY: the MPU is off until all regions are set.
        unsafe {
            mpu.rbar.write(region.start | VALID | number);
            mpu.rasr.write(region.attributes());
        }
    }
    // SAFETY: all that the program uses has a region that allows it.
    unsafe { mpu.ctrl.write(ENABLE) };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}
