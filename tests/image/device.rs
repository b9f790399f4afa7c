//! The host's end of the serial line or of USB, in virtual time.

use std::collections::VecDeque;
use std::path::PathBuf;

use fake_stylus::requests::frame;
use hil::checks::faults::{FaultTopic, Injected};
use model_format::link::{
    InfoEndpoint, KEEP_ALIVE_MS, KeepAliveTopic, MAX_DEVICE_FRAME_BYTES, RecordBlock, RecordBlockTopic,
};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use stylus_board::{ALL, Board};
use virtual_stylus::chance::Chance;
use virtual_stylus::model::dac::Output;
use virtual_stylus::model::pins::Driven;
use virtual_stylus::model::usb::host::TransferError;
use virtual_stylus::usb_host::{BulkFrames, Descriptors, UsbHost};
use virtual_stylus::{Options, VirtualStylus};

use crate::library;

pub const MS: u64 = 1_000_000;
pub const SECOND: u64 = 1_000 * MS;
/// Code of the DAC at which no current flows in the voice coil.
pub const MID_SCALE: u16 = 2048;
/// Time between two samples, ns.
pub const PERIOD_NS: u64 = 200_000;
/// Number of output codes per sample.
pub const CODES: usize = stylus_app::safety::OVERSAMPLING;
/// Time between two codes at the output, ns.
pub const CODE_NS: u64 = PERIOD_NS / CODES as u64;

/// Virtual time between two checks of the line while a host waits for an answer, ns: on the serial port, and on USB.
const STEP_NS: u64 = MS / 2;
const USB_STEP_NS: u64 = MS / 10;
/// Longest time until an answer arrives, including operations on flash.
const PATIENCE_NS: u64 = 20 * SECOND;
/// Longest time until the image has started.
const START_NS: u64 = 2 * SECOND;

/// Returns true in `cargo tasks test-virtual-stylus --long`.
pub fn long() -> bool {
    std::env::var_os("STYLUS_LONG").is_some()
}

/// Length of a recording, s.
pub fn recording_s() -> u64 {
    if long() { 60 } else { 2 }
}

/// Returns true if a run includes the case with this number. `tests/run long` includes every case; other runs include
/// one of ten, chosen at random from the seed.
pub fn is_drawn(case: u64) -> bool {
    let seed = std::env::var("PROPTEST_RNG_SEED").ok();
    let seed = seed.and_then(|seed| seed.parse().ok()).unwrap_or(1);
    let draw = Chance((case / 10) ^ (seed << 32)).below(10);
    long() || case % 10 == draw
}

/// The image that `variable` names.
fn image(variable: &str) -> PathBuf {
    std::env::var_os(variable)
        .unwrap_or_else(|| panic!("set {variable}, as `cargo tasks test-virtual-stylus` does"))
        .into()
}

/// The product's image.
pub fn product() -> PathBuf {
    product_of(&ALL[0])
}

/// The product's image for `board`.
pub fn product_of(board: &Board) -> PathBuf {
    if board.name == ALL[0].name {
        return image("STYLUS_IMAGE");
    }
    image(&format!("STYLUS_IMAGE_{}", board.name))
}

/// The image with fault injection.
pub fn with_faults() -> PathBuf {
    image("STYLUS_FAULT_IMAGE")
}

/// A frame from the device, after its COBS is decoded.
struct Frame {
    header: VarHeader,
    body: Vec<u8>,
}

/// Addresses of the bulk endpoints, as in the configuration descriptor.
pub const BULK_OUT: u8 = 0x01;
pub const BULK_IN: u8 = 0x81;
/// Number of IN transfers that wait for the device, as in the product's client.
const WAITING_TRANSFERS: usize = 8;

/// The link to the device.
enum Line {
    /// Bytes of a frame that is not complete yet.
    Serial(Vec<u8>),
    /// Bulk transfers, while the endpoints are open.
    Usb(UsbHost, Option<BulkFrames>),
}

/// A host and its link to the device.
struct Side {
    line: Line,
    /// Virtual time between two checks of the line while the host waits for an answer, ns.
    step_ns: u64,
    frames: VecDeque<Frame>,
    sequence: u32,
    /// Number of frames that were put on the line.
    sent: u32,
    keeps_alive: bool,
    next_keep_alive_ns: u64,
}

