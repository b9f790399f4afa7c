//! A model of the emulator's, with something of ours around it.

use std::fmt::Debug;

use rigless::device::{Device, DeviceContext, InterruptChange, RegisterFile, RequestChange};
use rigless::emulator::InterruptLine;
use rigless::soc::{RegisterSpec, Width};
use rigless::time::{EventId, VirtualNanos};

/// What is put around a model of type `D`: it sees each call before or after the model does.
pub trait Around<D: Device>: Debug + Send {
    /// Before the model hears of a write of `value`. The registers hold already what landed.
    fn before_write(&mut self, _register: D::Register, _value: u64, _registers: &mut RegisterFile) {
    }

    /// The model `answered` a read (or left it to the register file, with `None`): what the core reads.
    fn answer(
        &mut self,
        _register: D::Register,
        answered: Option<u64>,
        _registers: &RegisterFile,
    ) -> Option<u64> {
        answered
    }

    /// After the model heard of a write of `value`.
    fn after_write(
        &mut self,
        _inner: &mut D,
        _register: D::Register,
        _value: u64,
        _registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) {
    }

    /// Before the model hears of a store of the core into the memory it programs.
    fn before_store(
        &mut self,
        _address: u64,
        _width: Width,
        _value: u64,
        _registers: &RegisterFile,
    ) {
    }

    /// An event came that one of the two asked for. True when it was ours, and ours alone.
    fn event(
        &mut self,
        _inner: &mut D,
        _event: EventId,
        _registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) -> bool {
        false
    }

    /// The clock's rate, in hertz, changed.
    fn clock(&mut self, _hz: u64) {}

    /// After any call but a peek and a reset.
    fn after(
        &mut self,
        _inner: &mut D,
        _registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) {
    }

    /// The part was reset: no event that was asked for will come.
    fn reset(&mut self) {}
}

/// `D` with `A` around it: one model of the layout that `D` answers for.
#[derive(Debug)]
pub struct Extended<D, A> {
    /// The emulator's model.
    pub inner: D,
    /// What is around it.
    pub around: A,
}

impl<D, A> Extended<D, A> {
    /// `around` around `inner`.
    pub fn new(inner: D, around: A) -> Self {
        Self { inner, around }
    }
}

impl<D: Device, A: Around<D>> Device for Extended<D, A>
where
    D::Register: Copy,
{
    type Register = D::Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        self.inner.layout()
    }

    fn read(
        &mut self,
        register: Self::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let answered = self.inner.read(register, registers, context);
        let answered = self.around.answer(register, answered, registers);
        self.around.after(&mut self.inner, registers, context);
        answered
    }

    fn peek(
        &self,
        register: Self::Register,
        registers: &RegisterFile,
        now: VirtualNanos,
    ) -> Option<u64> {
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
        self.around
            .after_write(&mut self.inner, register, value, registers, context);
        self.around.after(&mut self.inner, registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if !self
            .around
            .event(&mut self.inner, event, registers, context)
        {
            self.inner.on_event(event, registers, context);
        }
        self.around.after(&mut self.inner, registers, context);
    }

    fn on_request(
        &mut self,
        request: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.inner.on_request(request, registers, context);
        self.around.after(&mut self.inner, registers, context);
    }

    fn on_interrupt(
        &mut self,
        change: InterruptChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.inner.on_interrupt(change, registers, context);
    }

    fn acknowledge_interrupt(
        &mut self,
        line: InterruptLine,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.inner.acknowledge_interrupt(line, registers, context)
    }

    fn on_clock_input(
        &mut self,
        input: usize,
        hz: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.around.clock(hz);
        self.inner.on_clock_input(input, hz, registers, context);
        self.around.after(&mut self.inner, registers, context);
    }

    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.inner.on_access(token, value, registers, context);
        self.around.after(&mut self.inner, registers, context);
    }

    fn on_refused(
        &mut self,
        token: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.inner.on_refused(token, registers, context);
        self.around.after(&mut self.inner, registers, context);
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
        let taken = self
            .inner
            .write_region(address, width, value, registers, context);
        self.around.after(&mut self.inner, registers, context);
        taken
    }

    fn poll(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.inner.poll(registers, context);
        self.around.after(&mut self.inner, registers, context);
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
