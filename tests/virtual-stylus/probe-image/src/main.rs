//! An image that uses the modelled peripherals as the stylus does, and obeys commands over USART3.
//!
//! TIM6 runs at 5 kHz; its trigger latches DAC1 and starts ADC1's injected sequence of channels 15, 10, 6 and 5. The
//! tick writes a number that rises by one to the DAC. All clocks stay at the 64 MHz after reset.
//!
//! | byte | does | answers |
//! |---|---|---|
//! | `e` | erases the first sector of bank 2 | `e` |
//! | `p` | programs the next word of bank 2 with its own number | `p` |
//! | `P` | programs the first word of bank 2 again | `P` |
//! | `b` | begins to program the next word of bank 2, and reads it at once | 4 bytes |
//! | `E` | begins to erase a sector of bank 1, where the code is | `E` |
//! | `r` | reads the first words of bank 2, four bytes each | 4 x 4 bytes |
//! | `j` | | the four conversions that the last tick read, the DAC code it wrote, 2 bytes each |
//! | `c` | | the encoder's count, 2 bytes |
//! | `f` | | the reset flags, 4 bytes, and what survived a reset, 4 bytes |
//! | `k` | keeps a word over the reset | `k` |
//! | `w` | starts the watchdog with about 128 ms, and never feeds it | `w` |
//! | `d` | plays a texture's first words with the stylus's kernel and arithmetic | their digest, 4 bytes |
//! | `s` | resets the part | |
#![no_std]
#![no_main]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU16, AtomicU32, Ordering};

use cortex_m::peripheral::{NVIC, SCB};
use cortex_m_rt::entry;
use model_format::Library;
use panic_halt as _;
use stm32_metapac::adc::vals::{Exten, Pcsel, SampleTime};
use stm32_metapac::timer::vals::Mms;
use stm32_metapac::{ADC1, ADC12_COMMON, DAC1, FLASH, IWDG1, RCC, TIM3, TIM6, USART3, interrupt};
use stylus_kernel::digest::of_plan;
use stylus_kernel::scene::Plan;
use stylus_realtime::CortexM;

/// 64 MHz over this is 5 kHz.
const TICK_CYCLES: u16 = 12_800;
/// 64 MHz over this is 921 600 baud, nearly.
const BAUD_CYCLES: u16 = 69;
/// 20 µs, twice the start-up time of a converter's regulator (DS12110, t_ADCVREG_STUP).
const REGULATOR_CYCLES: u32 = 1280;
const TIM6_TRIGGER_OF_DAC: u8 = 5;
const TIM6_TRIGGER_OF_ADC: u8 = 14;
const CHANNELS: [u8; 4] = [15, 10, 6, 5];
const BANK_2: usize = 0x0810_0000;
const WORDS_OF_A_FLASH_WORD: usize = 8;
/// A sector of bank 1 behind the code.
const SECTOR_WITHOUT_CODE: u8 = 7;
const WORDS_READ: usize = 4;
const WATCHDOG_RELOAD: u16 = 1023;
const KEPT: u32 = 0x5AFE_C0DE;

static CONVERSIONS: [AtomicU16; 4] = [const { AtomicU16::new(0) }; 4];
static WRITTEN: AtomicU16 = AtomicU16::new(0);

struct Survivor(UnsafeCell<MaybeUninit<u32>>);

// SAFETY: only `main` uses it.
#[expect(unsafe_code, reason = "memory that a start does not touch")]
unsafe impl Sync for Survivor {}

#[expect(unsafe_code, reason = "memory that a start does not touch")]
#[unsafe(link_section = ".uninit.survivor")]
static SURVIVOR: Survivor = Survivor(UnsafeCell::new(MaybeUninit::uninit()));

/// Number of words programmed since the start.
static PROGRAMMED: AtomicU32 = AtomicU32::new(0);