impl Side {
    fn new(line: Line) -> Self {
        let step_ns = match line {
            Line::Serial(_) => STEP_NS,
            Line::Usb(..) => USB_STEP_NS,
        };
        Self {
            line,
            step_ns,
            frames: VecDeque::new(),
            sequence: 0,
            sent: 0,
            keeps_alive: false,
            next_keep_alive_ns: 0,
        }
    }
}

/// The virtual stylus and one or two hosts that are linked to it. At any time, the calls below act for one of the
/// hosts, which has the turn.
pub struct Device {
    pub stylus: VirtualStylus,
    side: Side,
    other: Option<Side>,
    pub blocks: Vec<RecordBlock>,
    /// Number of received frames that do not decode.
    pub broken: usize,
    dac: Vec<Output>,
    amplifier: Vec<Driven>,
}

impl Device {
    /// Switches the power on, without running anything yet.
    pub fn new(image: &std::path::Path, options: Options) -> Self {
        let stylus = VirtualStylus::new(image, options).expect("the image fits the flash");
        Self {
            stylus,
            side: Side::new(Line::Serial(Vec::new())),
            other: None,
            blocks: Vec::new(),
            broken: 0,
            dac: Vec::new(),
            amplifier: Vec::new(),
        }
    }

    /// The product's image for the board, started and answering.
    pub fn started(options: Options) -> Self {
        let mut device = Self::new(&product_of(options.board), options);
        device.wait_for_start();
        device
    }

    /// The product's image with the small library active, started and answering.
    pub fn with_library() -> Self {
        Self::started(library::options())
    }

    /// The image with fault injection, started and answering.
    pub fn with_faults(options: Options) -> Self {
        let mut device = Self::new(&with_faults(), options);
        device.wait_for_start();
        device
    }

    /// The product's image for the board, started, enumerated and answering over USB.
    pub fn on_usb(options: Options) -> Self {
        let mut device = Self::new(&product_of(options.board), options);
        device.side = Side::new(Line::Usb(UsbHost::default(), None));
        device.run_for(300 * MS);
        device.enumerate().expect("it enumerates");
        device.wait_for_start();
        device
    }

    /// Adds a host on USB, which has the turn. It checks its line as seldom as the other host.
    pub fn add_usb(&mut self) {
        let usb = Side {
            step_ns: STEP_NS,
            ..Side::new(Line::Usb(UsbHost::default(), None))
        };
        self.other = Some(std::mem::replace(&mut self.side, usb));
    }

    /// Gives the turn to the other host, if there is one.
    pub fn turn(&mut self) {
        if let Some(other) = &mut self.other {
            std::mem::swap(&mut self.side, other);
        }
    }

    /// Returns true if the host that has the turn is on USB.
    pub fn is_usb(&self) -> bool {
        matches!(self.side.line, Line::Usb(..))
    }

    /// Enumerates the device on USB, and opens its bulk endpoints.
    pub fn enumerate(&mut self) -> Result<Descriptors, TransferError> {
        let (stylus, usb, bulk) = self.usb_line();
        *bulk = None;
        let read = usb.enumerate(stylus)?;
        self.open();
        Ok(read)
    }

    fn usb_line(&mut self) -> (&mut VirtualStylus, &mut UsbHost, &mut Option<BulkFrames>) {
        match &mut self.side.line {
            Line::Usb(usb, bulk) => (&mut self.stylus, usb, bulk),
            Line::Serial(_) => panic!("it is not on USB"),
        }
    }

    /// The run, and the software of the host on USB.
    pub fn usb(&mut self) -> (&mut VirtualStylus, &mut UsbHost) {
        let (stylus, usb, _) = self.usb_line();
        (stylus, usb)
    }

    /// Cancels the transfers on the bulk endpoints, as the system does when a program ends.
    pub fn close(&mut self) {
        let (stylus, usb, bulk) = self.usb_line();
        if let Some(open) = bulk.take() {
            open.close(usb, stylus);
        }
    }

