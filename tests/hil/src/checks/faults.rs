//! Tests with the fault image: rows of the converters that are read late, and each fault of [`ENDING`]. After a fault
//! there must be a reset, its reason and the kind of the fault in the status, and silence.
//!
//! Faults are requested by their numbers in `firmware/realtime/src/injection.rs`. Only the fault image accepts them.

use std::ops::Range;

use model_format::link::{Fault, FaultKind, MotionSource, QUICK_FAULT_MS, ResetReason, Status};
use postcard_rpc::{TopicDirection, topics};
use stylus_link::link::capture::Stream;

use crate::bench::{DeviceUnderTest, request};
use crate::board::Image;
use crate::checks::silent;
use crate::library;
use crate::report::{Error, Result};

/// A fault that ends in a reset.
pub struct Ending {
    /// Name of the fault in the report.
    pub name: &'static str,
    /// The fault.
    pub fault: Injected,
    /// Reason of the reset.
    pub reason: ResetReason,
    /// Kind of the fault in the status.
    pub kind: FaultKind,
    /// Part of the fault's text in the status.
    text: &'static str,
    /// Range of the address in the status; `None` if no address is required.
    address: Option<Range<u32>>,
}

impl Ending {
    const fn caught(fault: Injected, name: &'static str, kind: FaultKind) -> Self {
        Self {
            name,
            fault,
            reason: ResetReason::Fault,
            kind,
            text: "",
            address: None,
        }
    }

    /// A fault that is ended only by the watchdog.
    const fn starved(fault: Injected, name: &'static str, kind: FaultKind) -> Self {
        Self {
            reason: ResetReason::Watchdog,
            ..Self::caught(fault, name, kind)
        }
    }

    /// A failure of the hardware that moves the codes to the DAC, which the tick detects.
    const fn of_output(fault: Injected, name: &'static str) -> Self {
        Self {
            text: "output",
            ..Self::caught(fault, name, FaultKind::Panic)
        }
    }

    /// An access at `address` that the memory protection refuses.
    const fn at(address: Range<u32>, fault: Injected, name: &'static str) -> Self {
        Self {
            address: Some(address),
            ..Self::caught(fault, name, FaultKind::MemoryProtection)
        }
    }

    /// A stack that overflows into the addresses below it.
    const fn overflow(fault: Injected, name: &'static str) -> Self {
        Self {
            address: Some(BELOW_STACK),
            ..Self::caught(fault, name, FaultKind::StackOverflow)
        }
    }

    /// Returns true if the fault in the status is this fault.
    pub fn explains(&self, told: &Fault) -> bool {
        let is_there = |range: &Range<u32>| told.address.is_some_and(|at| range.contains(&at));
        told.kind == self.kind && told.text.contains(self.text) && self.address.as_ref().is_none_or(is_there)
    }
}

/// Addresses below the stack, which an overflow reaches.
const BELOW_STACK: Range<u32> = 0x1fff_fc00..0x2000_0000;

