//! The software of the host on USB, as far as a test or a socket needs it: enumeration, control requests, and a bulk
//! interface with transfers waiting both ways, as an operating system and a program on it have them.
//!
//! | step of an enumeration | USB 2.0 |
//! |---|---|
//! | the cable, 100 ms until the contacts are still | 7.1.7.3 |
//! | a reset of 10 ms, 10 ms to recover | 7.1.7.5 |
//! | the device descriptor's first 8 bytes, a second reset, the address, 2 ms to recover | 9.1.2, 9.2.6.3 |
//! | descriptors of device, configuration, BOS and Microsoft OS 2.0, strings, the configuration | 9.4, 9.6 |

use std::collections::VecDeque;

use crate::error::Result;
use crate::model::usb::host::{
    Completion, Host, PACKET_BYTES, Transfer, TransferError, TransferId,
};
use crate::stylus::VirtualStylus;

const MS: u64 = 1_000_000;
/// Between two looks at what has come.
const STEP_NS: u64 = 50_000;
/// How long a control transfer may take (section 9.2.6.1).
const CONTROL_PATIENCE_NS: u64 = 5_000 * MS;

/// What a transfer came to, if the run goes on.
pub type Transferred<T> = Result<std::result::Result<T, TransferError>>;

/// The instant of a transfer's end, in nanoseconds of virtual time, and what came from the device.
pub type Arrived = (u64, Vec<u8>);

/// A descriptor's type (USB 2.0 table 9-5, USB 3.2 table 9-6).
pub mod descriptor {
    #![expect(missing_docs, reason = "each is named as the specification does")]

    pub const DEVICE: u8 = 1;
    pub const CONFIGURATION: u8 = 2;
    pub const STRING: u8 = 3;
    pub const INTERFACE: u8 = 4;
    pub const ENDPOINT: u8 = 5;
    pub const DEVICE_QUALIFIER: u8 = 6;
    pub const INTERFACE_ASSOCIATION: u8 = 11;
    pub const BOS: u8 = 15;
    pub const DEVICE_CAPABILITY: u8 = 16;
}

/// A control request (USB 2.0 table 9-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Direction, kind and recipient.
    pub kind: u8,
    /// Which.
    pub request: u8,
    /// Its first number.
    pub value: u16,
    /// Its second number.
    pub index: u16,
    /// Bytes of the data stage.
    pub length: u16,
}

impl Request {
    /// The SETUP packet's data.
    pub fn bytes(self) -> [u8; 8] {
        let [value_0, value_1] = self.value.to_le_bytes();
        let [index_0, index_1] = self.index.to_le_bytes();
        let [length_0, length_1] = self.length.to_le_bytes();
        [
            self.kind,
            self.request,
            value_0,
            value_1,
            index_0,
            index_1,
            length_0,
            length_1,
        ]
    }

    /// The descriptor of `kind` with this index, at most `length` bytes of it.
    pub fn descriptor(kind: u8, index: u8, language: u16, length: u16) -> Self {
        Self {
            kind: 0x80,
            request: 6,
            value: u16::from_le_bytes([index, kind]),
            index: language,
            length,
        }
    }

    /// A standard request to the device without data.
    pub fn set_address(address: u8) -> Self {
        Self {
            kind: 0x00,
            request: 5,
            value: address.into(),
            index: 0,
            length: 0,
        }
    }

    /// Chooses a configuration.
    pub fn set_configuration(value: u8) -> Self {
        Self {
            kind: 0x00,
            request: 9,
            value: value.into(),
            index: 0,
            length: 0,
        }
    }

    /// Ends an endpoint's halt.
    pub fn clear_halt(endpoint: u8) -> Self {
        Self {
            kind: 0x02,
            request: 1,
            value: 0,
            index: endpoint.into(),
            length: 0,
        }
    }

    /// Halts an endpoint.
    pub fn set_halt(endpoint: u8) -> Self {
        Self {
            request: 3,
            ..Self::clear_halt(endpoint)
        }
    }
}

