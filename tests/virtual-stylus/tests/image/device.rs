//! The host's end of the serial line or of USB, in virtual time.

use std::collections::VecDeque;
use std::path::PathBuf;

use model_format::link::{
    ActivateEndpoint, Activated, InfoEndpoint, KEEP_ALIVE_MS, KeepAliveTopic, LIBRARY_CRC,
    ListEndpoint, ListRequest, MAX_CHUNK_BYTES, MAX_DEVICE_FRAME_BYTES, MotionSource, MuteReasons,
    PlayEndpoint, PlayError, PlayRequest, Playing, RecordBlock, RecordBlockTopic, Selection,
    Setting, SettingChange, SettingSet, Settings, SettingsApplyEndpoint, SettingsChange,
    SettingsError, SettingsGetEndpoint, SettingsProposeEndpoint, SlotId, Slots, SlotsEndpoint,
    Status, StatusEndpoint, TextureInfo, UploadBegin, UploadBeginEndpoint, UploadChunk,
    UploadChunkEndpoint, UploadCommitEndpoint, UploadCommitted, UploadProgress,
};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use virtual_stylus::model::dac::Output;
use virtual_stylus::model::pin::Driven;
use virtual_stylus::model::usb::host::TransferError;
use virtual_stylus::usb_host::{BulkFrames, Descriptors, UsbHost};
use virtual_stylus::{Options, VirtualStylus};

pub const MS: u64 = 1_000_000;
pub const SECOND: u64 = 1_000 * MS;
/// Code of the DAC without current in the voice coil.
pub const MID_SCALE: u16 = 2048;
/// Time between two samples.
pub const PERIOD_NS: u64 = 200_000;
/// Codes per sample.
pub const CODES: usize = stylus_app::safety::OVERSAMPLING;
/// Time between two codes at the output.
pub const CODE_NS: u64 = PERIOD_NS / CODES as u64;

/// Virtual time between two looks at the line.
const STEP_NS: u64 = MS / 2;
const USB_STEP_NS: u64 = MS / 10;
/// Time within which an answer comes, operations on flash included.
const PATIENCE_NS: u64 = 20 * SECOND;
/// Time within which the image has started.
const START_NS: u64 = 2 * SECOND;

/// The image that `variable` names.
fn image(variable: &str) -> PathBuf {
    std::env::var_os(variable)
        .unwrap_or_else(|| panic!("set {variable}, as `cargo tasks test-virtual-stylus` does"))
        .into()
}

/// The product's image.
pub fn product() -> PathBuf {
    image("STYLUS_IMAGE")
}

/// The image with fault injection.
pub fn with_faults() -> PathBuf {
    image("STYLUS_FAULT_IMAGE")
}

/// A frame from the device, without its COBS.
struct Frame {
    header: VarHeader,
    body: Vec<u8>,
}

/// Addresses of the bulk endpoints, as in the configuration descriptor.
pub const BULK_OUT: u8 = 0x01;
pub const BULK_IN: u8 = 0x81;
/// Number of transfers that wait for the device, as of the product's client.
const WAITING_TRANSFERS: usize = 8;

/// The link to the device.
enum Line {
    /// Bytes of a frame that is not complete.
    Serial(Vec<u8>),
    /// Bulk transfers, while the endpoints are open.
    Usb(UsbHost, Option<BulkFrames>),
}

/// The virtual stylus and a host that talks to it.
pub struct Device {
    pub stylus: VirtualStylus,
    line: Line,
    /// Virtual time between two looks at the line, during the wait for an answer.
    step_ns: u64,
    frames: VecDeque<Frame>,
    pub blocks: Vec<RecordBlock>,
    /// Number of received frames that do not decode.
    pub broken: usize,
    sequence: u32,
    keeps_alive: bool,
    next_keep_alive_ns: u64,
    dac: Vec<Output>,
    amplifier: Vec<Driven>,
}