    /// Ends the halts of the bulk endpoints, like a program that opens them.
    pub fn clear_halts(&mut self) {
        let (stylus, usb) = self.usb();
        for endpoint in [BULK_OUT, BULK_IN] {
            usb.clear_halt(stylus, endpoint).expect("it is there");
        }
    }

    /// Closes the endpoints like [`Device::close`], and opens them again like another program.
    pub fn reopen(&mut self) {
        self.close();
        self.open();
    }

    fn open(&mut self) {
        let (stylus, _, bulk) = self.usb_line();
        *bulk = Some(BulkFrames::open(
            stylus,
            BULK_OUT,
            BULK_IN,
            MAX_DEVICE_FRAME_BYTES,
            WAITING_TRANSFERS,
        ));
    }

    /// Returns true while the bulk endpoints are open and nothing has failed on them.
    pub fn is_open(&self) -> bool {
        matches!(self.side.line, Line::Usb(_, Some(_)))
    }

    /// Runs until the image answers.
    pub fn wait_for_start(&mut self) {
        assert!(self.answers_within(START_NS), "no answer: {:?}", self.stylus.report());
    }

    /// Runs until an image answers. Returns false if none answers in time.
    pub fn answers_within(&mut self, nanos: u64) -> bool {
        let end = self.stylus.now_ns() + nanos;
        while self.stylus.now_ns() < end {
            // Sent again and again, because what is sent before the image listens is lost.
            let sequence = self.send_frame(InfoEndpoint::REQ_KEY, &());
            self.run_for(20 * MS);
            if self.take_answer(InfoEndpoint::RESP_KEY, sequence).is_some() {
                return true;
            }
        }
        false
    }

    /// Sends a request, and runs until the answer has arrived.
    pub fn request<E>(&mut self, request: &E::Request) -> E::Response
    where
        E: Endpoint<Request: Serialize, Response: DeserializeOwned>,
    {
        self.try_request::<E>(request).expect("the link holds")
    }

    /// Sends a request, and returns its answer, or `None` if the link breaks before it arrives.
    pub fn try_request<E>(&mut self, request: &E::Request) -> Option<E::Response>
    where
        E: Endpoint<Request: Serialize, Response: DeserializeOwned>,
    {
        let sequence = self.send_frame(E::REQ_KEY, request);
        self.answer::<E>(sequence)
    }

    /// Runs until the answer with this number has arrived. Returns `None` if the link breaks before.
    pub fn answer<E>(&mut self, sequence: u32) -> Option<E::Response>
    where
        E: Endpoint<Response: DeserializeOwned>,
    {
        let end = self.stylus.now_ns() + PATIENCE_NS;
        loop {
            if let Some(body) = self.take_answer(E::RESP_KEY, sequence) {
                return Some(postcard::from_bytes(&body).expect("an answer of the type of its key"));
            }
            if matches!(self.side.line, Line::Usb(_, None)) {
                return None;
            }
            let now = self.stylus.now_ns();
            if now >= end {
                let told: Vec<_> = self
                    .side
                    .frames
                    .iter()
                    .map(|frame| (frame.header, &frame.body))
                    .collect();
                let resets = self.stylus.resets();
                panic!("{} is not answered; unasked: {told:?}; {resets:?}", E::PATH);
            }
            self.run_for(self.side.step_ns);
        }
    }

    /// Sends a message on a topic.
    pub fn publish<T: Topic<Message: Serialize + Sized>>(&mut self, message: &T::Message) {
        self.send_frame(T::TOPIC_KEY, message);
    }

    /// Sends a message under any key, and returns its sequence number.
    pub fn send_frame(&mut self, key: Key, message: &impl Serialize) -> u32 {
        self.side.sequence += 1;
        self.send_raw(&frame(key, self.side.sequence, message));
        self.side.sequence
    }

    /// Sends `frame` as one COBS frame or as one bulk transfer.
    pub fn send_raw(&mut self, frame: &[u8]) {
        if let Line::Usb(_, bulk) = &mut self.side.line {
            if let Some(bulk) = bulk {
                bulk.send(&mut self.stylus, frame);
                self.side.sent += 1;
            }
            return;
        }
        self.side.sent += 1;
        let mut encoded = cobs::encode_vec(frame);
        encoded.push(0);
        self.send_bytes(&encoded);
    }

