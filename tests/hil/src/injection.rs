//! Faults on request, by their numbers in `firmware/realtime/src/injection.rs`. Only the fault image accepts them.

use postcard_rpc::{TopicDirection, topics};

use crate::bench::DeviceUnderTest;
use crate::error::Result;

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
