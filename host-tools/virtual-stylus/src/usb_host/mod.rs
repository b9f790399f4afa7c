//! Software of the host on USB, as far as tests and sockets need it. It does enumeration and control requests like an
//! operating system, and serves a bulk interface, with transfers waiting in both directions, like a program.
//!
//! | step of an enumeration | USB 2.0 |
//! |---|---|
//! | the cable, 100 ms until the contacts are still | 7.1.7.3 |
//! | a reset of 10 ms, 10 ms to recover | 7.1.7.5 |
//! | the device descriptor, with up to 64 bytes, a second reset, the address, 2 ms to recover | 9.1.2, 9.2.6.3 |
//! | descriptors of device, configuration, BOS and Microsoft OS 2.0, strings, the configuration | 9.4, 9.6 |

pub mod descriptor;

use std::collections::VecDeque;

use self::descriptor::{microsoft_set, total_length};
use crate::model::usb::host::{Completion, Host, PACKET_BYTES, Transfer, TransferError, TransferId};
use crate::stylus::VirtualStylus;

const MS: u64 = 1_000_000;
/// Virtual time between two checks for transfers that have ended, ns.
const STEP_NS: u64 = 50_000;
/// Timeout of a control transfer (section 9.2.6.1).
const CONTROL_PATIENCE_NS: u64 = 5_000 * MS;

/// The descriptors that an enumeration has read, as they were on the wire.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Descriptors {
    /// The device descriptor.
    pub device: Vec<u8>,
    /// The configuration descriptor, with the descriptors that belong to it.
    pub configuration: Vec<u8>,
    /// The descriptor of further capabilities (BOS); empty for a device of USB 2.0, which has none.
    pub bos: Vec<u8>,
    /// The Microsoft OS 2.0 descriptor set, if the BOS names one.
    pub microsoft: Vec<u8>,
    /// The languages of the device's strings.
    pub languages: Vec<u8>,
    /// Manufacturer, product and serial number.
    pub strings: [Vec<u8>; 3],
}

/// Durations in an enumeration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Time from the pull-up to the first reset, ns.
    pub settle_ns: u64,
    /// Duration of a reset, ns.
    pub reset_ns: u64,
    /// Time from a reset to the first packet, ns.
    pub recovery_ns: u64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            settle_ns: 100 * MS,
            reset_ns: 10 * MS,
            recovery_ns: 10 * MS,
        }
    }
}

/// The host's software.
#[derive(Debug, Default)]
pub struct UsbHost {
    /// Durations in the enumerations of this host.
    pub timing: Timing,
    ended: Vec<Completion>,
    next_address: u8,
}

impl UsbHost {
    /// Waits for the device, resets the bus, gives the device an address, reads all of its descriptors, and configures
    /// it.
    ///
    /// # Errors
    /// No device is seen within 2 s ([`TransferError::Gone`]), or a transfer failed.
    pub fn enumerate(&mut self, stylus: &mut VirtualStylus) -> Result<Descriptors, TransferError> {
        stylus.usb(Host::plug);
        let begin_ns = stylus.now_ns();
        let sees = stylus.run_until_true(begin_ns + 2_000 * MS, MS, |stylus| {
            stylus.usb(|host, _| host.sees_device())
        });
        if !sees {
            return Err(TransferError::Gone);
        }
        stylus.run_for(self.timing.settle_ns);
        self.reset(stylus);
        self.describe(stylus)
    }

    fn describe(&mut self, stylus: &mut VirtualStylus) -> Result<Descriptors, TransferError> {
        // The first packet contains the packet size of endpoint 0.
        self.read(stylus, descriptor::DEVICE, 64)?;
        self.reset(stylus);
        self.next_address = self.next_address % 127 + 1;
        let address = self.next_address;
        self.control(stylus, Request::set_address(address), &[])?;
        stylus.usb(move |host, _| host.set_address(address));
        stylus.run_for(2 * MS);
        let mut read = Descriptors {
            device: self.read(stylus, descriptor::DEVICE, 18)?,
            ..Descriptors::default()
        };
        // The head holds the length of the whole.
        let head = self.read(stylus, descriptor::CONFIGURATION, 9)?;
        read.configuration = self.read(stylus, descriptor::CONFIGURATION, total_length(&head))?;
        if read.device.get(2..4) > Some(&[0x00, 0x02]) {
            let head = self.read(stylus, descriptor::BOS, 5)?;
            read.bos = self.read(stylus, descriptor::BOS, total_length(&head))?;
        }
        if let Some((code, length)) = microsoft_set(&read.bos) {
            let request = Request::new(0xC0, code, 0, 7, length);
            read.microsoft = self.control(stylus, request, &[])?;
        }
        read.languages = self.read(stylus, descriptor::STRING, 255)?;
        let language = match read.languages[..] {
            [_, _, low, high, ..] => u16::from_le_bytes([low, high]),
            _ => 0,
        };
        for (place, string) in [14, 15, 16].into_iter().zip(&mut read.strings) {
            if let Some(&number) = read.device.get(place).filter(|number| **number != 0) {
                let request = Request::descriptor(descriptor::STRING, number, language, 255);
                *string = self.control(stylus, request, &[])?;
            }
        }
        let value = read.configuration.get(5).copied().unwrap_or_default();
        self.control(stylus, Request::set_configuration(value), &[])?;
        Ok(read)
    }

