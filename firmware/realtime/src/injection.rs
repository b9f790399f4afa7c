//! Faults on request, for the tests of the fault handlers. Compiled only with the feature `fault-injection`.
//!
//! A message of one byte on the topic [`PATH`] requests a fault. The released image does not know the topic.
#![expect(unsafe_code, reason = "faults are what this is for")]

use core::arch::asm;
use core::hint::black_box;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use cortex_m::peripheral::{DWT, NVIC, SCB};
use embassy_stm32::interrupt::Interrupt;
use embassy_stm32::pac::{DMA1, TIM6};
use postcard_rpc::Key;
use postcard_rpc::header::{VarHeader, VarKey};

use crate::boot::clock::{CORE_HZ, TIMER_HZ};
use crate::tick::output::amplifier;

/// The topic's path.
pub const PATH: &str = "stylus/fault-injection";

/// The topic's key; its message is a `u8`.
pub const KEY: Key = Key::for_path::<u8>(PATH);

/// A tick that takes more than two periods, 420 µs.
const LONG_TICK: u8 = 1;
/// A tick that never ends.
const ENDLESS_TICK: u8 = 2;
/// A task that never yields.
const ENDLESS_TASK: u8 = 3;
/// A panic.
const PANIC: u8 = 4;
/// A jump to an address that is no Thumb instruction.
const BAD_JUMP: u8 = 5;
/// An interrupt without a handler.
const UNEXPECTED_INTERRUPT: u8 = 6;
/// A non-maskable interrupt.
const NMI: u8 = 7;
/// A stop of the sample timer.
const NO_TICK: u8 = 8;
/// A panic in the tick.
const PANIC_IN_TICK: u8 = 9;
/// A core that stops responding to all interrupts, like one that a debugger halts or that locks up.
const HALT: u8 = 10;
/// A tick whose sample comes 150 µs late.
const LATE_TICK: u8 = 11;
/// A tick that takes more than six periods, 1.25 ms.
const VERY_LONG_TICK: u8 = 12;
/// A transfer error of the stream that feeds the converter.
const NO_TRANSFERS: u8 = 13;
/// A transfer error of the stream that overwrites codes that have been put out.
const NO_ERASER: u8 = 14;
/// Turns the amplifier off, and with the next value on again.
const AMPLIFIER_OFF: u8 = 15;
const AMPLIFIER_ON: u8 = 16;

/// A critical section from before a trigger until 25 µs after it.
const SHORT_SECTION: u8 = 30;
/// A critical section from before a trigger until 45 µs after it.
const LONG_SECTION: u8 = 31;
/// A recursion in a task that overflows the stack.
const OVERFLOW_IN_TASK: u8 = 32;
/// A recursion in the update that overflows the stack.
const OVERFLOW_IN_UPDATE: u8 = 33;
/// A write to address 0.
const WRITE_TO_NULL: u8 = 34;
/// A read of address 0.
const READ_NULL: u8 = 35;
/// A write to the code in ITCM.
const WRITE_TO_ITCM: u8 = 36;
/// A write to the code in flash.
const WRITE_TO_FLASH: u8 = 37;
/// A jump to data.
const EXECUTE_DATA: u8 = 38;
/// A read of external memory, which the board does not have.
const READ_EXTERNAL: u8 = 39;
/// No fault: sets the counts of ticks to their values after ten days, shortly before they reach the ends of 32 bits.
const AGE: u8 = 40;

static IN_TICK: AtomicU8 = AtomicU8::new(0);

/// True while the next update is to overflow the stack.
static IN_UPDATE: AtomicBool = AtomicBool::new(false);

/// The instruction `bx lr`, in data.
static CODE: AtomicU32 = AtomicU32::new(0x4770_4770);

/// Causes the fault that `frame` requests, now or in the next tick. Returns false if the frame requests none. `age`
/// sets the counts of ticks, which belong to the tick.
pub fn take(frame: &[u8], age: fn()) -> bool {
    let asked = VarHeader::take_from_slice(frame)
        .filter(|(header, _)| header.key == VarKey::Key8(KEY))
        .and_then(|(_, body)| body.first());
    if let Some(&fault) = asked {
        inject(fault, age);
    }
    asked.is_some()
}

