//! From reset to `main`: the output to mid-scale, then code, constants and vectors to where the tick finds them.
#![expect(
    unsafe_code,
    reason = "memory is laid out, and the processor's own registers are set, before there are any owners"
)]

use core::arch::global_asm;
use core::cell::UnsafeCell;
use core::ptr::{addr_of, read_volatile, write_volatile};

use cortex_m::asm;
use cortex_m::peripheral::{CPUID, DCB, DWT, SCB};

/// Entries of the vector table: 16 of the core and 150 of the STM32H743 (RM0433 table 148).
const VECTORS: usize = 166;

/// The vector table in use. Its address is a multiple of its length, rounded up to a power of two (ARM DDI 0403E, B3.2.5).
#[repr(C, align(1024))]
struct VectorTable(UnsafeCell<[u32; VECTORS]>);

// SAFETY: written once, before interrupts are on; from then on the processor alone reads it.
unsafe impl Sync for VectorTable {}

static VECTOR_TABLE: VectorTable = VectorTable(UnsafeCell::new([0; VECTORS]));

// Runs first of all, by cortex-m-rt's reset handler, when no variable has its value yet; Rust must not run then.
//
// SAFETY: besides the registers named here it writes only the three sections that the linker reserves for it (`tick.x`), in
// words, between bounds that are multiples of eight. It calls nothing, and may change the registers that it does: the
// caller keeps none of them.
global_asm!(
    ".section .text.before_main, \"ax\", %progbits",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    // The clock of DAC1: RCC_APB1LENR, bit 29 (RM0433 section 8.7.45). The read lets it arrive.
    "    ldr r0, =0x580244E8",
    "    ldr r1, [r0]",
    "    orr r1, r1, #0x20000000",
    "    str r1, [r0]",
    "    ldr r1, [r0]",
    // DAC_DHR12R1 at mid-scale, then DAC_CR.EN1 (RM0433 section 26.7): from its first instant it drives nothing else.
    "    ldr r0, =0x40007400",
    "    mov r1, #2048",
    "    str r1, [r0, #8]",
    "    ldr r1, [r0]",
    "    orr r1, r1, #1",
    "    str r1, [r0]",
    "    ldr r0, =__sitcm",
    "    ldr r1, =__eitcm",
    "    ldr r2, =__siitcm",
    "2:  cmp r0, r1",
    "    ittt lo",
    "    ldrlo r3, [r2], #4",
    "    strlo r3, [r0], #4",
    "    blo 2b",
    "    ldr r0, =__stick_constants",
    "    ldr r1, =__etick_constants",
    "    ldr r2, =__sitick_constants",
    "3:  cmp r0, r1",
    "    ittt lo",
    "    ldrlo r3, [r2], #4",
    "    strlo r3, [r0], #4",
    "    blo 3b",
    "    ldr r0, =__ssram4",
    "    ldr r1, =__esram4",
    "    mov r3, #0",
    "4:  cmp r0, r1",
    "    itt lo",
    "    strlo r3, [r0], #4",
    "    blo 4b",
    "    dsb",
    "    isb",
    "    bx lr",
    "    .ltorg",
    ".size __pre_init, . - __pre_init",
);

unsafe extern "C" {
    static __vector_table: u32;
}

/// Moves the vector table to the DTCM, so that not even taking an interrupt reads flash, and turns the caches on: for code
/// in flash and for the library in AXI SRAM. Nothing of this firmware uses DMA, so no memory needs to stay uncached.
pub fn prepare_memory(scb: &mut SCB, cpuid: &mut CPUID) {
    let table = VECTOR_TABLE.0.get().cast::<u32>();
    for index in 0..VECTORS {
        // SAFETY: cortex-m-rt's table has this many entries, those of the core and those of the device, and so has ours.
        unsafe {
            let handler = read_volatile(addr_of!(__vector_table).add(index));
            write_volatile(table.add(index), handler);
        }
    }
    asm::dsb();
    // SAFETY: the table is filled and aligned, and handles every exception as the one before it.
    unsafe { scb.vtor.write(table as u32) };
    asm::dsb();
    asm::isb();
    scb.enable_icache();
    scb.enable_dcache(cpuid);
}

/// Has the processor count its cycles, debugger or not.
pub fn start_cycle_counter(dcb: &mut DCB, dwt: &mut DWT) {
    dcb.enable_trace();
    DWT::unlock();
    dwt.enable_cycle_counter();
}