impl Device {
    /// Switches the power on; nothing has run yet.
    pub fn new(image: &std::path::Path, options: Options) -> Self {
        let stylus = VirtualStylus::new(image, options).expect("the image fits the flash");
        Self {
            stylus,
            line: Line::Serial(Vec::new()),
            step_ns: STEP_NS,
            frames: VecDeque::new(),
            blocks: Vec::new(),
            broken: 0,
            sequence: 0,
            keeps_alive: false,
            next_keep_alive_ns: 0,
            dac: Vec::new(),
            amplifier: Vec::new(),
        }
    }

    /// The product's image, started and answering.
    pub fn started(options: Options) -> Self {
        let mut device = Self::new(&product(), options);
        device.wait_for_start();
        device
    }

    /// The product's image, started, enumerated and answering over USB.
    pub fn on_usb(options: Options) -> Self {
        let mut device = Self::new(&product(), options);
        device.line = Line::Usb(UsbHost::default(), None);
        device.step_ns = USB_STEP_NS;
        device.run_for(300 * MS);
        device.enumerate().expect("it enumerates");
        device.wait_for_start();
        device
    }

    /// Enumerates the device on USB, and opens its bulk endpoints.
    pub fn enumerate(&mut self) -> Result<Descriptors, TransferError> {
        let Line::Usb(usb, bulk) = &mut self.line else {
            panic!("it is not on USB");
        };
        *bulk = None;
        let read = usb.enumerate(&mut self.stylus).expect("the run goes on")?;
        self.open();
        Ok(read)
    }

    /// The run and the host's software on USB.
    pub fn usb(&mut self) -> (&mut VirtualStylus, &mut UsbHost) {
        match &mut self.line {
            Line::Usb(usb, _) => (&mut self.stylus, usb),
            Line::Serial(_) => panic!("it is not on USB"),
        }
    }

    /// Cancels the transfers on the bulk endpoints, as at the end of a program.
    pub fn close(&mut self) {
        let Line::Usb(usb, bulk) = &mut self.line else {
            panic!("it is not on USB");
        };
        if let Some(open) = bulk.take() {
            open.close(usb, &mut self.stylus).expect("the run goes on");
        }
    }

    /// Closes the endpoints as [`Device::close`], and opens them as another program.
    pub fn reopen(&mut self) {
        self.close();
        self.open();
    }

    fn open(&mut self) {
        let Line::Usb(_, bulk) = &mut self.line else {
            panic!("it is not on USB");
        };
        let opened = BulkFrames::open(
            &mut self.stylus,
            BULK_OUT,
            BULK_IN,
            MAX_DEVICE_FRAME_BYTES,
            WAITING_TRANSFERS,
        );
        *bulk = Some(opened.expect("the run goes on"));
    }

    /// True while the bulk endpoints are open and nothing has failed on them.
    pub fn is_open(&self) -> bool {
        matches!(self.line, Line::Usb(_, Some(_)))
    }

    /// Runs until the image answers.
    pub fn wait_for_start(&mut self) {
        let end = self.stylus.now_ns() + START_NS;
        while self.stylus.now_ns() < end {
            self.send_frame(InfoEndpoint::REQ_KEY, &());
            self.run_for(20 * MS);
            if self
                .take_answer(InfoEndpoint::RESP_KEY, self.sequence)
                .is_some()
            {
                return;
            }
        }
        panic!("the image does not answer: {:?}", self.stylus.report());
    }

    /// Sends a request, and runs until the answer is there.
    pub fn request<E>(&mut self, request: &E::Request) -> E::Response
    where
        E: Endpoint<Request: Serialize, Response: DeserializeOwned>,
    {
        self.ask::<E, _>(request)
    }

    /// As [`Device::request`], for requests that borrow.
    fn ask<E, R>(&mut self, request: &R) -> E::Response
    where
        E: Endpoint<Response: DeserializeOwned>,
        R: Serialize,
    {
        self.try_ask::<E, R>(request).expect("the link holds")
    }