/// What an enumeration read, each as it came over the wire.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Descriptors {
    /// The device's.
    pub device: Vec<u8>,
    /// The configuration's, with all that belongs to it.
    pub configuration: Vec<u8>,
    /// What the device can do beyond (BOS), if it tells.
    pub bos: Vec<u8>,
    /// The set for Microsoft's systems, if BOS names one.
    pub microsoft: Vec<u8>,
    /// The languages of its strings.
    pub languages: Vec<u8>,
    /// Manufacturer, product and serial number.
    pub strings: [Vec<u8>; 3],
}

/// How patient the host is with a cable that was just plugged in, and how long it drives a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// From the pull-up to the first reset, nanoseconds.
    pub settle_ns: u64,
    /// A reset, nanoseconds.
    pub reset_ns: u64,
    /// From a reset to the first packet, nanoseconds.
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
    /// How it enumerates.
    pub timing: Timing,
    ended: Vec<Completion>,
    next_address: u8,
}

impl UsbHost {
    /// Waits for the device, resets the bus, gives the device an address, reads all that it describes itself with, and
    /// configures it.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed.
    pub fn enumerate(&mut self, stylus: &mut VirtualStylus) -> Transferred<Descriptors> {
        stylus.usb(Host::plug)?;
        let begin_ns = stylus.now_ns();
        let sees = stylus.run_until_true(begin_ns + 2_000 * MS, MS, |stylus| {
            stylus.usb(|host, _| host.sees_device())
        })?;
        if !sees {
            return Ok(Err(TransferError::Gone));
        }
        stylus.run_for(self.timing.settle_ns)?;
        self.reset(stylus)?;
        self.describe(stylus)
    }

    fn describe(&mut self, stylus: &mut VirtualStylus) -> Transferred<Descriptors> {
        macro_rules! ask {
            ($request:expr) => {
                match self.control(stylus, $request, &[])? {
                    Ok(data) => data,
                    Err(error) => return Ok(Err(error)),
                }
            };
        }
        // The first packet tells the size of endpoint 0's.
        ask!(Request::descriptor(descriptor::DEVICE, 0, 0, 64));
        self.reset(stylus)?;
        self.next_address = self.next_address % 127 + 1;
        let address = self.next_address;
        ask!(Request::set_address(address));
        stylus.usb(move |host, _| host.set_address(address))?;
        stylus.run_for(2 * MS)?;
        let mut read = Descriptors {
            device: ask!(Request::descriptor(descriptor::DEVICE, 0, 0, 18)),
            ..Descriptors::default()
        };
        let head = ask!(Request::descriptor(descriptor::CONFIGURATION, 0, 0, 9));
        let total = total_length(&head);
        read.configuration = ask!(Request::descriptor(descriptor::CONFIGURATION, 0, 0, total));
        if read.device.get(2..4) > Some(&[0x00, 0x02]) {
            let head = ask!(Request::descriptor(descriptor::BOS, 0, 0, 5));
            read.bos = ask!(Request::descriptor(
                descriptor::BOS,
                0,
                0,
                total_length(&head)
            ));
        }
        if let Some((code, length)) = microsoft_set(&read.bos) {
            read.microsoft = ask!(Request {
                kind: 0xC0,
                request: code,
                value: 0,
                index: 7,
                length,
            });
        }
        read.languages = ask!(Request::descriptor(descriptor::STRING, 0, 0, 255));
        let language = match read.languages[..] {
            [_, _, low, high, ..] => u16::from_le_bytes([low, high]),
            _ => 0,
        };
        for (place, string) in [14, 15, 16].into_iter().zip(&mut read.strings) {
            if let Some(&number) = read.device.get(place).filter(|number| **number != 0) {
                *string = ask!(Request::descriptor(
                    descriptor::STRING,
                    number,
                    language,
                    255
                ));
            }
        }
        let value = read.configuration.get(5).copied().unwrap_or_default();
        ask!(Request::set_configuration(value));
        Ok(Ok(read))
    }

    /// Resets the bus, and waits until the device has recovered.
    ///
    /// # Errors
    /// The run is over.
    pub fn reset(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        let Timing {
            reset_ns,
            recovery_ns,
            ..
        } = self.timing;
        stylus.usb(move |host, now_ns| host.reset_bus(now_ns, reset_ns))?;
        stylus.run_for(reset_ns + recovery_ns)
    }