#[entry]
fn main() -> ! {
    clocks();
    serial();
    converters();
    encoder();
    tick();
    loop {
        let command = receive();
        obey(command);
    }
}

fn clocks() {
    RCC.apb1lenr().modify(|w| {
        w.set_dac12en(true);
        w.set_tim3en(true);
        w.set_tim6en(true);
        w.set_usart3en(true);
    });
    RCC.ahb1enr().modify(|w| w.set_adc12en(true));
    // The peripherals' common clock is the HSI after a reset.
    RCC.d3ccipr()
        .modify(|w| w.set_adcsel(stm32_metapac::rcc::vals::Adcsel::PER));
}

fn serial() {
    USART3.brr().write(|w| w.set_brr(BAUD_CYCLES));
    USART3.cr1().write(|w| {
        w.set_ue(true);
        w.set_te(true);
        w.set_re(true);
    });
}

fn converters() {
    // Mid-scale before the output is on, and the trigger, which may not be selected afterwards.
    DAC1.dhr12r(0).write(|w| w.set_dhr(2048));
    DAC1.cr().modify(|w| w.set_tsel(0, TIM6_TRIGGER_OF_DAC));
    DAC1.cr().modify(|w| w.set_en(0, true));
    DAC1.cr().modify(|w| w.set_ten(0, true));

    ADC12_COMMON
        .ccr()
        .modify(|w| w.set_presc(stm32_metapac::adccommon::vals::Presc::DIV2));
    ADC1.cr().modify(|w| w.set_deeppwd(false));
    ADC1.cr().modify(|w| w.set_advregen(true));
    // By time, because revisions Z and Y have no flag of its readiness.
    cortex_m::asm::delay(REGULATOR_CYCLES);
    ADC1.cr().modify(|w| w.set_adcal(true));
    while ADC1.cr().read().adcal() {}
    ADC1.cr().modify(|w| w.set_aden(true));
    while !ADC1.isr().read().adrdy() {}
    for channel in CHANNELS.map(usize::from) {
        ADC1.pcsel()
            .modify(|w| w.set_pcsel(channel, Pcsel::PRESELECTED));
        ADC1.smpr(channel / 10)
            .modify(|w| w.set_smp(channel % 10, SampleTime::CYCLES64_5));
    }
    ADC1.jsqr().write(|w| {
        w.set_jl(CHANNELS.len() as u8 - 1);
        w.set_jextsel(TIM6_TRIGGER_OF_ADC);
        w.set_jexten(Exten::RISING_EDGE);
        for (rank, channel) in CHANNELS.into_iter().enumerate() {
            w.set_jsq(rank, channel);
        }
    });
    ADC1.cr().modify(|w| w.set_jadstart(true));
}

fn encoder() {
    TIM3.ccmr_input(0).modify(|w| {
        w.set_ccs(0, stm32_metapac::timer::vals::CcmrInputCcs::TI4);
        w.set_ccs(1, stm32_metapac::timer::vals::CcmrInputCcs::TI4);
    });
    TIM3.smcr()
        .modify(|w| w.set_sms(stm32_metapac::timer::vals::Sms::ENCODER_MODE_3));
    TIM3.cr1().modify(|w| w.set_cen(true));
}

#[expect(unsafe_code, reason = "the tick's interrupt is let in")]
fn tick() {
    TIM6.arr().write(|w| w.set_arr(TICK_CYCLES - 1));
    TIM6.cr2().modify(|w| w.set_mms(Mms::UPDATE));
    TIM6.dier().modify(|w| w.set_uie(true));
    TIM6.cr1().modify(|w| w.set_cen(true));
    // SAFETY: all that the handler uses is set up.
    unsafe { NVIC::unmask(interrupt::TIM6_DAC) };
}

