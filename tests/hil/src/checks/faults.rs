//! The fault image: each fault on request, its reset, its reason and its kind in the status, and silence after it.

use model_format::link::{FaultKind, MotionSource, QUICK_FAULT_MS, ResetReason, Status};
use postcard_rpc::{TopicDirection, topics};

use crate::bench::{Bench, is_playing, request};
use crate::board::Image;
use crate::error::Result;
use crate::library;

topics! {
    list = INJECTION;
    direction = TopicDirection::ToServer;
    | TopicTy    | MessageTy | Path                     |
    | -------    | --------- | ----                     |
    | FaultTopic | u8        | "stylus/fault-injection" |
}

/// A number that the fault image takes and that stands for no fault. The product's image counts it as malformed.
const NO_FAULT: u8 = 0;

/// A tick that is longer than its period. Playing goes on.
const LONG_TICK: u8 = 1;

/// Faults that end in a reset: number, name, reason of the reset, kind in the status.
const ENDING: [(u8, &str, ResetReason, FaultKind); 16] = [
    (4, "a panic", ResetReason::Fault, FaultKind::Panic),
    (
        9,
        "a panic in the tick",
        ResetReason::Fault,
        FaultKind::Panic,
    ),
    (5, "a hard fault", ResetReason::Fault, FaultKind::HardFault),
    (
        7,
        "a non-maskable interrupt",
        ResetReason::Fault,
        FaultKind::Nmi,
    ),
    (
        6,
        "an unexpected interrupt",
        ResetReason::Fault,
        FaultKind::UnexpectedInterrupt,
    ),
    (
        2,
        "a tick that hangs",
        ResetReason::Watchdog,
        FaultKind::TickStopped,
    ),
    (
        8,
        "a timer that stops",
        ResetReason::Watchdog,
        FaultKind::TickStopped,
    ),
    (
        3,
        "a task that hangs",
        ResetReason::Watchdog,
        FaultKind::ExecutorStopped,
    ),
    (
        32,
        "a stack that a task overflows",
        ResetReason::Fault,
        FaultKind::StackOverflow,
    ),
    (
        33,
        "a stack that the update overflows",
        ResetReason::Fault,
        FaultKind::StackOverflow,
    ),
    (
        34,
        "a write to address 0",
        ResetReason::Fault,
        FaultKind::MemoryProtection,
    ),
    (
        35,
        "a read of address 0",
        ResetReason::Fault,
        FaultKind::MemoryProtection,
    ),
    (
        36,
        "a write to the code in ITCM",
        ResetReason::Fault,
        FaultKind::MemoryProtection,
    ),
    (
        37,
        "a write to the code in flash",
        ResetReason::Fault,
        FaultKind::MemoryProtection,
    ),
    (
        38,
        "a jump to data",
        ResetReason::Fault,
        FaultKind::MemoryProtection,
    ),
    (
        39,
        "a read of external memory",
        ResetReason::Fault,
        FaultKind::MemoryProtection,
    ),
];

/// Faults that are injected in a brief run: one that a handler catches, and one that only the watchdog ends.
const BRIEF: [u8; 2] = [4, 2];

/// Flashes the fault image, injects each fault while a texture plays, and flashes the product's image again.
///
/// # Errors
/// The link or the board fails.
pub fn check(bench: &mut Bench, is_brief: bool) -> Result<()> {
    if let Some(reason) = bench.board.lacks() {
        bench.leave_out(
            "every fault ends in silence, a reset and its reason",
            reason,
        );
        return Ok(());
    }
    let injected = with_fault_image(bench, is_brief);
    // The product's image comes back whatever happened.
    let restored = exchange(bench, Image::Product);
    injected?;
    restored?;
    let takes = takes_faults(bench)?;
    bench.judge(
        "the product's image knows no fault on request",
        if takes { "takes them" } else { "refuses them" },
        "refuses them",
        !takes,
    );
    Ok(())
}

fn exchange(bench: &mut Bench, image: Image) -> Result<Status> {
    // Flashing begins with a reset, and a restart of the virtual stylus breaks its link.
    bench.board.flash(image)?;
    bench.device.reconnect()?;
    bench.wait(100)
}

/// Returns true if the image on the board takes faults on request.
fn takes_faults(bench: &Bench) -> Result<bool> {
    let malformed = |status: &Status| status.usb.malformed + status.serial.malformed;
    let before = bench.status()?;
    bench.device.publish::<FaultTopic>(&NO_FAULT)?;
    let after = bench.wait(20)?;
    Ok(malformed(&after) == malformed(&before))
}

fn with_fault_image(bench: &mut Bench, is_brief: bool) -> Result<()> {
    exchange(bench, Image::FaultInjection)?;
    let takes = takes_faults(bench)?;
    bench.judge(
        "the fault image is on the board",
        if takes {
            "takes faults"
        } else {
            "refuses them"
        },
        "takes faults",
        takes,
    );
    if !takes {
        return Ok(());
    }
    long_tick(bench)?;
    for (number, name, reason, kind) in ENDING {
        if !is_brief || BRIEF.contains(&number) {
            ends(bench, number, name, (reason, kind))?;
        }
    }
    Ok(())
}

fn long_tick(bench: &mut Bench) -> Result<()> {
    let play = library::cheap();
    let ((before, after), _) = bench.while_playing(&play, MotionSource::Host, |bench| {
        let before = bench.wait_until_heard()?;
        bench.device.publish::<FaultTopic>(&LONG_TICK)?;
        Ok((before, bench.wait(50)?))
    })?;
    let missed = after.tick.missed.saturating_sub(before.tick.missed);
    bench.judge(
        "a tick that is too long is counted, and playing goes on",
        format!("{missed} missed, {} resets", after.resets - before.resets),
        "at least 1 missed, 0 resets",
        missed > 0 && after.resets == before.resets && is_playing(&after),
    );
    Ok(())
}

fn ends(bench: &mut Bench, number: u8, name: &str, wanted: (ResetReason, FaultKind)) -> Result<()> {
    // A reset by its pin before each fault, so that a device that stays silent after several of them plays again.
    let status = bench.status()?;
    bench.board.reset()?;
    let started = bench.wait_for_restart(&status)?;
    if started.start.quick_faults > 0 {
        // A reset by the core's request, as some probes do it, does not end the count; a healthy run does.
        let healthy_ms = u64::from(QUICK_FAULT_MS) + 500;
        bench.wait(healthy_ms.saturating_sub(started.uptime_ms))?;
    }
    let play = library::cheap();
    bench.device.play(&request(&play, MotionSource::Host))?;
    let before = bench.heard_with_motions()?;
    bench.device.publish::<FaultTopic>(&number)?;
    let after = bench.wait_for_restart(&before)?;
    let kind = after.fault.as_ref().map(|fault| fault.kind);
    let found = kind.map_or("none".to_owned(), |kind| format!("{kind:?}"));
    bench.judge(
        &format!("{name} ends in a reset with its reason"),
        format!(
            "reset by {}, fault {found}, {} resets",
            after.reset,
            after.resets - before.resets
        ),
        &format!("reset by {}, fault {:?}, 1 reset", wanted.0, wanted.1),
        (after.reset, kind) == (wanted.0, Some(wanted.1)) && after.resets == before.resets + 1,
    );
    bench.judge(
        &format!("after {name} the output is at mid-scale"),
        if after.output.at_rest {
            "at mid-scale"
        } else {
            "not at rest"
        },
        "at mid-scale",
        after.output.at_rest,
    );
    Ok(())
}