    /// One control request, with `data` for the device.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed or took longer than 5 s.
    pub fn control(
        &mut self,
        stylus: &mut VirtualStylus,
        request: Request,
        data: &[u8],
    ) -> Transferred<Vec<u8>> {
        let transfer = Transfer::Control {
            setup: request.bytes(),
            data: data.to_vec(),
        };
        let id = stylus.usb(move |host, _| host.submit(transfer))?;
        Ok(self
            .wait(stylus, id, CONTROL_PATIENCE_NS)?
            .map(|(_, data)| data))
    }

    /// Ends an endpoint's halt, at both ends.
    ///
    /// # Errors
    /// As [`UsbHost::control`].
    pub fn clear_halt(&mut self, stylus: &mut VirtualStylus, endpoint: u8) -> Transferred<()> {
        let cleared = self.control(stylus, Request::clear_halt(endpoint), &[])?;
        if cleared.is_ok() {
            stylus.usb(move |host, _| host.reset_toggle(endpoint))?;
        }
        Ok(cleared.map(|_| ()))
    }

    /// Waits for a transfer's end: when it was, and what came from the device.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed, or was called off because `patience_ns` had passed.
    pub fn wait(
        &mut self,
        stylus: &mut VirtualStylus,
        id: TransferId,
        patience_ns: u64,
    ) -> Transferred<Arrived> {
        let until_ns = stylus.now_ns() + patience_ns;
        loop {
            self.collect(stylus)?;
            if let Some(Completion { at_ns, result, .. }) = self.find_ended(id) {
                return Ok(result.map(|data| (at_ns, data)));
            }
            if stylus.now_ns() >= until_ns {
                stylus.usb(move |host, now_ns| host.cancel(id, now_ns))?;
            } else {
                stylus.run_for(STEP_NS)?;
            }
        }
    }

    /// Takes the end of a transfer, if it has ended.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_ended(
        &mut self,
        stylus: &mut VirtualStylus,
        id: TransferId,
    ) -> Result<Option<Completion>> {
        self.collect(stylus)?;
        Ok(self.find_ended(id))
    }

    /// Calls transfers off, as when the program that asked for them ends.
    ///
    /// # Errors
    /// The run is over.
    pub fn call_off(&mut self, stylus: &mut VirtualStylus, ids: &[TransferId]) -> Result<()> {
        let cancelled = ids.to_owned();
        stylus.usb(move |host, now_ns| {
            for id in cancelled {
                host.cancel(id, now_ns);
            }
        })?;
        self.collect(stylus)?;
        self.ended.retain(|ended| !ids.contains(&ended.id));
        Ok(())
    }

    fn collect(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        let ended = stylus.usb(|host, _| host.take_completions())?;
        self.ended.extend(ended);
        Ok(())
    }

    fn find_ended(&mut self, id: TransferId) -> Option<Completion> {
        let position = self.ended.iter().position(|ended| ended.id == id)?;
        Some(self.ended.remove(position))
    }
}

/// `wTotalLength`, at the same place in a configuration and a BOS.
fn total_length(head: &[u8]) -> u16 {
    match *head {
        [_, _, low, high, ..] => u16::from_le_bytes([low, high]),
        _ => 0,
    }
}

/// `D8DD60DF-4589-4CC7-9CD2-659D9E648A9F`, as the wire has it (Microsoft OS 2.0 Descriptors Specification, table 4).
pub const MICROSOFT_PLATFORM: [u8; 16] = [
    0xDF, 0x60, 0xDD, 0xD8, 0x89, 0x45, 0xC7, 0x4C, 0x9C, 0xD2, 0x65, 0x9D, 0x9E, 0x64, 0x8A, 0x9F,
];

/// Vendor code and length of the set for Microsoft's systems that a BOS names.
pub fn microsoft_set(bos: &[u8]) -> Option<(u8, u16)> {
    let mut rest = bos.get(5..)?;
    while let Some(&length) = rest.first().filter(|length| **length > 2) {
        let capability = rest.get(..usize::from(length))?;
        if capability.get(4..20) == Some(&MICROSOFT_PLATFORM) {
            let [low, high] = [*capability.get(24)?, *capability.get(25)?];
            return Some((*capability.get(26)?, u16::from_le_bytes([low, high])));
        }
        rest = &rest[usize::from(length)..];
    }
    None
}

