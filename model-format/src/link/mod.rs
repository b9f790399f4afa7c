//! Messages between host and stylus: postcard-rpc endpoints and topics, the same over USB and over the serial port.
//!
//! A frame is postcard-rpc's header, with a key that stands for path and type, and then the message in postcard. A
//! change of a type changes its key, so that a host and a device with different types do not misread each other: a
//! request whose key the device does not know is answered by an error. [`DeviceInfo`] never changes, so that any host
//! can determine which of the two is older.
//!
//! Over USB a frame is a bulk transfer; over the serial port it is one COBS frame, ended by a zero byte. The host sends
//! frames of at most [`MAX_HOST_FRAME_BYTES`] and the device of at most [`MAX_DEVICE_FRAME_BYTES`].
//!
//! A request that writes flash may take seconds, see [`FLASH_TIMEOUT_MS`]. Every other request is answered within
//! [`ANSWER_TIMEOUT_MS`].

mod cap;
mod lease;
mod library;
mod play;
mod probe;
mod proposal;
mod record;
mod response;
mod selftest;
mod settings;
mod start;
mod status;
#[cfg(test)]
mod tests;
mod units;
mod update;

use postcard_rpc::{TopicDirection, endpoints, standard_icd, topics};

pub use cap::{
    BUILT_FOR_GAIN, BUILT_FOR_OHM, MAX_COIL_POWER_WATT, MAX_PIN_MEAN_SQUARE, MAX_THERMAL_TIME_CONSTANT_S, OutputLimits,
};
pub use lease::{LeaseStatus, LinkId};
pub use library::{
    ActivateError, Activated, CHUNK_ALIGN, FlashOperation, LIBRARY_CRC, ListError, ListRequest, MAX_CHUNK_BYTES,
    Reason, SceneInfo, SlotFault, SlotId, SlotInfo, SlotState, Slots, TextureInfo, TextureName, UPLOAD_WINDOW,
    UploadBegin, UploadChunk, UploadCommitted, UploadError, UploadProgress, UploadState,
};
pub use play::{
    Arithmetic, MAX_PLAY_GAIN, MUTE_REASON_COUNT, MotionRefused, MotionSample, MotionSource, MuteReason, MuteReasons,
    PlayError, PlayRequest, Playing, Selection, StopError,
};
pub use probe::{
    MAX_PROBE_M_S2, MAX_PROBE_S, MAX_PROBE_SAMPLES, PROBE_CHUNK_SAMPLES, ProbeError, ProbeLoad, ProbeStart,
    ProbeStarted, ProbeThrough, waveform_crc32,
};
pub use proposal::{LOCKED, ProposalToken, SettingSet, SettingsChange, SettingsProposal, SettingsState};
pub use record::{
    BLOCK_SAMPLES, PackedSample, RAIL_CODES, RecordBlock, RecordError, RecordSample, RecordStarted, RecordStopped,
};
pub use response::{
    RESPONSE_BANDS, RESPONSE_BYTES, Response, ResponseChange, ResponseError, ResponseState, Sections, StoredResponse,
};
pub use selftest::{
    CONVERSIONS_PER_CODE, ChipValues, ClockCount, ClockValues, EncoderValues, ErrorCorrectionValues, FLASH_TEST_BYTES,
    FlashValues, LOWEST_OUTPUT_CODE, OUTPUT_CODE_STEP, OUTPUT_CODES, OptionByteValues, OutputValues, RAM_MONITORS,
    REST_CONVERSIONS, RestValues, STEP_CODES, STEP_INSTANT_CYCLES, STEP_INSTANTS, SelfTestError, SelfTestRequest,
    SelfTestValues, output_code,
};
pub use settings::{
    PROPOSAL_VALID_MS, SETTING_COUNT, Setting, SettingChange, SettingSpec, Settings, SettingsError, Tighter,
};
pub use start::{
    BoardName, ClockSource, FLASH_SUPPLY_MV, LEAST_BROWN_OUT_LEVEL, QUICK_FAULT_MS, QUICK_FAULTS, SiliconRevision,
    StartReport, StartStage,
};
pub use status::{
    Activity, CycleRange, CycleReport, DeviceInfo, Fault, FaultKind, FaultText, Levels, LinkCounters, Marks,
    OutputStatus, ProductName, RecordCounters, ResetReason, Serial, Status, TICK_BIN_COUNT, TICK_BIN_CYCLES,
    TickCounters, TickHistogram, VersionText,
};
pub use update::{
    DEVELOPMENT_SEED, EXCHANGE_MS, HEADER_BYTES, ImageHeader, ImageVersion, MAX_IMAGE_BYTES, SIGNATURE_BYTES,
    SIGNED_BYTES, TRIAL_MS, UNSIGNED, UpdateBegin, UpdateError, UpdatePhase, UpdateReport,
};

