//! From reset to `main`. The watchdog starts, the amplifier is turned off and the output set to mid-scale, and then
//! code, constants and vectors are copied to the memories that the tick uses.
#![expect(
    unsafe_code,
    reason = "memory is laid out and the processor's own registers are set before they have owners"
)]

use core::arch::global_asm;
use core::cell::UnsafeCell;
use core::ptr::{addr_of, read_volatile, write_volatile};

use cortex_m::asm;
use cortex_m::peripheral::{CPUID, DCB, DWT, SCB};

/// Entries of the vector table: 16 of the core and 150 of the STM32H743 (RM0433 table 148).
const VECTORS: usize = 166;

/// Timeout of the watchdog during the start, µs. The first timeout after a reset is twice as long, because the count
/// begins at its maximum (RM0433 section 45.3.1).
const WATCHDOG_US: u32 = 250_000;

/// Timeout of the watchdog once tasks run, µs. If the core and the output both hang, the last code stays on the coil
/// for this time, and 9 % longer with the slowest LSI.
pub const RUNNING_WATCHDOG_US: u32 = 100_000;

/// Nominal clock of the watchdog, LSI, Hz. It is within 29.4 and 33.6 kHz (DS12110, LSI oscillator characteristics).
const WATCHDOG_HZ: u32 = 32_000;

/// Divider of that clock after a reset. The program does not change it.
const WATCHDOG_DIVIDER: u32 = 4;

/// Value of IWDG_RLR for a timeout in µs.
pub const fn watchdog_reload(timeout_us: u32) -> u32 {
    timeout_us / 1_000 * WATCHDOG_HZ / 1_000 / WATCHDOG_DIVIDER - 1
}

const WATCHDOG_RELOAD: u32 = watchdog_reload(WATCHDOG_US);

const _: () = assert!(WATCHDOG_RELOAD < 1 << 12);

/// The vector table in use. Its address is a multiple of its length rounded up to a power of two (ARM DDI 0403E,
/// B3.2.5).
#[repr(C, align(1024))]
struct VectorTable(UnsafeCell<[u32; VECTORS]>);

// SAFETY: written once, before interrupts are enabled; from then on only the processor reads it.
unsafe impl Sync for VectorTable {}

static VECTOR_TABLE: VectorTable = VectorTable(UnsafeCell::new([0; VECTORS]));

// cortex-m-rt's reset handler calls this first, when no variable has its value yet, so it must not be Rust. It begins
// like the bootloader, because a debug probe can start the image without the bootloader.
//
// At power-on RAM holds noise, and its error-correcting codes are wrong: one code per 64 bits in ITCM and AXI SRAM, per
// 32 bits elsewhere (DS12110, error code correction; AN5342). A store narrower than that reads the rest of the unit
// first, the processor reads ahead, and a fill of a cache line reads the neighbouring words. So these memories are
// written to their ends in units of 64 bits before anything reads them. By a count of cycles this takes some 5 ms at
// the 64 MHz of the start. The DTCM holds data that survives a reset (`.uninit`), so it is written only after power-on
// or brown-out (RCC_RSR, PORRSTF and BORRSTF), when its content is noise. `main` clears these flags. Therefore the
// fault of a start that dies before that is not kept. SRAM 1 gets its values in words (`tick/output/ring.rs`). SRAM 2,
// SRAM 3 and the backup SRAM are never read.
//
// SAFETY: in addition to the registers named here it writes ITCM, AXI SRAM, SRAM 4 and DTCM in pairs of words, before
// any variable has its value and before anything is on the stack. The function that it calls changes only two
// registers. cortex-m-rt's reset handler keeps nothing in registers across this call.
global_asm!(
    ".section .text.before_main, \"ax\", %progbits",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "    mov r6, lr",
    "    bl {make_safe}",
    // IWDG1_KR: 0x5555 opens IWDG1_RLR (RM0433 section 45.3.1).
    "    ldr r0, =0x58004800",
    "    movw r1, #0x5555",
    "    str r1, [r0]",
    "    movw r1, #{reload}",
    "    str r1, [r0, #8]",
    "    mov r4, #0",
    "    mov r5, #0",
    "    ldr r0, =0x580244D0",
    "    ldr r1, [r0]",
    "    tst r1, #0xA00000",
    "    beq 6f",
    "    ldr r0, =_stack_end",
    "    ldr r1, =_ram_end",
    "1:  cmp r0, r1",
    "    itt lo",
    "    strdlo r4, r5, [r0], #8",
    "    blo 1b",
    "6:  ldr r0, =_itcm_start",
    "    ldr r1, =_itcm_end",
    "7:  cmp r0, r1",
    "    itt lo",
    "    strdlo r4, r5, [r0], #8",
    "    blo 7b",
    "    ldr r0, =__sitcm",
    "    ldr r1, =__eitcm",
    "    ldr r2, =__siitcm",
    "2:  cmp r0, r1",
    "    ittt lo",
    "    ldrdlo r4, r5, [r2], #8",
    "    strdlo r4, r5, [r0], #8",
    "    blo 2b",
    "    ldr r0, =__stick_constants",
    "    ldr r1, =__etick_constants",
    "    ldr r2, =__sitick_constants",
    "3:  cmp r0, r1",
    "    ittt lo",
    "    ldrlo r3, [r2], #4",
    "    strlo r3, [r0], #4",
    "    blo 3b",
    "    ldr r0, =_sram4_start",
    "    ldr r1, =_sram4_end",
    "    mov r4, #0",
    "    mov r5, #0",
    "4:  cmp r0, r1",
    "    itt lo",
    "    strdlo r4, r5, [r0], #8",
    "    blo 4b",
    "    ldr r0, =_axisram_start",
    "    ldr r1, =_axisram_end",
    "5:  cmp r0, r1",
    "    itt lo",
    "    strdlo r4, r5, [r0], #8",
    "    blo 5b",
    "    dsb",
    "    isb",
    "    bx r6",
    "    .ltorg",
    ".size __pre_init, . - __pre_init",
    make_safe = sym stylus_boot::first::make_safe,
    reload = const WATCHDOG_RELOAD,
);

unsafe extern "C" {
    static __vector_table: u32;
}

/// Moves the vector table to the DTCM, so that an interrupt needs no read of flash. Also turns the caches on, for code
/// in flash and the library in AXI SRAM. `protection.rs` lists which memory is cached.
pub fn prepare_memory(scb: &mut SCB, cpuid: &mut CPUID) {
    let table = VECTOR_TABLE.0.get().cast::<u32>();
    for index in 0..VECTORS {
        // SAFETY: both tables have `VECTORS` entries, for the core and for the device.
        unsafe {
            let handler = read_volatile(addr_of!(__vector_table).add(index));
            write_volatile(table.add(index), handler);
        }
    }
    asm::dsb();
    // SAFETY: the table is filled and aligned, and handles every exception as the table before it did.
    unsafe { scb.vtor.write(table as u32) };
    asm::dsb();
    asm::isb();
    scb.enable_icache();
    scb.enable_dcache(cpuid);
}

/// Starts the processor's cycle counter, with or without a debugger.
///
/// The counter continues in WFE because `clock.rs` makes embassy keep the clocks of sleep modes on
/// (DBGMCU_CR.DBGSLEEP_D1, RM0433 section 60.5.8). The instants of ticks do not depend on the counter. The durations of
/// ticks, the marks and the waits for bank 1 do.
pub fn start_cycle_counter(dcb: &mut DCB, dwt: &mut DWT) {
    dcb.enable_trace();
    DWT::unlock();
    dwt.enable_cycle_counter();
}
