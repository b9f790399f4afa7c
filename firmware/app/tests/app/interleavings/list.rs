//! The list of requests, and the libraries that they are about.

use std::sync::LazyLock;

use fake_stylus::device::play_request;
use fake_stylus::library::{announcement, small_texture};
use fake_stylus::requests::frame;
use model_format::link::{
    ActivateEndpoint, CyclesEndpoint, InfoEndpoint, KeepAliveTopic, ListEndpoint, ListRequest,
    ListSceneEndpoint, MotionEndpoint, MotionSample, MotionSource, MotionTopic, PlayEndpoint,
    PlayRequest, ProposalToken, RecordStartEndpoint, RecordStopEndpoint, Selection,
    SelfTestEndpoint, SelfTestRequest, Setting, SettingChange, SettingsApplyEndpoint,
    SettingsChange, SettingsGetEndpoint, SettingsProposeEndpoint, SlotId, SlotsEndpoint,
    StatusEndpoint, StopEndpoint, UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint,
    UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint, UploadProgressEndpoint,
};
use model_format::scene::{Scene, Surface};
use model_format::{MillimetresPerSecond, Newton, PlayRate, encode_with_scenes};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::PingEndpoint;
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;

/// Frame of a request with the given sequence number.
pub type Made = fn(u32) -> Vec<u8>;

/// A request: its name, and its frame.
#[derive(Clone, Copy)]
pub struct Request {
    pub name: &'static str,
    pub make: Made,
    /// True if it is answered.
    pub answered: bool,
    /// True if it renews the lease of a host that plays.
    pub renews: bool,
    /// True if a second frame of its host follows, which applies the change of settings that this one proposes.
    pub then_applies: bool,
}

impl Request {
    const fn renewing(self) -> Self {
        Self {
            renews: true,
            ..self
        }
    }
}

const fn asked(name: &'static str, make: Made) -> Request {
    Request {
        name,
        make,
        answered: true,
        renews: false,
        then_applies: false,
    }
}

/// A change of settings in two steps.
pub const fn changed(name: &'static str, make: Made) -> Request {
    Request {
        then_applies: true,
        ..asked(name, make)
    }
}

const fn told(name: &'static str, make: Made) -> Request {
    Request {
        name,
        make,
        answered: false,
        renews: true,
        then_applies: false,
    }
}

/// All requests. Those that come first change what is played or stored, and are drawn more often.
pub const REQUESTS: &[Request] = &[
    asked("play", |n| ask::<PlayEndpoint>(n, &play("texture 0", 1.0))).renewing(),
    asked("play another texture", |n| {
        ask::<PlayEndpoint>(n, &play("texture 1", 1.0))
    })
    .renewing(),
    asked("play with another gain", |n| {
        ask::<PlayEndpoint>(n, &play("texture 0", 0.25))
    })
    .renewing(),
    asked("play at another rate", |n| {
        ask::<PlayEndpoint>(n, &play(FAST, 1.0))
    })
    .renewing(),
    asked("stop", |n| ask::<StopEndpoint>(n, &())),
    changed("set a limit", |n| {
        propose(n, &[set(Setting::HardLimit, 0.25)])
    }),
    changed("set what the coil needs", |n| {
        propose(n, &[set(Setting::AmplifierGain, 2.0)])
    }),
    changed("reset the settings", |n| {
        ask::<SettingsProposeEndpoint>(n, &SettingsChange::Reset)
    }),
    asked("activate A", |n| ask::<ActivateEndpoint>(n, &SlotId::A)),
    asked("activate B", |n| ask::<ActivateEndpoint>(n, &SlotId::B)),
    asked("begin an upload", |n| {
        ask::<UploadBeginEndpoint>(n, &announcement(&LIBRARIES[2]))
    }),
    asked("self test of a slot", |n| {
        let request = SelfTestRequest::Flash {
            slot: SlotId::B,
            erases_library: true,
        };
        ask::<SelfTestEndpoint>(n, &request)
    }),
    asked("self test of the output", |n| {
        ask::<SelfTestEndpoint>(n, &SelfTestRequest::Output { disconnected: true })
    }),
    asked("begin another upload", |n| {
        let begin = UploadBegin {
            replaces_last: true,
            ..announcement(&LIBRARIES[1])
        };
        ask::<UploadBeginEndpoint>(n, &begin)
    }),
    asked("the only chunk", |n| chunk(n, 0, usize::MAX)),
    asked("first chunk", |n| chunk(n, 0, HALF)),
    asked("second chunk", |n| chunk(n, HALF, usize::MAX)),
    asked("commit", |n| ask::<UploadCommitEndpoint>(n, &())),
    asked("abort", |n| ask::<UploadAbortEndpoint>(n, &())),
    asked("progress", |n| ask::<UploadProgressEndpoint>(n, &())),
    asked("slots", |n| ask::<SlotsEndpoint>(n, &())),
    asked("list", |n| ask::<ListEndpoint>(n, &first_of(SlotId::A))),
    asked("list scenes", |n| {
        ask::<ListSceneEndpoint>(n, &first_of(SlotId::B))
    }),
    asked("set a value out of range", |n| {
        propose(n, &[set(Setting::HardLimit, 99.0)])
    }),
    asked("propose and forget", |n| {
        propose(n, &[set(Setting::OutputGain, 0.5)])
    }),
    asked("apply by a token of nobody", |n| apply(n, ProposalToken(0))),
    asked("settings", |n| ask::<SettingsGetEndpoint>(n, &())),
    asked("play by the sensors", |n| {
        let request = PlayRequest {
            motion: MotionSource::Sensors,
            ..play("texture 0", 1.0)
        };
        ask::<PlayEndpoint>(n, &request)
    })
    .renewing(),
    asked("play a scene at another rate", |n| {
        let request = PlayRequest {
            selection: Selection::Scene(FAST.try_into().expect("it is short")),
            ..play("", 1.0)
        };
        ask::<PlayEndpoint>(n, &request)
    })
    .renewing(),
    asked("play what is not there", |n| {
        ask::<PlayEndpoint>(n, &play("nothing", 1.0))
    }),
    asked("motion", |n| ask::<MotionEndpoint>(n, &motion())).renewing(),
    told("live motion", |n| tell::<MotionTopic>(n, &motion())),
    told("keep alive", |n| tell::<KeepAliveTopic>(n, &())),
    asked("record", |n| ask::<RecordStartEndpoint>(n, &())),
    asked("end of the recording", |n| {
        ask::<RecordStopEndpoint>(n, &())
    }),
    asked("self test of the chip", |n| {
        ask::<SelfTestEndpoint>(n, &SelfTestRequest::Chip)
    }),
    asked("status", |n| ask::<StatusEndpoint>(n, &())),
    asked("cycles", |n| ask::<CyclesEndpoint>(n, &())),
    asked("info", |n| ask::<InfoEndpoint>(n, &())),
    asked("ping", |n| ask::<PingEndpoint>(n, &7)),
    asked("a request without its body", |n| {
        frame(PlayEndpoint::REQ_KEY, header(n), &())
    }),
    asked("an unknown request", |n| {
        frame(Key::for_path::<()>("nowhere"), header(n), &())
    }),
];