fn inject(fault: u8, age: fn()) {
    match fault {
        LONG_TICK | ENDLESS_TICK | PANIC_IN_TICK | LATE_TICK | VERY_LONG_TICK => {
            IN_TICK.store(fault, Ordering::Relaxed);
        }
        HALT => halt(),
        NO_TRANSFERS => DMA1.st(0).cr().modify(|w| w.set_en(false)),
        NO_ERASER => DMA1.st(1).cr().modify(|w| w.set_en(false)),
        AMPLIFIER_OFF => amplifier::disable(),
        AMPLIFIER_ON => amplifier::enable(),
        ENDLESS_TASK => spin(),
        PANIC => panic!("asked for"),
        // SAFETY: no guarantee is needed. The processor refuses the jump, which is the fault (INVSTATE, ARM DDI 0403E,
        // B1.5.14).
        BAD_JUMP => unsafe { asm!("bx {}", in(reg) 0x0802_0000, options(noreturn)) },
        UNEXPECTED_INTERRUPT => {
            // SAFETY: no critical section masks by priority, and the handler is the default one.
            unsafe { NVIC::unmask(Interrupt::SAI4) };
            NVIC::pend(Interrupt::SAI4);
        }
        // SAFETY: ICSR.NMIPENDSET (ARM DDI 0403E, B3.2.4); its handler ends the program.
        NMI => unsafe { (*SCB::PTR).icsr.write(1 << 31) },
        OVERFLOW_IN_TASK => {
            black_box(descend(0));
        }
        OVERFLOW_IN_UPDATE => IN_UPDATE.store(true, Ordering::Relaxed),
        WRITE_TO_NULL => store(0),
        READ_NULL => load(0),
        WRITE_TO_ITCM => store(0x0400),
        WRITE_TO_FLASH => store(0x0800_0400),
        READ_EXTERNAL => load(0x6000_0000),
        EXECUTE_DATA => {
            let code = CODE.as_ptr() as usize | 1;
            // SAFETY: the processor refuses the fetch, which is the fault; otherwise the code returns at once.
            unsafe { asm!("blx {}", in(reg) code, out("lr") _) }
        }
        NO_TICK => TIM6.cr1().modify(|w| w.set_cen(false)),
        AGE => age(),
        SHORT_SECTION => delay_tick(25),
        LONG_SECTION => delay_tick(45),
        _ => {}
    }
}

/// Masks all interrupts from some microseconds before a trigger until `after_us` after it.
fn delay_tick(after_us: u32) {
    let count = || u32::from(TIM6.cnt().read().cnt());
    let period = u32::from(TIM6.arr().read().arr());
    while count() < period / 2 {}
    cortex_m::interrupt::free(|_| {
        while count() >= period / 2 {}
        while count() < after_us * (TIMER_HZ / 1_000_000) {}
    });
}

/// Causes the fault that was requested for the tick, if any.
///
/// # Panics
/// If a panic was requested.
#[inline(always)]
pub fn in_tick() {
    match IN_TICK.swap(0, Ordering::Relaxed) {
        LONG_TICK => wait_us(420),
        VERY_LONG_TICK => wait_us(1250),
        ENDLESS_TICK => spin(),
        PANIC_IN_TICK => panic!("asked for, in the tick"),
        _ => {}
    }
}

/// Delays the sample if that was requested, to simulate a late tick.
#[inline(always)]
pub fn before_output() {
    if IN_TICK.load(Ordering::Relaxed) == LATE_TICK {
        IN_TICK.store(0, Ordering::Relaxed);
        wait_us(150);
    }
}

#[inline(always)]
fn wait_us(microseconds: u32) {
    let begin = DWT::cycle_count();
    while DWT::cycle_count().wrapping_sub(begin) < CORE_HZ / 1_000_000 * microseconds {}
}

/// Masks all exceptions except the non-maskable interrupt, and loops forever.
fn halt() -> ! {
    // SAFETY: nothing else runs any more (FAULTMASK, ARM DDI 0403E, B1.4.3).
    unsafe { asm!("cpsid f") };
    spin()
}

/// Overflows the stack if that was requested for the update.
#[inline(always)]
pub fn in_update() {
    if IN_UPDATE.load(Ordering::Relaxed) {
        black_box(descend(0));
    }
}

/// Overflows the stack: each call uses some of the stack and calls the function again. The code is in ITCM, because the
/// update calls it.
#[inline(never)]
#[unsafe(link_section = ".itcm.injection")]
#[expect(unconditional_recursion, reason = "this is the fault")]
fn descend(depth: u32) -> u32 {
    let taken = black_box([depth; 12]);
    descend(depth.wrapping_add(1)).wrapping_add(taken[0])
}

/// Writes a word. It is in assembly, because the compiler may remove a write to null.
fn store(address: u32) {
    // SAFETY: the processor refuses the access, which is the fault.
    unsafe { asm!("str {0}, [{0}]", in(reg) address) }
}

/// Reads a word.
fn load(address: u32) {
    // SAFETY: as for `store`.
    unsafe { asm!("ldr {0}, [{0}]", inout(reg) address => _) }
}

fn spin() -> ! {
    loop {
        cortex_m::asm::nop();
    }
}
