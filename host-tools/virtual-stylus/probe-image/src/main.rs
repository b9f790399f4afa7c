//! An image that programs, erases and reads the flash, both in the ways that the stylus uses and in ways that it must
//! avoid. It obeys commands over USART3.
//!
//! TIM6 runs at 5 kHz, and its handler, which is in flash, counts. All clocks stay at the 64 MHz after reset.
//!
//! | byte | does | answers |
//! |---|---|---|
//! | `e` | erases the first sector of bank 2 | `e` |
//! | `p` | programs the next word of bank 2 with the word's number, from 1 on | `p` |
//! | `P` | programs the first word of bank 2 again | `P` |
//! | `b` | begins to program the next word of bank 2, and reads that word at once | 4 bytes |
//! | `E` | begins to erase a sector of bank 1, the bank that holds the code | `E` |
//! | `R` | erases the same sector with code in RAM | `R` |
//! | `M` | erases the same sector with code in RAM, while the MPU hides bank 1 | `M` |
//! | `r` | reads the first four bytes of each of bank 2's first four words | 4 x 4 bytes |
//! | `c` | | the number of ticks, 2 bytes |
//! | other | | `?` |
#![no_std]
#![no_main]

use core::sync::atomic::{AtomicU16, AtomicU32, Ordering};

use cortex_m::peripheral::{MPU, NVIC};
use cortex_m_rt::entry;
use panic_halt as _;
use stm32_metapac::{FLASH, RCC, TIM6, USART3, interrupt};

/// Clock cycles per tick: 64 MHz divided by this is 5 kHz.
const TICK_CYCLES: u16 = 12_800;
/// Clock cycles per bit: 64 MHz divided by this is close to 921 600 baud.
const BAUD_CYCLES: u16 = 69;
const BANK_2: usize = 0x0810_0000;
const WORDS_OF_A_FLASH_WORD: usize = 8;
/// Number of a sector of bank 1 that holds no code.
const SECTOR_WITHOUT_CODE: u8 = 7;
const WORDS_READ: usize = 4;

/// Handles a reset, before anything is in RAM.
mod start {
    #![expect(unsafe_code, reason = "registers, before any Rust code")]

    // Writes PWR_CR3, and waits for ACTVOSRDY of PWR_CSR1 (RM0433 section 6.4.1).
    //
    // SAFETY: called by cortex-m-rt's reset handler, which keeps nothing in registers.
    core::arch::global_asm!(
        ".section .text.before_main, \"ax\", %progbits",
        ".global __pre_init",
        ".type __pre_init, %function",
        ".thumb_func",
        "__pre_init:",
        "    ldr r0, =0x58024800",
        "    ldr r1, [r0, #0xC]",
        "    str r1, [r0, #0xC]",
        "2:  ldr r1, [r0, #4]",
        "    tst r1, #0x2000",
        "    beq 2b",
        "    bx lr",
        "    .ltorg",
    );
}

static TICKS: AtomicU16 = AtomicU16::new(0);

/// Number of words programmed since the start.
static PROGRAMMED: AtomicU32 = AtomicU32::new(0);

#[entry]
fn main() -> ! {
    RCC.apb1lenr().modify(|w| {
        w.set_tim6en(true);
        w.set_usart3en(true);
    });
    serial();
    tick();
    loop {
        let command = receive();
        obey(command);
    }
}

fn serial() {
    USART3.brr().write(|w| w.set_brr(BAUD_CYCLES));
    USART3.cr1().write(|w| {
        w.set_ue(true);
        w.set_te(true);
        w.set_re(true);
    });
}

#[expect(unsafe_code, reason = "the tick's interrupt is let in")]
fn tick() {
    TIM6.arr().write(|w| w.set_arr(TICK_CYCLES - 1));
    TIM6.dier().modify(|w| w.set_uie(true));
    TIM6.cr1().modify(|w| w.set_cen(true));
    // SAFETY: everything that the handler uses is set up by now.
    unsafe { NVIC::unmask(interrupt::TIM6_DAC) };
}

#[interrupt]
fn TIM6_DAC() {
    TIM6.sr().modify(|w| w.set_uif(false));
    TICKS.fetch_add(1, Ordering::Relaxed);
}

/// Handles a hard fault.
mod fault {
    #![expect(unsafe_code, reason = "a handler of exceptions")]

    use cortex_m::peripheral::SCB;
    use cortex_m_rt::{ExceptionFrame, exception};
    use stm32_metapac::{FLASH, USART3};

    /// Handles hard faults. A bus fault becomes a hard fault because the BusFault handler is disabled. Sends `!`, the
    /// status of bank 2 and the address of the bank's failed read over the serial line, then resets the part.
    // SAFETY: does not return.
    #[exception]
    unsafe fn HardFault(_frame: &ExceptionFrame) -> ! {
        super::send(b"!");
        super::send(&FLASH.bank(1).sr().read().0.to_le_bytes());
        super::send(&FLASH.bank(1).far().read().0.to_le_bytes());
        // A reset would cut off the last byte.
        while !USART3.isr().read().tc() {}
        SCB::sys_reset()
    }
}

