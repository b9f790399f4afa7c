//! Faults on request, and the end of each.

use std::ops::Range;

use model_format::link::{Fault, FaultKind, MotionSource, ResetReason, Setting, SettingChange};
use virtual_stylus::ResetCause;
use virtual_stylus::model::dac::Cause;
use virtual_stylus::model::pin::Drive;
use virtual_stylus::motion::Motion;

use crate::device::{Device, MID_SCALE, MS, with_faults};
use crate::injected::{Injected, inject};
use crate::library;
use crate::output::amplifier_follows_the_output;

/// A device that plays a texture.
fn playing() -> Device {
    let mut device = Device::new(&with_faults(), library::options());
    device.wait_for_start();
    device
        .stylus
        .set_motion(Motion::steady(120.0, 0.01))
        .expect("the run goes on");
    device.play_until_heard("lattice", MotionSource::Sensors, 9);
    device.run_for(100 * MS);
    device
}

/// Injects `fault`; it must end in one reset for `cause`, with `kind` in the status, and the output at mid-scale no
/// later than `silent_ns` after the fault, up to and after the reset. Returns the fault as the status has it.
fn ends(fault: Injected, cause: ResetCause, kind: FaultKind, silent_ns: u64) -> Fault {
    let mut device = playing();
    let injected = device.stylus.now_ns();
    inject(&mut device, fault);
    device.keep_alive(false);
    device.run_for(700 * MS);
    let resets = device.stylus.resets().expect("the run goes on");
    assert_eq!(resets.len(), 1, "{fault:?}: {resets:?}");
    assert_eq!(resets[0].cause, cause, "{fault:?}");
    device.wait_for_start();
    let status = device.status();
    let reason = match cause {
        ResetCause::Watchdog => ResetReason::Watchdog,
        _ => ResetReason::Fault,
    };
    assert_eq!(status.reset, reason, "{fault:?}");
    assert_eq!(
        status.fault.as_ref().map(|fault| fault.kind),
        Some(kind),
        "{fault:?}: {:x?}",
        status.fault
    );
    let late: Vec<_> = (device.dac().iter())
        .filter(|output| output.at_ns > injected + silent_ns)
        .filter(|output| output.code.is_some_and(|code| code != MID_SCALE))
        .collect();
    assert!(
        late.is_empty(),
        "{fault:?}: {:?} of {} after {injected}",
        late[0],
        late.len()
    );
    let heard = device
        .dac()
        .iter()
        .filter(|output| output.code.is_some_and(|code| code != MID_SCALE));
    assert!(heard.count() > 100, "it was heard before");
    // The amplifier goes off before the output is moved, or at the reset at the latest, and comes back only after it.
    let amplifier = device.amplifier();
    let outputs = device.dac();
    assert_eq!(
        amplifier_follows_the_output(outputs, &amplifier).len(),
        2,
        "{fault:?}"
    );
    let moved = (outputs.iter())
        .find(|output| output.at_ns > injected && output.cause != Cause::Trigger)
        .expect("the reset moves it");
    let off = amplifier
        .iter()
        .find(|change| change.at_ns > injected && change.drive != Drive::High);
    assert!(off.expect("it goes off").at_ns <= moved.at_ns, "{fault:?}");
    status.fault.expect("it has a kind")
}

/// Injects `fault`, which the memory protection must refuse, at an address within `at`.
fn is_refused(fault: Injected, at: Range<u32>) {
    let kind = FaultKind::MemoryProtection;
    let told = ends(fault, ResetCause::Software, kind, CAUGHT_NS);
    let address = told.address.expect("it is known");
    assert!(at.contains(&address), "{told:x?}");
    assert!(told.program_counter != 0, "{told:x?}");
}

/// Injects `fault`, which must end as an overflow of the stack, with callers in the trace.
fn overflows(fault: Injected, silent_ns: u64) {
    let told = ends(
        fault,
        ResetCause::Software,
        FaultKind::StackOverflow,
        silent_ns,
    );
    let address = told.address.expect("it is known");
    assert!(
        (STACK_START - 1024..STACK_START).contains(&address),
        "{told:x?}"
    );
    assert!(told.text.len() > 8, "callers are known: {told:x?}");
}

/// Time for the request on the line, and for the handler, or for the output to run out of codes.
const CAUGHT_NS: u64 = 3 * MS;
/// The same, with a stack to be filled and an update to come.
const OVERFLOW_NS: u64 = 5 * MS;
/// Lowest address of the stack.
const STACK_START: u32 = 0x2000_0000;
/// Period of the watchdog, with the tolerance of its clock.
const WATCHDOG_NS: u64 = 400 * MS;

