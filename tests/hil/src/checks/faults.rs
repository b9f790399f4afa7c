//! The fault image: each fault on request, its reset, its reason and its kind in the status, and silence after it.

use model_format::link::{FaultKind, MotionSource, QUICK_FAULT_MS, ResetReason, Status};

use crate::bench::{Bench, request};
use crate::board::Image;
use crate::checks::{output, survived};
use crate::error::Result;
use crate::injection::inject;
use crate::library;

/// A number that the fault image takes and that stands for no fault. The product's image counts it as malformed.
const NO_FAULT: u8 = 0;

/// A fault that ends in a reset.
struct Ending {
    number: u8,
    name: &'static str,
    reason: ResetReason,
    kind: FaultKind,
    /// Part of the fault's text in the status.
    text: &'static str,
    /// True if a brief run injects it too.
    is_brief: bool,
}

impl Ending {
    /// A fault that a handler catches.
    const fn caught(number: u8, name: &'static str, kind: FaultKind) -> Self {
        Self {
            number,
            name,
            reason: ResetReason::Fault,
            kind,
            text: "",
            is_brief: false,
        }
    }

    /// A fault that only the watchdog ends.
    const fn starved(number: u8, name: &'static str, kind: FaultKind) -> Self {
        Self {
            reason: ResetReason::Watchdog,
            ..Self::caught(number, name, kind)
        }
    }

    /// A failure of the hardware that moves the codes, which the tick finds.
    const fn of_output(number: u8, name: &'static str) -> Self {
        Self {
            text: "output",
            ..Self::caught(number, name, FaultKind::Panic)
        }
    }

    /// The same, in brief runs too.
    const fn also_brief(self) -> Self {
        Self {
            is_brief: true,
            ..self
        }
    }
}

/// Faults that end in a reset. Brief runs have one that a handler catches, one that the watchdog ends, a core that
/// stops and so leaves the output to timer and DMA, and a failure of those.
const ENDING: [Ending; 19] = {
    use FaultKind::{
        ExecutorStopped, HardFault, MemoryProtection, Nmi, Panic, StackOverflow, TickStopped,
        UnexpectedInterrupt,
    };
    [
        Ending::caught(4, "a panic", Panic).also_brief(),
        Ending::caught(9, "a panic in the tick", Panic),
        Ending::caught(5, "a hard fault", HardFault),
        Ending::caught(7, "a non-maskable interrupt", Nmi),
        Ending::caught(6, "an unexpected interrupt", UnexpectedInterrupt),
        Ending::starved(2, "a tick that hangs", TickStopped).also_brief(),
        Ending::starved(8, "a timer that stops", TickStopped),
        Ending::starved(3, "a task that hangs", ExecutorStopped),
        Ending::starved(10, "a core that stops", ExecutorStopped).also_brief(),
        Ending::of_output(13, "a stream that feeds the converter no more").also_brief(),
        Ending::of_output(14, "a stream that erases no more"),
        Ending::caught(32, "a stack that a task overflows", StackOverflow),
        Ending::caught(33, "a stack that the update overflows", StackOverflow),
        Ending::caught(34, "a write to address 0", MemoryProtection),
        Ending::caught(35, "a read of address 0", MemoryProtection),
        Ending::caught(36, "a write to the code in ITCM", MemoryProtection),
        Ending::caught(37, "a write to the code in flash", MemoryProtection),
        Ending::caught(38, "a jump to data", MemoryProtection),
        Ending::caught(39, "a read of external memory", MemoryProtection),
    ]
};

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
    inject(bench, NO_FAULT)?;
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
    survived::check(bench)?;
    for ending in ENDING {
        if !is_brief || ending.is_brief {
            ends(bench, &ending)?;
        }
    }
    Ok(())
}

fn ends(bench: &mut Bench, wanted: &Ending) -> Result<()> {
    let Ending { number, name, .. } = *wanted;
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
    inject(bench, number)?;
    let after = bench.wait_for_restart(&before)?;
    let fault = after.fault.as_ref();
    let found = fault.map_or("none".to_owned(), |fault| {
        format!("{:?} {}", fault.kind, fault.text)
    });
    let is_wanted =
        fault.is_some_and(|fault| fault.kind == wanted.kind && fault.text.contains(wanted.text));
    bench.judge(
        &format!("{name} ends in a reset with its reason"),
        format!(
            "reset by {}, fault {found}, {} resets",
            after.reset,
            after.resets - before.resets
        ),
        &format!(
            "reset by {}, fault {:?} {}, 1 reset",
            wanted.reason, wanted.kind, wanted.text
        ),
        after.reset == wanted.reason && is_wanted && after.resets == before.resets + 1,
    );
    output::at_mid_scale(bench, &format!("after {name} the pin is at mid-scale"))
}