/// Version of the protocol. It changes when the meaning of a message changes, even if the message's type stays the
/// same.
pub const PROTOCOL_VERSION: u16 = 2;

/// Longest frame that the host sends, bytes before COBS.
pub const MAX_HOST_FRAME_BYTES: usize = 1024;

/// Longest frame that the device sends, bytes before COBS. Host clients of postcard-rpc cannot read longer frames.
pub const MAX_DEVICE_FRAME_BYTES: usize = 1024;

/// Rate of the serial port, baud.
pub const SERIAL_BAUD: u32 = 921_600;

/// Vendor id of the USB device: pid.codes, for open hardware and software.
pub const USB_VENDOR_ID: u16 = 0x1209;

/// Product id of the USB device: pid.codes' id for tests, to be replaced by the product's own before it is sold.
pub const USB_PRODUCT_ID: u16 = 0x0001;

/// Product string of the USB device. It distinguishes the stylus from other devices that use the id for tests.
pub const USB_PRODUCT: &str = "stylus";

/// Age beyond which a speed or force is stale and the output fades, ms.
pub const STALE_AFTER_MS: u32 = 50;

/// Time without a play, motion or keep-alive from the link that plays, ms. After this time, the link counts as lost and
/// the output fades.
///
/// With the longest mute ramp that settings allow, the output is silent within 100 ms.
pub const LINK_LOST_AFTER_MS: u32 = 50;

/// Interval at which a host sends [`KeepAliveTopic`] while it plays and sends nothing else, ms.
pub const KEEP_ALIVE_MS: u32 = 10;

/// Time that a host waits for the answer to a request that neither erases nor writes flash, ms.
pub const ANSWER_TIMEOUT_MS: u32 = 1_000;

/// Time that a host waits for the answer to a request that erases or writes flash, ms. One request makes at most two
/// erasures of a sector of 128 KB, such as those of both copies of the settings. Erasing a sector takes up to some
/// seconds, and longer with a narrower programming parallelism (DS12110, flash memory programming).
pub const FLASH_TIMEOUT_MS: u32 = 16_000;

type InfoResult = DeviceInfo;
type StatusResult = Status;
type CyclesResult = CycleReport;
type UploadResult = Result<UploadProgress, UploadError>;
type CommitResult = Result<UploadCommitted, UploadError>;
type AbortResult = Result<UploadState, UploadError>;
type SlotsResult = Slots;
type ListResult = Result<TextureInfo, ListError>;
type ListSceneResult = Result<SceneInfo, ListError>;
type ActivateResult = Result<Activated, ActivateError>;
type PlayResult = Result<Playing, PlayError>;
type StopResult = Result<OutputStatus, StopError>;
type MotionResult = Result<MotionSource, MotionRefused>;
type RecordStartResult = Result<RecordStarted, RecordError>;
type RecordStopResult = Result<RecordStopped, RecordError>;
type ProposalResult = Result<SettingsProposal, SettingsError>;
type SettingsResult = Result<Settings, SettingsError>;
type ProbeLoadResult = Result<(), ProbeError>;
type ProbeStartResult = Result<ProbeStarted, ProbeError>;
type ProposedResult = Result<u32, ResponseError>;
type ResponseResult = Result<ResponseState, ResponseError>;
type UpdateResult = Result<UploadProgress, UpdateError>;
type UpdateStateResult = Option<UpdateReport>;
type UpdatedResult = Result<UpdateReport, UpdateError>;
type SelfTestResult = Result<SelfTestValues, SelfTestError>;