#[interrupt]
fn TIM6_DAC() {
    TIM6.sr().modify(|w| w.set_uif(false));
    for (rank, conversion) in CONVERSIONS.iter().enumerate() {
        conversion.store(ADC1.jdr(rank).read().jdata() as u16, Ordering::Relaxed);
    }
    let code = WRITTEN.load(Ordering::Relaxed).wrapping_add(1) & 0xFFF;
    WRITTEN.store(code, Ordering::Relaxed);
    DAC1.dhr12r(0).write(|w| w.set_dhr(code));
}

/// Handles a hard fault.
mod fault {
    #![expect(unsafe_code, reason = "a handler of exceptions")]

    use cortex_m::peripheral::SCB;
    use cortex_m_rt::{ExceptionFrame, exception};
    use stm32_metapac::{FLASH, USART3};

    /// A bus fault ends here, since BusFault itself is off: told over the serial line, with bank 2's status and the
    /// place of its failed read, then a reset.
    // SAFETY: does not return.
    #[exception]
    unsafe fn HardFault(_frame: &ExceptionFrame) -> ! {
        super::send(b"!");
        super::send(&FLASH.bank(1).sr().read().0.to_le_bytes());
        super::send(&FLASH.bank(1).far().read().0.to_le_bytes());
        while !USART3.isr().read().tc() {}
        SCB::sys_reset()
    }
}

fn receive() -> u8 {
    while !USART3.isr().read().rxne() {
        // The next tick wakes the core, in time for one byte.
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

/// The library whose digest every platform must have.
static DIGEST_LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/digest.lib"));

/// Digest of the library's texture; 0 if it cannot be decoded.
#[inline(never)]
fn digest() -> u32 {
    let library = Library::decode(DIGEST_LIBRARY);
    let texture = library.ok().and_then(|library| library.texture_at(0));
    texture.map_or(0, |texture| {
        of_plan::<CortexM>(Plan::of_texture(texture)).value()
    })
}

fn obey(command: u8) {
    match command {
        b'd' => return send(&digest().to_le_bytes()),
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
        b'r' => return (0..WORDS_READ).for_each(|word| send(&read(word).to_le_bytes())),
        b'j' => {
            let code = WRITTEN.load(Ordering::Relaxed);
            for conversion in &CONVERSIONS {
                send(&conversion.load(Ordering::Relaxed).to_le_bytes());
            }
            return send(&code.to_le_bytes());
        }
        b'c' => return send(&TIM3.cnt().read().cnt().to_le_bytes()),
        b'f' => {
            send(&RCC.rsr().read().0.to_le_bytes());
            return send(&survivor().to_le_bytes());
        }
        b'k' => keep(KEPT),
        b'w' => {
            IWDG1.kr().write(|w| w.0 = 0xCCCC);
            IWDG1.kr().write(|w| w.0 = 0x5555);
            IWDG1.rlr().write(|w| w.set_rl(WATCHDOG_RELOAD));
            IWDG1.kr().write(|w| w.0 = 0xAAAA);
        }
        b's' => SCB::sys_reset(),
        _ => return send(b"?"),
    }
    send(&[command]);
}

#[expect(unsafe_code, reason = "memory that a start does not touch")]
fn survivor() -> u32 {
    // SAFETY: any word is an integer, and nothing else uses it.
    unsafe { SURVIVOR.0.get().cast::<u32>().read_volatile() }
}

#[expect(unsafe_code, reason = "memory that a start does not touch")]
fn keep(word: u32) {
    // SAFETY: nothing else uses it.
    unsafe { SURVIVOR.0.get().cast::<u32>().write_volatile(word) }
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

fn begin_erase_beside_code() {
    FLASH.bank(0).keyr().write_value(0x4567_0123);
    FLASH.bank(0).keyr().write_value(0xCDEF_89AB);
    FLASH.bank(0).cr().modify(|w| {
        w.set_ser(true);
        w.set_snb(SECTOR_WITHOUT_CODE);
    });
    FLASH.bank(0).cr().modify(|w| w.set_start(true));
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