fn receive() -> u8 {
    while !USART3.isr().read().rxne() {
        // The next tick wakes the core. A host waits for each answer, so no second byte comes meanwhile.
        cortex_m::asm::wfi();
    }
    USART3.rdr().read().dr() as u8
}

fn send(bytes: &[u8]) {
    for &byte in bytes {
        while !USART3.isr().read().txe() {}
        USART3.tdr().write(|w| w.set_dr(u16::from(byte)));
    }
}

fn obey(command: u8) {
    match command {
        b'e' => erase(),
        b'p' => program(PROGRAMMED.fetch_add(1, Ordering::Relaxed)),
        b'P' => program(0),
        b'b' => {
            let number = PROGRAMMED.fetch_add(1, Ordering::Relaxed);
            begin_program(number);
            let word = read(number as usize);
            end_program();
            return send(&word.to_le_bytes());
        }
        b'E' => begin_erase_beside_code(),
        b'R' => cortex_m::interrupt::free(|_| erase_from_ram(false)),
        b'M' => cortex_m::interrupt::free(|_| erase_from_ram(true)),
        b'r' => return (0..WORDS_READ).for_each(|word| send(&read(word).to_le_bytes())),
        b'c' => return send(&TICKS.load(Ordering::Relaxed).to_le_bytes()),
        _ => return send(b"?"),
    }
    send(&[command]);
}

fn unlock() {
    if FLASH.bank(1).cr().read().lock() {
        FLASH.bank(1).keyr().write_value(0x4567_0123);
        FLASH.bank(1).keyr().write_value(0xCDEF_89AB);
    }
}

fn wait_for_flash() {
    while FLASH.bank(1).sr().read().qw() {
        cortex_m::asm::wfi();
    }
}

fn erase() {
    unlock();
    FLASH.bank(1).cr().modify(|w| {
        w.set_ser(true);
        w.set_snb(0);
    });
    FLASH.bank(1).cr().modify(|w| w.set_start(true));
    wait_for_flash();
    FLASH.bank(1).cr().modify(|w| w.set_ser(false));
    PROGRAMMED.store(0, Ordering::Relaxed);
}

#[inline(always)]
fn begin_erase_beside_code() {
    FLASH.bank(0).keyr().write_value(0x4567_0123);
    FLASH.bank(0).keyr().write_value(0xCDEF_89AB);
    FLASH.bank(0).cr().modify(|w| {
        w.set_ser(true);
        w.set_snb(SECTOR_WITHOUT_CODE);
    });
    FLASH.bank(0).cr().modify(|w| w.set_start(true));
}

/// Erases the sector of bank 1 with code in RAM, and waits in RAM for the end. If `hides` is true, the MPU keeps the
/// processor from fetching or reading anything of the bank meanwhile.
#[expect(unsafe_code, reason = "the MPU's registers, and a section of RAM")]
#[unsafe(link_section = ".data.erase_from_ram")]
#[inline(never)]
fn erase_from_ram(hides: bool) {
    /// Region 0 at the start of bank 1 (ARM DDI 0403E, B3.5.8).
    const AT_BANK_1: u32 = 0x0800_0000 | 1 << 4;
    /// Attributes of a region of one megabyte that can be neither accessed nor executed (B3.5.9).
    const HIDDEN: u32 = 1 << 28 | 19 << 1 | 1;
    /// Turns the MPU on and leaves everything outside of the region as it is without the MPU (B3.5.6).
    const ON: u32 = 0b101;
    // SAFETY: nothing else uses the MPU, interrupts are masked, and what runs is in RAM.
    let mpu = unsafe { &*MPU::PTR };
    let control = if hides { ON } else { 0 };
    // SAFETY: as above.
    unsafe {
        mpu.rbar.write(AT_BANK_1);
        mpu.rasr.write(HIDDEN);
        mpu.ctrl.write(control);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    begin_erase_beside_code();
    while FLASH.bank(0).sr().read().qw() {}
    FLASH.bank(0).cr().modify(|w| w.set_lock(true));
    // SAFETY: as above.
    unsafe { mpu.ctrl.write(0) };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

fn place(flash_word: usize) -> usize {
    BANK_2 + flash_word * WORDS_OF_A_FLASH_WORD * size_of::<u32>()
}

fn program(number: u32) {
    begin_program(number);
    end_program();
}

#[expect(unsafe_code, reason = "programming flash is a store into it")]
fn begin_program(number: u32) {
    unlock();
    FLASH.bank(1).cr().modify(|w| w.set_pg(true));
    let start = place(number as usize) as *mut u32;
    for word in 0..WORDS_OF_A_FLASH_WORD {
        // SAFETY: bank 2 holds no code, and a store there goes to the flash's write buffer.
        unsafe { start.add(word).write_volatile(number + 1) };
    }
}

fn end_program() {
    wait_for_flash();
    FLASH.bank(1).cr().modify(|w| w.set_pg(false));
}

#[expect(unsafe_code, reason = "the flash is read as it is")]
fn read(flash_word: usize) -> u32 {
    // SAFETY: an aligned word of bank 2, which hardware may change at any time.
    unsafe { (place(flash_word) as *const u32).read_volatile() }
}
