//! Faults on request, of the image that has them.

use postcard_rpc::Key;

use crate::device::Device;

/// Faults, numbered as by the firmware's fault injection.
#[derive(Clone, Copy, Debug)]
pub enum Injected {
    LongTick = 1,
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
    OverflowInTask = 32,
    OverflowInUpdate,
    WriteToNull,
    ReadNull,
    WriteToItcm,
    WriteToFlash,
    ExecuteData,
    ReadExternal,
}

/// Requests `fault`.
pub fn inject(device: &mut Device, fault: Injected) {
    let key = Key::for_path::<u8>("stylus/fault-injection");
    device.send_frame(key, &(fault as u8));
}