#[test]
fn a_tick_that_is_too_long_is_counted_and_playing_goes_on() {
    let mut device = playing();
    let before = device.status();
    inject(&mut device, Injected::LongTick);
    device.run_for(50 * MS);
    let after = device.status();
    assert!(after.tick.missed > before.tick.missed, "{:?}", after.tick);
    assert_eq!(after.output.mute, before.output.mute);
    assert!(device.stylus.resets().expect("the run goes on").is_empty());
}

#[test]
fn a_panic_ends_at_mid_scale_in_a_reset_with_its_reason() {
    ends(
        Injected::Panic,
        ResetCause::Software,
        FaultKind::Panic,
        CAUGHT_NS,
    );
}

#[test]
fn a_panic_in_the_tick_ends_at_mid_scale_in_a_reset_with_its_reason() {
    ends(
        Injected::PanicInTick,
        ResetCause::Software,
        FaultKind::Panic,
        CAUGHT_NS,
    );
}

#[test]
fn a_hard_fault_ends_at_mid_scale_in_a_reset_with_its_reason() {
    ends(
        Injected::BadJump,
        ResetCause::Software,
        FaultKind::HardFault,
        CAUGHT_NS,
    );
}

#[test]
fn a_non_maskable_interrupt_ends_at_mid_scale_in_a_reset_with_its_reason() {
    ends(
        Injected::Nmi,
        ResetCause::Software,
        FaultKind::Nmi,
        CAUGHT_NS,
    );
}

#[test]
fn an_unexpected_interrupt_ends_at_mid_scale_in_a_reset_with_its_reason() {
    ends(
        Injected::UnexpectedInterrupt,
        ResetCause::Software,
        FaultKind::UnexpectedInterrupt,
        CAUGHT_NS,
    );
}

#[test]
fn a_tick_that_hangs_ends_in_the_watchdogs_reset_with_its_reason() {
    ends(
        Injected::EndlessTick,
        ResetCause::Watchdog,
        FaultKind::TickStopped,
        CAUGHT_NS,
    );
}

#[test]
fn a_timer_that_stops_ends_in_the_watchdogs_reset_with_its_reason() {
    ends(
        Injected::NoTick,
        ResetCause::Watchdog,
        FaultKind::TickStopped,
        CAUGHT_NS,
    );
}

#[test]
fn a_task_that_hangs_ends_in_the_watchdogs_reset_with_its_reason() {
    ends(
        Injected::EndlessTask,
        ResetCause::Watchdog,
        FaultKind::ExecutorStopped,
        WATCHDOG_NS,
    );
}

#[test]
fn a_stack_that_a_task_overflows_ends_at_mid_scale_in_a_reset_with_its_reason() {
    overflows(Injected::OverflowInTask, OVERFLOW_NS);
}

#[test]
fn a_stack_that_the_update_overflows_ends_at_mid_scale_in_a_reset_with_its_reason() {
    overflows(Injected::OverflowInUpdate, OVERFLOW_NS);
}

#[test]
fn null_can_be_neither_written_nor_read() {
    is_refused(Injected::WriteToNull, 0..1);
    is_refused(Injected::ReadNull, 0..1);
}

#[test]
fn code_can_not_be_written_in_itcm_and_in_flash() {
    is_refused(Injected::WriteToItcm, 0x400..0x401);
    is_refused(Injected::WriteToFlash, 0x0800_0400..0x0800_0401);
}

#[test]
fn data_can_not_be_executed() {
    is_refused(Injected::ExecuteData, 0x2000_0000..0x2002_0000);
}

#[test]
fn external_memory_can_not_be_read() {
    is_refused(Injected::ReadExternal, 0x6000_0000..0x6000_0001);
}

#[test]
fn the_coil_is_as_warm_after_a_reset_as_before_and_nothing_is_known_after_power_on() {
    let mut device = Device::new(&with_faults(), library::options());
    device.wait_for_start();
    let load = |device: &mut Device| device.status().output.thermal_load_permille;
    let first = load(&mut device);
    assert!((700..=750).contains(&first), "{first} after power-on");
    let shortest = SettingChange {
        setting: Setting::ThermalTimeConstant,
        value: 1.0,
    };
    device
        .change_settings(&[shortest])
        .expect("within its range");
    device.run_for(1_200 * MS);
    let before = load(&mut device);
    assert!((1..300).contains(&before), "{before} before the reset");
    inject(&mut device, Injected::Panic);
    device.run_for(300 * MS);
    device.wait_for_start();
    let status = device.status();
    assert_eq!(status.reset, ResetReason::Fault);
    // It has cooled a little since, and by no more than the time for it allows.
    let after = status.output.thermal_load_permille;
    assert!(
        after <= before && after > before / 2,
        "{before} before and {after} after"
    );
}
