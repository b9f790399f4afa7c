//! The bootloader: from reset to the image's own reset handler.
//!
//! The bootloader runs from flash at 64 MHz, the clock after a reset. While bank 1 is erased or programmed, its
//! instruction fetches wait. Erasing a sector may take 4 s (DS12110, table 60), so the watchdog has its longest timeout
//! during an exchange, and the one of a reset after it.
#![no_std]
#![no_main]
#![expect(
    unsafe_code,
    reason = "registers and memory before they have owners, and the jump to the image"
)]

use core::arch::global_asm;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use stm32_metapac::gpio::vals::{Moder, Odr};
use stm32_metapac::iwdg::vals::{Key, Pr};
use stm32_metapac::{IWDG1, RCC};
use stylus_board::{BOARD, Pin};
use stylus_boot::map::{ACTIVE, BANK_BYTES, FLASH, SECTOR_BYTES, VERSION_MAGIC, WORD_BYTES};
use stylus_boot::registers::{BANK_1, BANK_2, Bank, words};
use stylus_boot::{first, loader, supply, word};

// The table of vectors: the stack, and the exceptions that can occur. All handlers except that of a bus fault wait for
// the watchdog.
//
// After the first instructions the RAM that the bootloader uses is written in units of 64 bits, because at power-on it
// holds noise whose error-correcting code is wrong. The image later uses this RAM as its stack; nothing in it is kept
// over a reset.
//
// SAFETY: the reset writes registers that have no owner and memory that has no values yet, and does not return.
global_asm!(
    ".section .vectors, \"a\", %progbits",
    ".word _stack_start, Reset, HardFault, HardFault, HardFault, BusFault, HardFault",
    ".rept 249",
    ".word HardFault",
    ".endr",
    ".section .text.Reset, \"ax\", %progbits",
    ".global Reset",
    ".type Reset, %function",
    ".thumb_func",
    "Reset:",
    "    bl {make_safe}",
    // CPACR: the compiler may use the floating-point unit's registers (ARM DDI 0403E, B3.2.20).
    "    ldr r0, =0xE000ED88",
    "    ldr r1, [r0]",
    "    orr r1, r1, #0xF00000",
    "    str r1, [r0]",
    "    dsb",
    "    isb",
    "    mov r4, #0",
    "    mov r5, #0",
    "    ldr r0, =_stack_end",
    "    ldr r1, =_stack_start",
    "1:  cmp r0, r1",
    "    itt lo",
    "    strdlo r4, r5, [r0], #8",
    "    blo 1b",
    "    dsb",
    "    b {main}",
    "    .ltorg",
    ".size Reset, . - Reset",
    ".section .text.HardFault, \"ax\", %progbits",
    ".global HardFault",
    ".type HardFault, %function",
    ".thumb_func",
    "HardFault:",
    "    b HardFault",
    ".size HardFault, . - HardFault",
    make_safe = sym first::make_safe,
    main = sym main,
);

/// The version, at the place where the image reads it (`map::BOOTLOADER_VERSION`).
#[unsafe(link_section = ".version")]
#[used]
static VERSION: [u32; 4] = [
    VERSION_MAGIC,
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn number(text: &str) -> u32 {
    match u32::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => panic!("a version has numbers"),
    }
}

/// The LED that is lit while the bootloader waits.
const FAULT: Pin = BOARD.fault_led();

extern "C" fn main() -> ! {
    // SAFETY: this runs once, and nothing else has taken them.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    // SAFETY: the table of vectors is there.
    unsafe { core.SCB.vtor.write(FLASH) };
    word::enable_bus_fault(&mut core.SCB);
    let cause = (RCC.rsr().read().0 >> 21) as u8;
    let mut has_exchanged = false;
    let begin = || {
        has_exchanged = true;
        supply::watch();
        set_watchdog(Pr::DIVIDE_BY256);
    };
    if loader::prepare(Banks, cause, begin).is_err() {
        stay();
    }
    if has_exchanged {
        set_watchdog(Pr::DIVIDE_BY4);
    }
    jump(&mut core.SCB)
}