    /// The answer; none if the link breaks before.
    pub fn try_ask<E, R>(&mut self, request: &R) -> Option<E::Response>
    where
        E: Endpoint<Response: DeserializeOwned>,
        R: Serialize,
    {
        let sequence = self.send_frame(E::REQ_KEY, request);
        self.answer::<E>(sequence)
    }

    /// Runs until the answer with this number is there; none if the link breaks before.
    fn answer<E>(&mut self, sequence: u32) -> Option<E::Response>
    where
        E: Endpoint<Response: DeserializeOwned>,
    {
        let end = self.stylus.now_ns() + PATIENCE_NS;
        loop {
            if let Some(body) = self.take_answer(E::RESP_KEY, sequence) {
                return Some(
                    postcard::from_bytes(&body).expect("an answer of the type of its key"),
                );
            }
            if matches!(self.line, Line::Usb(_, None)) {
                return None;
            }
            let now = self.stylus.now_ns();
            if now >= end {
                let told = self.frames.iter().map(|frame| (frame.header, &frame.body));
                let (told, resets) = (told.collect::<Vec<_>>(), self.stylus.resets());
                panic!("{} is not answered; unasked: {told:?}; {resets:?}", E::PATH);
            }
            self.run_for(self.step_ns);
        }
    }

    /// Sends a message on a topic.
    pub fn publish<T: Topic<Message: Serialize + Sized>>(&mut self, message: &T::Message) {
        self.send_frame(T::TOPIC_KEY, message);
    }

    /// Sends any message under any key.
    pub fn send_frame(&mut self, key: Key, message: &impl Serialize) -> u32 {
        self.sequence += 1;
        self.send_raw(&frame(key, self.sequence, message));
        self.sequence
    }

    /// Sends `frame` as one COBS frame, or one bulk transfer.
    pub fn send_raw(&mut self, frame: &[u8]) {
        if let Line::Usb(_, bulk) = &mut self.line {
            if let Some(bulk) = bulk {
                bulk.send(&mut self.stylus, frame).expect("the run goes on");
            }
            return;
        }
        let mut encoded = cobs::encode_vec(frame);
        encoded.push(0);
        self.send_bytes(&encoded);
    }