    /// Reads the first descriptor of `kind`.
    fn read(&mut self, stylus: &mut VirtualStylus, kind: u8, length: u16) -> Result<Vec<u8>, TransferError> {
        self.control(stylus, Request::descriptor(kind, 0, 0, length), &[])
    }

    /// Resets the bus, and waits until the device has recovered.
    pub fn reset(&mut self, stylus: &mut VirtualStylus) {
        let Timing {
            reset_ns, recovery_ns, ..
        } = self.timing;
        stylus.usb(move |host, now_ns| host.reset_bus(now_ns, reset_ns));
        stylus.run_for(reset_ns + recovery_ns);
    }

    /// Makes one control request, with `data` for the device.
    ///
    /// # Errors
    /// A transfer failed or took longer than 5 s.
    pub fn control(
        &mut self,
        stylus: &mut VirtualStylus,
        request: Request,
        data: &[u8],
    ) -> Result<Vec<u8>, TransferError> {
        self.control_within(stylus, request, data, CONTROL_PATIENCE_NS)
    }

    /// Like [`UsbHost::control`], with another timeout.
    pub fn control_within(
        &mut self,
        stylus: &mut VirtualStylus,
        request: Request,
        data: &[u8],
        patience_ns: u64,
    ) -> Result<Vec<u8>, TransferError> {
        let transfer = Transfer::Control {
            setup: request.bytes(),
            data: data.to_vec(),
        };
        let id = stylus.usb(move |host, _| host.submit(transfer));
        let until_ns = stylus.now_ns() + patience_ns;
        loop {
            self.collect(stylus);
            if let Some(ended) = self.find_ended(id) {
                return ended.result;
            }
            if stylus.now_ns() >= until_ns {
                // The next turn of this loop finds the completion of the cancelled transfer.
                stylus.usb(move |host, now_ns| host.cancel(id, now_ns));
            } else {
                stylus.run_for(STEP_NS);
            }
        }
    }

    /// Ends an endpoint's halt, both at the device and at the host.
    pub fn clear_halt(&mut self, stylus: &mut VirtualStylus, endpoint: u8) -> Result<(), TransferError> {
        self.control(stylus, Request::clear_halt(endpoint), &[])?;
        stylus.usb(move |host, _| host.reset_toggle(endpoint));
        Ok(())
    }

    /// Returns the completion of a transfer if the transfer has ended and no earlier call has returned it.
    pub fn take_ended(&mut self, stylus: &mut VirtualStylus, id: TransferId) -> Option<Completion> {
        self.collect(stylus);
        self.find_ended(id)
    }

    /// Cancels transfers, as the system does when the program that requested them ends.
    pub fn call_off(&mut self, stylus: &mut VirtualStylus, ids: &[TransferId]) {
        let cancelled = ids.to_owned();
        stylus.usb(move |host, now_ns| {
            for id in cancelled {
                host.cancel(id, now_ns);
            }
        });
        self.collect(stylus);
        self.ended.retain(|ended| !ids.contains(&ended.id));
    }

    /// Moves the completions from the controller to this software.
    pub(super) fn collect(&mut self, stylus: &mut VirtualStylus) {
        let ended = stylus.usb(|host, _| host.take_completions());
        self.ended.extend(ended);
    }

    /// Returns the completion of a transfer from the collected completions, unless an earlier call has returned it.
    pub(super) fn find_ended(&mut self, id: TransferId) -> Option<Completion> {
        let position = self.ended.iter().position(|ended| ended.id == id)?;
        Some(self.ended.remove(position))
    }
}

/// A control request (USB 2.0 table 9-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Direction, kind and recipient.
    pub kind: u8,
    /// Number of the request.
    pub request: u8,
    /// First argument of the request (wValue).
    pub value: u16,
    /// Second argument of the request (wIndex).
    pub index: u16,
    /// Number of bytes in the data stage.
    pub length: u16,
}