/// Bytes of the first chunk of an upload in two.
const HALF: usize = 64;

/// Number of the requests that come first.
pub const FIRST: usize = 13;

/// Name of the texture and of the scene for 10 kHz; all others are for 5 kHz.
const FAST: &str = "fast";

/// The rate at which `selection` is to be played.
pub fn rate_of(selection: &Selection) -> PlayRate {
    let (Selection::Texture(name) | Selection::Scene(name)) = selection;
    if name == FAST {
        PlayRate::Hz10000
    } else {
        PlayRate::Hz5000
    }
}

/// The libraries in slots A and B, and one to upload. The names of their textures are the same.
pub static LIBRARIES: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
    [1, 2, 3].map(|seed| {
        let slow = ["texture 0", "texture 1"].map(|name| small_texture(name, seed, 5_000));
        let fast = small_texture(FAST, seed, 10_000);
        let name = FAST.try_into().expect("it is short");
        let scene = Scene::of_surface(name, 10_000, Surface::of_texture(slow.len() as u8));
        let textures: Vec<_> = slow.into_iter().chain([fast]).collect();
        let bytes = encode_with_scenes(&textures, &[scene]).expect("the library is valid");
        assert!(HALF < bytes.len() && bytes.len() < 512);
        bytes
    })
});

fn header(number: u32) -> VarHeader {
    VarHeader {
        key: VarKey::Key8(PingEndpoint::REQ_KEY),
        seq_no: VarSeq::Seq4(number),
    }
}

fn ask<E: Endpoint>(number: u32, request: &impl Serialize) -> Vec<u8> {
    frame(E::REQ_KEY, header(number), request)
}

fn tell<T: Topic>(number: u32, message: &impl Serialize) -> Vec<u8> {
    frame(T::TOPIC_KEY, header(number), message)
}

/// A proposal to change settings to `values`.
pub fn propose(number: u32, values: &[SettingChange]) -> Vec<u8> {
    let change = SettingsChange::of(values).expect("there is room for them");
    ask::<SettingsProposeEndpoint>(number, &change)
}

/// The application of the proposal that was answered with `token`.
pub fn apply(number: u32, token: ProposalToken) -> Vec<u8> {
    ask::<SettingsApplyEndpoint>(number, &token)
}

fn play(texture: &str, gain: f32) -> PlayRequest {
    PlayRequest {
        gain,
        ..play_request(texture)
    }
}

pub fn set(setting: Setting, value: f32) -> SettingChange {
    SettingChange { setting, value }
}

fn first_of(slot: SlotId) -> ListRequest {
    ListRequest { slot, index: 0 }
}

pub fn motion() -> MotionSample {
    MotionSample {
        speed: MillimetresPerSecond(100.0),
        force: Newton(1.0),
        position_mm: None,
        contact: None,
    }
}

fn chunk(number: u32, offset: usize, end: usize) -> Vec<u8> {
    let bytes = &LIBRARIES[2];
    let data = &bytes[offset..bytes.len().min(end)];
    let offset = offset as u32;
    ask::<UploadChunkEndpoint>(number, &UploadChunk { offset, data })
}