    /// Sends bytes as they are.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.stylus.send(bytes).expect("the run goes on");
    }

    /// Switches the host's keep-alives on or off.
    pub fn keep_alive(&mut self, on: bool) {
        self.keeps_alive = on;
    }

    /// Runs for `nanos`, and receives frames.
    pub fn run_for(&mut self, nanos: u64) {
        let end = self.stylus.now_ns() + nanos;
        while self.stylus.now_ns() < end {
            if self.keeps_alive && self.stylus.now_ns() >= self.next_keep_alive_ns {
                self.publish::<KeepAliveTopic>(&());
                self.next_keep_alive_ns = self.stylus.now_ns() + u64::from(KEEP_ALIVE_MS) * MS;
            }
            let next = (self.stylus.now_ns() + 4 * STEP_NS).min(end);
            self.stylus.run_until(next).expect("the run goes on");
            self.listen();
        }
    }

    fn listen(&mut self) {
        if matches!(self.line, Line::Usb(..)) {
            self.listen_on_usb();
        } else {
            self.listen_on_serial();
        }
    }

    fn listen_on_usb(&mut self) {
        let Line::Usb(usb, bulk) = &mut self.line else {
            return;
        };
        let Some(open) = bulk else { return };
        match open
            .receive(usb, &mut self.stylus)
            .expect("the run goes on")
        {
            Ok(frames) => {
                for (_, frame) in frames {
                    self.take_frame(&frame);
                }
            }
            Err(_) => {
                if let Some(open) = bulk.take() {
                    open.close(usb, &mut self.stylus).expect("the run goes on");
                }
            }
        }
    }

    fn listen_on_serial(&mut self) {
        let sent = self.stylus.receive().expect("the run goes on");
        for byte in sent.into_iter().map(|sent| sent.byte) {
            let Line::Serial(partial) = &mut self.line else {
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
            Some((header, body)) => self.frames.push_back(Frame {
                header,
                body: body.to_vec(),
            }),
            None => self.broken += 1,
        }
    }

    /// The body of the answer with this number, if it has come.
    pub fn take_answer(&mut self, key: Key, sequence: u32) -> Option<Vec<u8>> {
        let header = VarHeader {
            key: VarKey::Key8(key),
            seq_no: VarSeq::Seq4(sequence),
        };
        let position = self
            .frames
            .iter()
            .position(|frame| frame.header == header)?;
        self.frames.remove(position).map(|frame| frame.body)
    }

    /// Outputs of the converter since power-on.
    pub fn dac(&mut self) -> &[Output] {
        let new = self.stylus.take_dac_record().expect("the run goes on");
        self.dac.extend(new);
        &self.dac
    }

    /// Changes of the amplifier's enable since power-on.
    pub fn amplifier(&mut self) -> Vec<Driven> {
        let new = self
            .stylus
            .take_amplifier_record()
            .expect("the run goes on");
        self.amplifier.extend(new);
        self.amplifier.clone()
    }

    pub fn settings(&mut self) -> Settings {
        self.request::<SettingsGetEndpoint>(&())
            .expect("settings are read")
    }

    /// Drops the frames that were not requested.
    pub fn forget_frames(&mut self) {
        self.frames.clear();
    }

    pub fn status(&mut self) -> Status {
        self.request::<StatusEndpoint>(&())
    }

    pub fn slots(&mut self) -> Slots {
        self.request::<SlotsEndpoint>(&())
    }

    pub fn texture(&mut self, slot: SlotId, index: u8) -> TextureInfo {
        self.request::<ListEndpoint>(&ListRequest { slot, index })
            .expect("there is such a texture")
    }

    pub fn begin_upload(&mut self, library: &[u8]) -> UploadProgress {
        self.request::<UploadBeginEndpoint>(&announced(library))
            .expect("the library fits a slot")
    }

    /// Sends chunks from `progress` up to byte `end`.
    pub fn send_chunks(&mut self, library: &[u8], progress: UploadProgress, end: usize) {
        let mut offset = progress.next_offset as usize;
        while offset < end {
            let data = &library[offset..library.len().min(offset + MAX_CHUNK_BYTES)];
            let chunk = UploadChunk {
                offset: offset as u32,
                data,
            };
            let progress = self
                .ask::<UploadChunkEndpoint<'_>, _>(&chunk)
                .expect("the chunk that is due");
            offset = progress.next_offset as usize;
        }
    }

    pub fn upload(&mut self, library: &[u8]) -> UploadCommitted {
        let progress = self.begin_upload(library);
        self.send_chunks(library, progress, library.len());
        self.request::<UploadCommitEndpoint>(&())
            .expect("a valid library")
    }

    /// Uploads with up to `window` chunks on their way before the answer to the first of them, as the product's client
    /// does with [`UPLOAD_WINDOW`](model_format::link::UPLOAD_WINDOW).
    pub fn upload_ahead(&mut self, library: &[u8], window: usize) -> UploadCommitted {
        self.begin_upload(library);
        let offsets = (0..).step_by(MAX_CHUNK_BYTES);
        let mut chunks = library.chunks(MAX_CHUNK_BYTES).zip(offsets);
        let mut on_their_way = VecDeque::new();
        loop {
            while on_their_way.len() < window
                && let Some((data, offset)) = chunks.next()
            {
                let chunk = UploadChunk { offset, data };
                let sequence = self.send_frame(UploadChunkEndpoint::REQ_KEY, &chunk);
                on_their_way.push_back(sequence);
            }
            let Some(first) = on_their_way.pop_front() else {
                break;
            };
            self.answer::<UploadChunkEndpoint<'_>>(first)
                .expect("the link holds")
                .expect("the chunk that is due");
        }
        self.request::<UploadCommitEndpoint>(&())
            .expect("a valid library")
    }

    pub fn activate(&mut self, slot: SlotId) -> Activated {
        self.request::<ActivateEndpoint>(&slot)
            .expect("a valid slot")
    }

    /// Sets what nothing plays without, as the owner of the coil does; the values are those of `Settings::default`.
    pub fn set_coil(&mut self) {
        let default = |setting: Setting| SettingChange {
            setting,
            value: setting.spec().default,
        };
        let values: Vec<SettingChange> = SettingSet::REQUIRED.iter().map(default).collect();
        self.change_settings(&values)
            .expect("in range, and nothing is played");
    }

    /// Proposes new values of settings, and applies them.
    pub fn change_settings(&mut self, values: &[SettingChange]) -> Result<Settings, SettingsError> {
        self.propose_and_apply(&SettingsChange::of(values)?)
    }

    /// Proposes to reset the settings, and resets them.
    pub fn reset_settings(&mut self) -> Result<Settings, SettingsError> {
        self.propose_and_apply(&SettingsChange::Reset)
    }

    fn propose_and_apply(&mut self, change: &SettingsChange) -> Result<Settings, SettingsError> {
        let proposal = self.request::<SettingsProposeEndpoint>(change)?;
        self.request::<SettingsApplyEndpoint>(&proposal.token)
    }

    /// Plays with keep-alives, and waits until nothing mutes the output.
    pub fn play(&mut self, texture: &str, motion: MotionSource, seed: u64) {
        self.keep_alive(true);
        let request = play_request(texture, motion, seed);
        self.request::<PlayEndpoint>(&request)
            .expect("the texture is there");
    }

    /// Requests a scene.
    pub fn play_scene(
        &mut self,
        scene: &str,
        motion: MotionSource,
        seed: u64,
    ) -> Result<Playing, Box<PlayError>> {
        self.keep_alive(true);
        let request = PlayRequest {
            selection: Selection::Scene(scene.try_into().expect("a scene's name fits")),
            ..play_request("", motion, seed)
        };
        self.request::<PlayEndpoint>(&request).map_err(Box::new)
    }

    /// Plays, and waits until nothing mutes the output.
    pub fn play_until_heard(&mut self, texture: &str, motion: MotionSource, seed: u64) {
        self.play(texture, motion, seed);
        self.wait_until_heard();
    }

    /// Runs until nothing mutes the output.
    pub fn wait_until_heard(&mut self) {
        for _ in 0..100 {
            self.run_for(5 * MS);
            if self.status().output.mute == MuteReasons::NONE {
                return;
            }
        }
        panic!("still muted: {:?}", self.status().output);
    }
}

/// A frame with a message, without COBS.
pub fn frame(key: Key, sequence: u32, message: &impl Serialize) -> Vec<u8> {
    let header = VarHeader {
        key: VarKey::Key8(key),
        seq_no: VarSeq::Seq4(sequence),
    };
    let mut buffer = [0; 64];
    let (used, _) = header
        .write_to_slice(&mut buffer)
        .expect("a header fits 64 bytes");
    let mut frame = used.to_vec();
    frame.extend(postcard::to_allocvec(message).expect("messages are plain data"));
    frame
}

/// The announcement of an upload of `library`.
pub fn announced(library: &[u8]) -> UploadBegin {
    UploadBegin {
        length: library.len() as u32,
        crc32: LIBRARY_CRC.checksum(library),
        replaces_last: false,
    }
}

pub fn play_request(texture: &str, motion: MotionSource, seed: u64) -> PlayRequest {
    PlayRequest {
        selection: Selection::Texture(texture.try_into().expect("a texture's name fits")),
        gain: 1.0,
        motion,
        seed,
    }
}
