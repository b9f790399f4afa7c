//! The first instructions after a reset, for bootloader and image. [What they assume of the silicon](../SILICON.md).
#![expect(unsafe_code, reason = "registers before they have owners")]

use core::arch::naked_asm;

use stylus_board::{BOARD, Pin};

/// The amplifier's enable.
const ENABLE: Pin = BOARD.pins.amplifier;

/// Starts the watchdog, turns the amplifier off, puts the output to mid-scale, and waits until RAM may be written.
///
/// The function writes no RAM, and changes no register of the processor but r0 and r1. A second call changes neither
/// pin, so the image takes over from the bootloader without a step.
///
/// # Safety
/// Since the reset nothing else has set the registers that this sets.
#[unsafe(naked)]
pub unsafe extern "C" fn make_safe() {
    naked_asm!(
        // IWDG1_KR: 0xCCCC starts the watchdog, and with it its clock, at half a second (RM0433 section 45.3.1). From
        // here on, whatever hangs ends in a reset.
        "    ldr r0, =0x58004800",
        "    movw r1, #0xCCCC",
        "    str r1, [r0]",
        // Clock of the port: RCC_AHB4ENR (RM0433 section 8.7.43). The read waits until the write has arrived. Then the
        // amplifier's enable becomes an output that drives low, the reset value of GPIOx_ODR: its bits of GPIOx_MODER
        // from 11 to 01 (section 11.4.1).
        "    ldr r0, =0x580244E0",
        "    ldr r1, [r0]",
        "    orr r1, r1, #{clock}",
        "    str r1, [r0]",
        "    ldr r1, [r0]",
        "    ldr r0, ={port}",
        "    ldr r1, [r0]",
        "    bic r1, r1, #{high}",
        "    str r1, [r0]",
        // Clock of DAC1: RCC_APB1LENR, bit 29 (RM0433 section 8.7.45).
        "    ldr r0, =0x580244E8",
        "    ldr r1, [r0]",
        "    orr r1, r1, #0x20000000",
        "    str r1, [r0]",
        "    ldr r1, [r0]",
        // DAC_DHR12R1 at mid-scale, DAC_CR.TSEL1 at 6, which is TIM7_TRGO (table 213) and may not change once the
        // channel is on (section 26.4.7), then DAC_CR.EN1 (section 26.7): the output begins at mid-scale.
        "    ldr r0, =0x40007400",
        "    mov r1, #2048",
        "    str r1, [r0, #8]",
        "    ldr r1, [r0]",
        "    orr r1, r1, #24",
        "    str r1, [r0]",
        "    orr r1, r1, #1",
        "    str r1, [r0]",
        // PWR_CR3 confirms its reset value, LDOEN and SCUEN. Until PWR_CSR1.ACTVOSRDY the part is in Run*, and RAM may
        // not be written (RM0433 section 6.4.1). The watchdog bounds the wait.
        "    ldr r0, =0x58024800",
        "    ldr r1, [r0, #0xC]",
        "    orr r1, r1, #6",
        "    str r1, [r0, #0xC]",
        "2:  ldr r1, [r0, #4]",
        "    tst r1, #0x2000",
        "    beq 2b",
        "    bx lr",
        "    .ltorg",
        clock = const 1 << ENABLE.port,
        port = const 0x5802_0000 + 0x400 * ENABLE.port,
        high = const 0b10 << (2 * ENABLE.number),
    )
}