endpoints! {
    list = ENDPOINTS;
    | EndpointTy              | RequestTy       | ResponseTy        | Path                      |
    | ----------              | ---------       | ----------        | ----                      |
    | InfoEndpoint            | ()              | InfoResult        | "stylus/info"             |
    | StatusEndpoint          | ()              | StatusResult      | "stylus/status"           |
    | CyclesEndpoint          | ()              | CyclesResult      | "stylus/cycles"           |
    | UploadBeginEndpoint     | UploadBegin     | UploadResult      | "stylus/upload/begin"     |
    | UploadChunkEndpoint     | UploadChunk<'a> | UploadResult      | "stylus/upload/chunk"     |
    | UploadCommitEndpoint    | ()              | CommitResult      | "stylus/upload/commit"    |
    | UploadAbortEndpoint     | ()              | AbortResult       | "stylus/upload/abort"     |
    | UploadProgressEndpoint  | ()              | UploadState       | "stylus/upload/progress"  |
    | SlotsEndpoint           | ()              | SlotsResult       | "stylus/slots"            |
    | ListEndpoint            | ListRequest     | ListResult        | "stylus/list"             |
    | ListSceneEndpoint       | ListRequest     | ListSceneResult   | "stylus/list/scene"       |
    | ActivateEndpoint        | SlotId          | ActivateResult    | "stylus/activate"         |
    | PlayEndpoint            | PlayRequest     | PlayResult        | "stylus/play"             |
    | StopEndpoint            | ()              | StopResult        | "stylus/stop"             |
    | MotionEndpoint          | MotionSample    | MotionResult      | "stylus/motion"           |
    | RecordStartEndpoint     | ()              | RecordStartResult | "stylus/record/start"     |
    | RecordStopEndpoint      | ()              | RecordStopResult  | "stylus/record/stop"      |
    | SettingsGetEndpoint     | ()              | SettingsResult    | "stylus/settings/get"     |
    | SettingsProposeEndpoint | SettingsChange  | ProposalResult    | "stylus/settings/propose" |
    | SettingsApplyEndpoint   | ProposalToken   | SettingsResult    | "stylus/settings/apply"   |
    | ProbeLoadEndpoint       | ProbeLoad       | ProbeLoadResult   | "stylus/probe/load"       |
    | ProbeStartEndpoint      | ProbeStart      | ProbeStartResult  | "stylus/probe/start"      |
    | ResponseGetEndpoint     | ()              | ResponseState     | "stylus/response/get"     |
    | ResponseProposeEndpoint | Response        | ProposedResult    | "stylus/response/propose" |
    | ResponseSetEndpoint     | ResponseChange  | ResponseResult    | "stylus/response/set"     |
    | SelfTestEndpoint        | SelfTestRequest | SelfTestResult    | "stylus/selftest"         |
    | UpdateBeginEndpoint     | UpdateBegin     | UpdateResult      | "stylus/update/begin"     |
    | UpdateCommitEndpoint    | ()              | UpdatedResult     | "stylus/update/commit"    |
    | UpdateConfirmEndpoint   | ()              | UpdatedResult     | "stylus/update/confirm"   |
    | UpdateStateEndpoint     | ()              | UpdateStateResult | "stylus/update/state"     |
}

topics! {
    list = TOPICS_IN;
    direction = TopicDirection::ToServer;
    | TopicTy        | MessageTy    | Path                  |
    | -------        | ---------    | ----                  |
    | MotionTopic    | MotionSample | "stylus/motion/live"  |
    | KeepAliveTopic | ()           | "stylus/keep-alive"   |
}

topics! {
    list = TOPICS_OUT;
    direction = TopicDirection::ToClient;
    | TopicTy          | MessageTy   | Path                  |
    | -------          | ---------   | ----                  |
    | RecordBlockTopic | RecordBlock | "stylus/record/block" |
}

/// Hash of all paths and types of this protocol. Two programs with the same hash can decode each other's messages. That
/// they mean the same by them needs the same [`PROTOCOL_VERSION`], too.
pub const SCHEMA_HASH: u64 = schema_hash();

/// FNV-1a over the keys, in the order of the tables. postcard-rpc's own entries come first in its lists. They are left
/// out because they differ between host and device.
const fn schema_hash() -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325;
    let mut index = standard_icd::STANDARD_ICD_ENDPOINTS.endpoints.len();
    while index < ENDPOINTS.endpoints.len() {
        let (_, request, response) = ENDPOINTS.endpoints[index];
        hash = hash_key(hash_key(hash, request), response);
        index += 1;
    }
    hash = hash_topics(
        hash,
        TOPICS_IN.topics,
        standard_icd::STANDARD_ICD_TOPICS_IN.topics.len(),
    );
    hash_topics(
        hash,
        TOPICS_OUT.topics,
        standard_icd::STANDARD_ICD_TOPICS_OUT.topics.len(),
    )
}

const fn hash_topics(mut hash: u64, topics: &[(&str, postcard_rpc::Key)], first: usize) -> u64 {
    let mut index = first;
    while index < topics.len() {
        hash = hash_key(hash, topics[index].1);
        index += 1;
    }
    hash
}

const fn hash_key(mut hash: u64, key: postcard_rpc::Key) -> u64 {
    let bytes = key.to_bytes();
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        index += 1;
    }
    hash
}