/// The descriptors within those of a configuration, each with its length and type first.
pub fn parts(configuration: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = configuration;
    std::iter::from_fn(move || {
        let length = usize::from(*rest.first()?);
        let (part, behind) = rest.split_at_checked(length.max(2))?;
        rest = behind;
        Some(part)
    })
}

/// Addresses of the first bulk endpoint to the device and the first one from it.
pub fn bulk_endpoints(configuration: &[u8]) -> Option<[u8; 2]> {
    let bulk = |from_device: bool| {
        parts(configuration).find_map(|part| match *part {
            [_, descriptor::ENDPOINT, address, attributes, ..]
                if attributes & 3 == 2 && (address & 0x80 != 0) == from_device =>
            {
                Some(address)
            }
            _ => None,
        })
    };
    Some([bulk(false)?, bulk(true)?])
}

/// Frames over a pair of bulk endpoints, as a program on the host exchanges them: a frame is a transfer, ended by a packet
/// that is not full.
#[derive(Debug)]
pub struct BulkFrames {
    output: u8,
    input: u8,
    bytes: usize,
    waiting: VecDeque<TransferId>,
    sending: VecDeque<TransferId>,
}

impl BulkFrames {
    /// Between an OUT and an IN endpoint of these addresses; `waiting` IN transfers of `bytes` wait for the device.
    ///
    /// # Errors
    /// The run is over.
    pub fn open(
        stylus: &mut VirtualStylus,
        output: u8,
        input: u8,
        bytes: usize,
        waiting: usize,
    ) -> Result<Self> {
        let mut frames = Self {
            output: output & 0x0F,
            input: input & 0x0F,
            bytes: bytes.next_multiple_of(PACKET_BYTES),
            waiting: VecDeque::new(),
            sending: VecDeque::new(),
        };
        for _ in 0..waiting {
            frames.await_one(stylus)?;
        }
        Ok(frames)
    }

    fn await_one(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        let (endpoint, bytes) = (self.input, self.bytes);
        let id = stylus.usb(move |host, _| host.submit(Transfer::In { endpoint, bytes }))?;
        self.waiting.push_back(id);
        Ok(())
    }

    /// Sends a frame, behind those that wait.
    ///
    /// # Errors
    /// The run is over.
    pub fn send(&mut self, stylus: &mut VirtualStylus, frame: &[u8]) -> Result<()> {
        let (endpoint, data) = (self.output, frame.to_vec());
        let ids = stylus.usb(move |host, _| {
            let is_full = data.len().is_multiple_of(PACKET_BYTES) && !data.is_empty();
            let first = host.submit(Transfer::Out { endpoint, data });
            let end = is_full.then(|| {
                host.submit(Transfer::Out {
                    endpoint,
                    data: Vec::new(),
                })
            });
            [Some(first), end]
        })?;
        self.sending.extend(ids.into_iter().flatten());
        Ok(())
    }

    /// The frames that came, each with the instant of its last packet.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed. The link is over then.
    pub fn receive(
        &mut self,
        usb: &mut UsbHost,
        stylus: &mut VirtualStylus,
    ) -> Transferred<Vec<Arrived>> {
        let mut frames = Vec::new();
        usb.collect(stylus)?;
        while let Some(&id) = self.sending.front()
            && let Some(ended) = usb.find_ended(id)
        {
            self.sending.pop_front();
            if let Err(error) = ended.result {
                return Ok(Err(error));
            }
        }
        while let Some(&id) = self.waiting.front()
            && let Some(ended) = usb.find_ended(id)
        {
            self.waiting.pop_front();
            match ended.result {
                Err(error) => return Ok(Err(error)),
                Ok(data) => {
                    self.await_one(stylus)?;
                    if !data.is_empty() {
                        frames.push((ended.at_ns, data));
                    }
                }
            }
        }
        Ok(Ok(frames))
    }

    /// Calls off all that waits.
    ///
    /// # Errors
    /// The run is over.
    pub fn close(self, usb: &mut UsbHost, stylus: &mut VirtualStylus) -> Result<()> {
        let waiting: Vec<TransferId> = self.sending.into_iter().chain(self.waiting).collect();
        usb.call_off(stylus, &waiting)
    }
}