/// Faults that end in a reset. When the core stops, timer and DMA still drive the output.
pub const ENDING: [Ending; 19] = {
    use FaultKind::{ExecutorStopped, HardFault, Nmi, Panic, TickStopped, UnexpectedInterrupt};
    use Injected as I;
    const NULL: Range<u32> = 0..1;
    const ITCM: Range<u32> = 0x400..0x401;
    const FLASH: Range<u32> = 0x0800_0400..0x0800_0401;
    const DTCM: Range<u32> = 0x2000_0000..0x2002_0000;
    const EXTERNAL: Range<u32> = 0x6000_0000..0x6000_0001;
    [
        Ending::caught(I::Panic, "a panic", Panic),
        Ending::caught(I::PanicInTick, "a panic in the tick", Panic),
        Ending::caught(I::BadJump, "a hard fault", HardFault),
        Ending::caught(I::Nmi, "a non-maskable interrupt", Nmi),
        Ending::caught(I::UnexpectedInterrupt, "an unexpected interrupt", UnexpectedInterrupt),
        Ending::starved(I::EndlessTick, "a tick that hangs", TickStopped),
        Ending::starved(I::NoTick, "a timer that stops", TickStopped),
        Ending::starved(I::EndlessTask, "a task that hangs", ExecutorStopped),
        Ending::starved(I::Halt, "a core that stops", ExecutorStopped),
        Ending::of_output(I::NoTransfers, "a stream that feeds the converter no more"),
        Ending::of_output(I::NoEraser, "a stream that erases no more"),
        Ending::overflow(I::OverflowInTask, "a stack that a task overflows"),
        Ending::overflow(I::OverflowInUpdate, "a stack that the update overflows"),
        Ending::at(NULL, I::WriteToNull, "a write to address 0"),
        Ending::at(NULL, I::ReadNull, "a read of address 0"),
        Ending::at(ITCM, I::WriteToItcm, "a write to the code in ITCM"),
        Ending::at(FLASH, I::WriteToFlash, "a write to the code in flash"),
        Ending::at(DTCM, I::ExecuteData, "a jump to data"),
        Ending::at(EXTERNAL, I::ReadExternal, "a read of external memory"),
    ]
};

/// Number of critical sections that are injected, and number of a recording's blocks, of 6.4 ms each, from one section
/// to the next.
const SECTIONS: u32 = 5;
const BLOCKS_BETWEEN: u32 = 3;

/// Flashes the fault image, injects each fault while a texture plays, and flashes the product's image again.
pub fn check(bench: &mut DeviceUnderTest) -> Result<()> {
    if let Some(reason) = bench.board.lacks() {
        bench.leave_out("every fault ends in silence, a reset and its reason", reason);
        return Ok(());
    }
    let injected = with_fault_image(bench);
    // The product's image is restored whatever happened.
    let restored = exchange(bench, Image::Product);
    injected?;
    restored?;
    let name = "the product's image knows no fault on request";
    takes_faults(bench, name, false).map(drop)
}

fn exchange(bench: &mut DeviceUnderTest, image: Image) -> Result<Status> {
    // Flashing begins with a reset, and a restart of the virtual stylus breaks its link.
    bench.board.flash(image)?;
    bench.device.reconnect()?;
    bench.wait(100)
}

/// Checks whether the image on the board accepts faults on request exactly if it has to. Returns whether it accepts
/// them.
fn takes_faults(bench: &mut DeviceUnderTest, name: &str, has_to: bool) -> Result<bool> {
    let malformed = |status: &Status| status.usb.malformed + status.serial.malformed;
    let before = bench.status()?;
    inject(bench, Injected::Nothing)?;
    // A message on a topic is not answered, so the device has some time to count it.
    let after = bench.wait(20)?;
    let takes = malformed(&after) == malformed(&before);
    let told = |takes: bool| if takes { "takes them" } else { "refuses them" };
    bench.judge(name, told(takes), told(has_to), takes == has_to);
    Ok(takes)
}

fn with_fault_image(bench: &mut DeviceUnderTest) -> Result<()> {
    exchange(bench, Image::FaultInjection)?;
    let name = "the fault image takes faults on request";
    let takes = takes_faults(bench, name, true)?;
    if !takes {
        return Ok(());
    }
    late_rows(bench)?;
    ENDING.iter().try_for_each(|ending| ends(bench, ending))
}

/// Delays ticks once to before the end of the converter's first conversion, and once beyond it.
fn late_rows(bench: &mut DeviceUnderTest) -> Result<()> {
    let told = |late: u32, torn: u32| format!("{late} late conversions, {torn} torn samples");
    let (late, torn) = with_sections(bench, Injected::ShortSection)?;
    let name = "a row that is read 25 µs after its trigger is whole";
    bench.judge(name, told(late, torn), "0, 0", late == 0 && torn == 0);
    let (late, torn) = with_sections(bench, Injected::LongSection)?;
    bench.judge(
        "a row that is read 45 µs after its trigger is marked as torn",
        told(late, torn),
        format!("1 to {SECTIONS} torn samples, each counted"),
        (1..=SECTIONS).contains(&torn) && late >= torn,
    );
    Ok(())
}