/// Lights [`FAULT`], or puts it out.
fn show_fault(is_fault: bool) {
    FAULT.start_clock();
    let level = if is_fault { Odr::HIGH } else { Odr::LOW };
    let port = FAULT.registers();
    port.odr().modify(|w| w.set_odr(FAULT.number, level));
    port.moder().modify(|w| w.set_moder(FAULT.number, Moder::OUTPUT));
}

/// Ends the start, with [`FAULT`] lit, because a sector that an exchange of images cannot do without is write-protected
/// or worn. Power-on and the reset button try again.
fn stay() -> ! {
    show_fault(true);
    loop {
        pause();
    }
}

/// Waits, with [`FAULT`] lit, while the supply is too low for the flash. The wait has no limit, because no image can be
/// started before the exchange ends.
fn wait_for_supply() {
    if supply::is_low() {
        show_fault(true);
        while supply::is_low() {
            pause();
        }
        show_fault(false);
    }
}

/// Sets the watchdog to its longest count, with its clock divided by `divider`: 512 ms at 4, as after a reset, and 32 s
/// at 256. Its registers take over a value after some cycles of a 32 kHz clock (RM0433 section 45.4.4).
fn set_watchdog(divider: Pr) {
    IWDG1.kr().write(|w| w.set_key(Key::ENABLE));
    IWDG1.pr().write(|w| w.set_pr(divider));
    // The running watchdog bounds this wait.
    while IWDG1.sr().read().0 != 0 {}
    feed();
}

fn feed() {
    IWDG1.kr().write(|w| w.set_key(Key::RESET));
}

/// Feeds the watchdog, and waits for a millisecond at 64 MHz.
fn pause() {
    feed();
    cortex_m::asm::delay(64_000);
}

/// Continues at the image's reset handler, with the image's stack and vectors.
fn jump(scb: &mut SCB) -> ! {
    use cortex_m::peripheral::scb::Exception;
    let vectors = FLASH + ACTIVE.start;
    scb.disable(Exception::BusFault);
    // SAFETY: an image begins with its table of vectors, and no interrupt is enabled. If there is no image, the
    // processor faults, and the watchdog resets it.
    unsafe {
        scb.vtor.write(vectors);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        cortex_m::asm::bootload(vectors as *const u32)
    }
}

/// Resets after a panic, so that the next start tries again.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    SCB::sys_reset()
}

/// Cycles between two reads of a bank's state: 4 µs at 64 MHz. An erasure takes seconds, a word 100 µs.
const POLL_CYCLES: u32 = 256;

/// Both banks. Offsets count from the start of the flash.
struct Banks;

/// Failure of a flash operation.
#[derive(Clone, Copy, Debug)]
struct Failed;

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Banks {
    /// The bank of `offset`, and the offset in it.
    fn bank(offset: u32) -> (Bank, u32) {
        match offset.checked_sub(BANK_BYTES as u32) {
            Some(offset) => (BANK_2, offset),
            None => (BANK_1, offset),
        }
    }

    /// Runs `begin` on an unlocked bank, and waits until its operation ends, which the watchdog bounds.
    fn operate(bank: Bank, begin: impl FnOnce()) -> Result<(), Failed> {
        wait_for_supply();
        feed();
        bank.unlock();
        begin();
        while bank.is_busy() {
            cortex_m::asm::delay(POLL_CYCLES);
        }
        bank.end().map(drop).map_err(|_| Failed)
    }
}

impl ErrorType for Banks {
    type Error = Failed;
}

impl ReadNorFlash for Banks {
    const READ_SIZE: usize = WORD_BYTES;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        let read = word::read(FLASH + offset).ok_or(Failed)?;
        bytes.copy_from_slice(read.get(..bytes.len()).ok_or(Failed)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * BANK_BYTES
    }
}

impl NorFlash for Banks {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        for sector in (from..to).step_by(SECTOR_BYTES) {
            let (bank, at) = Self::bank(sector);
            Self::operate(bank, || bank.begin_erase(at))?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        for (at, word) in (offset..).step_by(WORD_BYTES).zip(words(bytes)) {
            let (bank, at) = Self::bank(at);
            Self::operate(bank, || bank.begin_program(at, &word))?;
        }
        Ok(())
    }
}