impl Request {
    /// Creates a request from its five numbers.
    pub fn new(kind: u8, request: u8, value: u16, index: u16, length: u16) -> Self {
        Self {
            kind,
            request,
            value,
            index,
            length,
        }
    }

    /// The eight bytes of the SETUP packet.
    pub fn bytes(self) -> [u8; 8] {
        let words = [self.value, self.index, self.length].map(u16::to_le_bytes);
        let mut bytes = [self.kind, self.request, 0, 0, 0, 0, 0, 0];
        bytes[2..].copy_from_slice(words.as_flattened());
        bytes
    }

    /// Reads at most `length` bytes of the descriptor with this `kind` and `index`.
    pub fn descriptor(kind: u8, index: u8, language: u16, length: u16) -> Self {
        Self::new(0x80, 6, u16::from_le_bytes([index, kind]), language, length)
    }

    /// Sets the device's address.
    pub fn set_address(address: u8) -> Self {
        Self::new(0x00, 5, address.into(), 0, 0)
    }

    /// Chooses a configuration.
    pub fn set_configuration(value: u8) -> Self {
        Self::new(0x00, 9, value.into(), 0, 0)
    }

    /// Ends an endpoint's halt.
    pub fn clear_halt(endpoint: u8) -> Self {
        Self::new(0x02, 1, 0, endpoint.into(), 0)
    }

    /// Halts an endpoint.
    pub fn set_halt(endpoint: u8) -> Self {
        Self {
            request: 3,
            ..Self::clear_halt(endpoint)
        }
    }
}

/// Frames over a pair of bulk endpoints, as a program on the host exchanges them. Each frame is one transfer, which
/// ends with a packet that is not full.
#[derive(Debug)]
pub struct BulkFrames {
    output: u8,
    input: u8,
    bytes: usize,
    waiting: VecDeque<TransferId>,
    sending: VecDeque<TransferId>,
}

impl BulkFrames {
    /// Opens a pair of an OUT and an IN endpoint with these addresses. `waiting` IN transfers of `bytes` always wait
    /// for the device.
    pub fn open(stylus: &mut VirtualStylus, output: u8, input: u8, bytes: usize, waiting: usize) -> Self {
        let mut frames = Self {
            output: output & 0x0F,
            input: input & 0x0F,
            // A packet is at most full, so the last one cannot exceed a transfer of whole packets.
            bytes: bytes.next_multiple_of(PACKET_BYTES),
            waiting: VecDeque::new(),
            sending: VecDeque::new(),
        };
        for _ in 0..waiting {
            frames.await_one(stylus);
        }
        frames
    }

    fn await_one(&mut self, stylus: &mut VirtualStylus) {
        let (endpoint, bytes) = (self.input, self.bytes);
        let id = stylus.usb(move |host, _| host.submit(Transfer::In { endpoint, bytes }));
        self.waiting.push_back(id);
    }

    /// Sends a frame, after the frames that wait already.
    pub fn send(&mut self, stylus: &mut VirtualStylus, frame: &[u8]) {
        let (endpoint, data) = (self.output, frame.to_vec());
        let ids = stylus.usb(move |host, _| {
            // Only a packet that is not full ends a frame, so an empty one follows a full last packet.
            let is_full = data.len().is_multiple_of(PACKET_BYTES) && !data.is_empty();
            let first = host.submit(Transfer::Out { endpoint, data });
            let end = is_full.then(|| {
                host.submit(Transfer::Out {
                    endpoint,
                    data: Vec::new(),
                })
            });
            [Some(first), end]
        });
        self.sending.extend(ids.into_iter().flatten());
    }

    /// Returns the frames that have arrived since the last call.
    ///
    /// # Errors
    /// A transfer failed. The link is over then.
    pub fn receive(&mut self, usb: &mut UsbHost, stylus: &mut VirtualStylus) -> Result<Vec<Vec<u8>>, TransferError> {
        let mut frames = Vec::new();
        usb.collect(stylus);
        while let Some(&id) = self.sending.front()
            && let Some(ended) = usb.find_ended(id)
        {
            self.sending.pop_front();
            ended.result?;
        }
        while let Some(&id) = self.waiting.front()
            && let Some(ended) = usb.find_ended(id)
        {
            self.waiting.pop_front();
            let data = ended.result?;
            self.await_one(stylus);
            // The device, too, ends a frame of full packets with an empty one.
            if !data.is_empty() {
                frames.push(data);
            }
        }
        Ok(frames)
    }

    /// Cancels all transfers that wait.
    pub fn close(self, usb: &mut UsbHost, stylus: &mut VirtualStylus) {
        let waiting: Vec<TransferId> = self.sending.into_iter().chain(self.waiting).collect();
        usb.call_off(stylus, &waiting);
    }
}
