//! A model of the emulator, wrapped in one of this board's models.

use std::fmt::Debug;

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::Width;
use rigless::time::{EventId, VirtualNanos};

/// What a model's call can use: its registers, and the machine.
pub struct Call<'a, 'c> {
    /// The registers of the model's instance.
    pub registers: &'a mut RegisterFile,
    /// The rest of the machine.
    pub context: &'a mut DeviceContext<'c>,
}

/// A wrapper of a model of type `D`, which is called before or after each call of the model.
pub trait Around<D: Device>: Debug + Send {
    /// Called before the model for a write of `value`. The registers hold the written value already.
    fn before_write(&mut self, _register: D::Register, _value: u64, _registers: &mut RegisterFile) {}

    /// Called after the model for a read, with the value that the model returned. Returns another value if the core is
    /// to receive that instead.
    fn answer(&mut self, _: D::Register, _value: u64, _registers: &RegisterFile) -> Option<u64> {
        None
    }

    /// Called after the model for a write of `value`.
    fn after_write(&mut self, _register: D::Register, _value: u64, _call: &mut Call<'_, '_>) {}

    /// Called before the model for a store of the core into the memory that the model programs.
    fn before_store(&mut self, _address: u64, _: Width, _value: u64, _registers: &RegisterFile) {}

    /// Called before the model for an event that the wrapper or the model has scheduled. There is one event per
    /// instance and instant, so both may have scheduled this event.
    fn event(&mut self, _inner: &mut D, _event: EventId, _call: &mut Call<'_, '_>) {}

    /// Called for a change of a request of any instance, before the model.
    fn request(&mut self, _change: RequestChange, _context: &mut DeviceContext<'_>) {}

    /// Called when the clock's rate, in hertz, has changed. Returns the rate at which the model runs.
    fn clock(&mut self, hz: u64) -> u64 {
        hz
    }

    /// Called after any call except a peek, a reset, and a change of a request. Changes of requests are left out
    /// because there are hundreds of them per code at the output.
    fn after(&mut self, _inner: &mut D, _call: &mut Call<'_, '_>) {}

    /// Called after a reset of the part, or of the instance alone by the clock controller. No event that was scheduled
    /// before comes any more.
    fn reset(&mut self) {}
}

/// `D` wrapped in `A`, as one model with the registers of `D`.
#[derive(Debug)]
pub struct Extended<D, A> {
    /// The emulator's model.
    pub inner: D,
    /// The wrapper.
    pub around: A,
}

impl<D, A> Extended<D, A> {
    /// Wraps `inner` in `around`.
    pub fn new(inner: D, around: A) -> Self {
        Self { inner, around }
    }
}

impl<D: Device, A: Around<D>> Extended<D, A> {
    fn after(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let mut call = Call { registers, context };
        self.around.after(&mut self.inner, &mut call);
    }
}

impl<D: Device, A: Around<D>> Device for Extended<D, A>
where
    D::Register: Copy,
{
    type Register = D::Register;

    fn read(
        &mut self,
        register: Self::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let answered = self.inner.read(register, registers, context);
        let value = answered.unwrap_or_else(|| registers.get(register));
        let answered = self.around.answer(register, value, registers).or(answered);
        self.after(registers, context);
        answered
    }

    fn peek(&self, register: Self::Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        self.inner.peek(register, registers, now)
    }

    fn write(
        &mut self,
        register: Self::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.around.before_write(register, value, registers);
        self.inner.write(register, value, registers, context);
        let mut call = Call { registers, context };
        self.around.after_write(register, value, &mut call);
        self.around.after(&mut self.inner, &mut call);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let mut call = Call { registers, context };
        self.around.event(&mut self.inner, event, &mut call);
        self.inner.on_event(event, registers, context);
        self.after(registers, context);
    }

    fn on_request(&mut self, request: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.around.request(request, context);
        self.inner.on_request(request, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let hz = self.around.clock(hz);
        self.inner.on_clock(hz, registers, context);
        self.after(registers, context);
    }

    fn on_access(&mut self, token: u64, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.inner.on_access(token, value, registers, context);
        self.after(registers, context);
    }

    fn on_refused(&mut self, token: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.inner.on_refused(token, registers, context);
        self.after(registers, context);
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        self.around.before_store(address, width, value, registers);
        let taken = self.inner.write_region(address, width, value, registers, context);
        self.after(registers, context);
        taken
    }

    fn poll(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.inner.poll(registers, context);
        self.after(registers, context);
    }

    fn reset(&mut self) {
        self.inner.reset();
        self.around.reset();
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.inner.reset_line(registers, context);
        self.around.reset();
    }
}