    /// Sends bytes without framing.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.stylus.send(bytes);
    }

    /// Switches the host's keep-alives on or off.
    pub fn keep_alive(&mut self, on: bool) {
        self.side.keeps_alive = on;
    }

    /// Runs for `nanos`, and receives frames meanwhile.
    pub fn run_for(&mut self, nanos: u64) {
        let end = self.stylus.now_ns() + nanos;
        while self.stylus.now_ns() < end {
            self.on_each_side(Self::be_alive);
            let next = (self.stylus.now_ns() + 4 * STEP_NS).min(end);
            self.stylus.run_until(next);
            self.on_each_side(Self::listen);
        }
    }

    /// Does `work` first for the host that has the turn, then for the other.
    fn on_each_side(&mut self, work: fn(&mut Self)) {
        work(self);
        if self.other.is_some() {
            self.turn();
            work(self);
            self.turn();
        }
    }

    fn be_alive(&mut self) {
        if self.side.keeps_alive && self.stylus.now_ns() >= self.side.next_keep_alive_ns {
            self.publish::<KeepAliveTopic>(&());
            self.side.next_keep_alive_ns = self.stylus.now_ns() + u64::from(KEEP_ALIVE_MS) * MS;
        }
    }

    fn listen(&mut self) {
        if self.is_usb() {
            self.listen_on_usb();
        } else {
            self.listen_on_serial();
        }
    }

    fn listen_on_usb(&mut self) {
        let (stylus, usb, bulk) = self.usb_line();
        let Some(open) = bulk else { return };
        match open.receive(usb, stylus) {
            Ok(frames) => frames.iter().for_each(|frame| self.take_frame(frame)),
            Err(_) => self.close(),
        }
    }

    fn listen_on_serial(&mut self) {
        let sent = self.stylus.receive();
        for byte in sent.into_iter().map(|sent| sent.byte) {
            let Line::Serial(partial) = &mut self.side.line else {
                return;
            };
            if byte != 0 {
                partial.push(byte);
                continue;
            }
            let encoded = std::mem::take(partial);
            if encoded.is_empty() {
                continue;
            }
            let decoded = cobs::decode_vec(&encoded).unwrap_or_default();
            self.take_frame(&decoded);
        }
    }

    fn take_frame(&mut self, frame: &[u8]) {
        match VarHeader::take_from_slice(frame) {
            Some((header, body)) if header.key == VarKey::Key8(RecordBlockTopic::TOPIC_KEY) => {
                match postcard::from_bytes(body) {
                    Ok(block) => self.blocks.push(block),
                    Err(_) => self.broken += 1,
                }
            }
            Some((header, body)) => self.side.frames.push_back(Frame {
                header,
                body: body.to_vec(),
            }),
            None => self.broken += 1,
        }
    }

    /// Returns the body of the answer with this number, if it has arrived.
    pub fn take_answer(&mut self, key: Key, sequence: u32) -> Option<Vec<u8>> {
        let header = VarHeader {
            key: VarKey::Key8(key),
            seq_no: VarSeq::Seq4(sequence),
        };
        let frames = &mut self.side.frames;
        let position = frames.iter().position(|frame| frame.header == header)?;
        frames.remove(position).map(|frame| frame.body)
    }

    /// Outputs of the converter since power-on.
    pub fn dac(&mut self) -> &[Output] {
        let new = self.stylus.take_dac_record();
        self.dac.extend(new);
        &self.dac
    }

    /// Changes of the amplifier's enable since power-on.
    pub fn amplifier(&mut self) -> Vec<Driven> {
        let new = self.stylus.take_amplifier_record();
        self.amplifier.extend(new);
        self.amplifier.clone()
    }

    /// Number of frames that the host with the turn has sent.
    pub fn sent(&self) -> u32 {
        self.side.sent
    }

    /// Drops all received frames.
    pub fn forget_frames(&mut self) {
        self.side.frames.clear();
    }
}

/// Requests a fault from the image with fault injection.
pub fn inject(device: &mut Device, fault: Injected) {
    device.publish::<FaultTopic>(&(fault as u8));
}
