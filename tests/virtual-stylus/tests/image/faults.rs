//! Faults on request, and the end of each.

use model_format::link::{FaultKind, MotionSource, ResetReason};
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
/// later than `silent_ns` after the fault, up to and after the reset.
fn ends(fault: Injected, cause: ResetCause, kind: FaultKind, silent_ns: u64) {
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
        status.fault.map(|fault| fault.kind),
        Some(kind),
        "{fault:?}"
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
}

/// Time for the request on the line, and for the handler, or for the output to run out of codes.
const CAUGHT_NS: u64 = 3 * MS;
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