/// Records while `section` delays ticks. Returns the number of late conversions and of torn samples.
fn with_sections(bench: &DeviceUnderTest, section: Injected) -> Result<(u32, u32)> {
    let before = bench.status()?;
    let mut stream = Stream::start(&bench.device)?;
    // Two intervals more than there are sections, so that the last section's samples have arrived.
    for block in 0..(SECTIONS + 2) * BLOCKS_BETWEEN {
        if bench.is_interrupted() {
            return Err(Error::Interrupted);
        }
        stream.wait()?;
        if block % BLOCKS_BETWEEN == 0 && block / BLOCKS_BETWEEN < SECTIONS {
            inject(bench, section)?;
        }
    }
    let loss = stream.stop()?;
    let after = bench.status()?;
    let late = after.tick.late_conversions.saturating_sub(before.tick.late_conversions);
    Ok((late, loss.torn_samples))
}

fn ends(bench: &mut DeviceUnderTest, wanted: &Ending) -> Result<()> {
    let Ending { name, fault, .. } = *wanted;
    // Each fault follows a reset by the pin, because after several faults in succession a device would stay silent.
    let status = bench.status()?;
    bench.board.reset()?;
    let started = bench.wait_for_restart(&status)?;
    if started.start.quick_faults > 0 {
        // A reset that the core requests, as some probes do, does not clear the count of quick faults; a healthy run
        // does.
        let healthy_ms = u64::from(QUICK_FAULT_MS) + 500;
        bench.wait(healthy_ms.saturating_sub(started.uptime_ms))?;
    }
    let play = library::cheap();
    bench.device.play(&request(&play, MotionSource::Host))?;
    let before = bench.heard_with_motions()?;
    inject(bench, fault)?;
    let after = bench.wait_for_restart(&before)?;
    let fault = after.fault.as_ref();
    let found = fault.map_or("none".to_owned(), |fault| format!("{:?} {}", fault.kind, fault.text));
    let is_wanted = fault.is_some_and(|fault| wanted.explains(fault));
    bench.judge(
        &format!("{name} ends in a reset with its reason"),
        format!(
            "reset by {}, fault {found}, {} resets",
            after.reset,
            after.resets - before.resets
        ),
        format!(
            "reset by {}, fault {:?} {}, 1 reset",
            wanted.reason, wanted.kind, wanted.text
        ),
        after.reset == wanted.reason && is_wanted && after.resets == before.resets + 1,
    );
    silent::at_mid_scale(bench, &format!("after {name} the pin is at mid-scale"))
}

topics! {
    list = INJECTION;
    direction = TopicDirection::ToServer;
    | TopicTy    | MessageTy | Path                     |
    | -------    | --------- | ----                     |
    | FaultTopic | u8        | "stylus/fault-injection" |
}

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names are those of the firmware")]
pub enum Injected {
    /// No fault. The product's image counts the message as malformed, and the fault image does nothing.
    Nothing,
    LongTick,
    EndlessTick,
    EndlessTask,
    Panic,
    BadJump,
    UnexpectedInterrupt,
    Nmi,
    NoTick,
    PanicInTick,
    Halt,
    LateTick,
    VeryLongTick,
    NoTransfers,
    NoEraser,
    AmplifierOff,
    AmplifierOn,
    /// A critical section that begins before a trigger and lasts until 25 µs after it.
    ShortSection = 30,
    /// A critical section that begins before a trigger and lasts until 45 µs after it. The first conversion ends after
    /// 31.7 µs.
    LongSection,
    OverflowInTask,
    OverflowInUpdate,
    WriteToNull,
    ReadNull,
    WriteToItcm,
    WriteToFlash,
    ExecuteData,
    ReadExternal,
    /// No fault. Sets the counts of ticks to a second before their 32 bits overflow.
    Age,
}

/// Requests a fault.
pub fn inject(bench: &DeviceUnderTest, fault: Injected) -> Result<()> {
    Ok(bench.device.publish::<FaultTopic>(&(fault as u8))?)
}
