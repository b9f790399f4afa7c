//! The list of requests, and the libraries that the requests use.

use std::sync::LazyLock;

use fake_stylus::device::{MOTION, change, play_request, response_for};
use fake_stylus::library::{announcement, small_texture};
use model_format::link::{
    ActivateEndpoint, CyclesEndpoint, DEVELOPMENT_SEED, ENDPOINTS, InfoEndpoint, KeepAliveTopic, ListEndpoint,
    ListRequest, ListSceneEndpoint, MotionEndpoint, MotionSource, MotionTopic, PlayEndpoint, PlayRequest, ProbeLoad,
    ProbeLoadEndpoint, ProbeStart, ProbeStartEndpoint, ProbeThrough, ProposalToken, RecordStartEndpoint,
    RecordStopEndpoint, ResponseChange, ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint, Selection,
    SelfTestEndpoint, SelfTestRequest, Setting, SettingChange, Settings, SettingsApplyEndpoint, SettingsChange,
    SettingsGetEndpoint, SettingsProposeEndpoint, SlotId, SlotsEndpoint, StatusEndpoint, StopEndpoint, TOPICS_IN,
    UpdateBegin, UpdateBeginEndpoint, UpdateCommitEndpoint, UpdateConfirmEndpoint, UpdateStateEndpoint,
    UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint, UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint,
    UploadProgressEndpoint,
};
use model_format::scene::{Scene, Surface};
use model_format::{PlayRate, encode_with_scenes};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::PingEndpoint;
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;
use stylus_app::update::sign;

use crate::update::{BOARD, RUNNING};

/// A request: its name, and its message.
#[derive(Clone)]
pub struct Request {
    pub name: &'static str,
    key: Key,
    body: Vec<u8>,
    /// True if the request is answered.
    pub answered: bool,
    /// True if the request renews the lease of a host that plays.
    pub renews: bool,
    /// True if a second frame of its host follows, which applies the change that this request proposes.
    pub then_applies: bool,
}

impl Request {
    /// Frame of the request with sequence number `number`.
    pub fn frame(&self, number: u32) -> Vec<u8> {
        let header = VarHeader {
            key: VarKey::Key8(self.key),
            seq_no: VarSeq::Seq4(number),
        };
        [header.write_to_vec(), self.body.clone()].concat()
    }
}

fn request(name: &'static str, key: Key, body: &impl Serialize) -> Request {
    Request {
        name,
        key,
        body: postcard::to_allocvec(body).expect("it fits in memory"),
        answered: true,
        renews: false,
        then_applies: false,
    }
}

fn asked<E: Endpoint>(name: &'static str, body: &impl Serialize) -> Request {
    request(name, E::REQ_KEY, body)
}

fn renews<E: Endpoint>(name: &'static str, body: &impl Serialize) -> Request {
    Request {
        renews: true,
        ..asked::<E>(name, body)
    }
}

fn told<T: Topic>(name: &'static str, body: &impl Serialize) -> Request {
    Request {
        answered: false,
        renews: true,
        ..request(name, T::TOPIC_KEY, body)
    }
}

/// A change of settings in two steps: a proposal and its application.
pub fn changed(name: &'static str, values: &[SettingChange]) -> Request {
    Request {
        then_applies: true,
        ..proposed(name, values)
    }
}

/// A proposal to change settings to `values`, or to reset them if there are none.
fn proposed(name: &'static str, values: &[SettingChange]) -> Request {
    let change = if values.is_empty() {
        SettingsChange::Reset
    } else {
        SettingsChange::of(values).expect("there is room for them")
    };
    asked::<SettingsProposeEndpoint>(name, &change)
}

/// The application of the proposal that was answered with `token`.
pub fn applied(name: &'static str, token: ProposalToken) -> Request {
    asked::<SettingsApplyEndpoint>(name, &token)
}

/// All requests. The first [`FIRST`] of them change what is played or stored, and are chosen more often.
pub static REQUESTS: LazyLock<Vec<Request>> = LazyLock::new(|| {
    let slow = play("texture 0", 1.0);
    let by_sensors = PlayRequest {
        motion: MotionSource::Sensors,
        ..slow.clone()
    };
    let fast_scene = PlayRequest {
        selection: Selection::Scene(FAST.try_into().expect("it is short")),
        ..slow.clone()
    };
    let of_slot = SelfTestRequest::Flash {
        slot: SlotId::B,
        erases_library: true,
    };
    let replacing = UploadBegin {
        replaces_last: true,
        ..announcement(&LIBRARIES[1])
    };
    let samples = [PROBE; 16];
    let probe = ProbeStart::of(&samples, 100, 20.0);
    let through = ProbeThrough::Proposed;
    let proposed_probe = ProbeStart {
        through,
        rate_hz: 10_000,
        ..probe
    };
    let load = ProbeLoad::parts(&samples).next().expect("it has samples");
    let response = response_for(&Settings::default());
    let id = response.id();
    // Its chunks never come, so that no commit restarts the device.
    let image = &LIBRARIES[1];
    let update = UpdateBegin::new(image, &sign(BOARD, image, RUNNING.image, &DEVELOPMENT_SEED));
    let [whole, first, second] = [(0, usize::MAX), (0, HALF), (HALF, usize::MAX)].map(chunk);
    vec![
        renews::<PlayEndpoint>("play", &slow),
        renews::<PlayEndpoint>("play another texture", &play("texture 1", 1.0)),
        renews::<PlayEndpoint>("play with another gain", &play("texture 0", 0.25)),
        renews::<PlayEndpoint>("play at another rate", &play(FAST, 1.0)),
        asked::<StopEndpoint>("stop", &()),
        changed("set a limit", &[change(Setting::HardLimit, 0.25)]),
        changed("set the amplifier", &[change(Setting::AmplifierGain, 2.0)]),
        changed("reset the settings", &[]),
        asked::<ActivateEndpoint>("activate A", &SlotId::A),
        asked::<ActivateEndpoint>("activate B", &SlotId::B),
        asked::<UploadBeginEndpoint>("begin an upload", &announcement(&LIBRARIES[2])),
        asked::<SelfTestEndpoint>("self test of a slot", &of_slot),
        asked::<SelfTestEndpoint>(
            "self test of the output",
            &SelfTestRequest::Output { disconnected: true },
        ),
        asked::<ProbeLoadEndpoint>("load a probe", &load),
        renews::<ProbeStartEndpoint>("probe", &probe),
        renews::<ProbeStartEndpoint>("probe through the proposed response", &proposed_probe),
        asked::<ResponseProposeEndpoint>("propose a response", &response),
        asked::<ResponseSetEndpoint>("store the response", &ResponseChange::Store { id }),
        asked::<ResponseSetEndpoint>("remove the response", &ResponseChange::Clear { id }),
        asked::<ResponseGetEndpoint>("response", &()),
        asked::<UploadBeginEndpoint>("begin another upload", &replacing),
        asked::<UploadChunkEndpoint>("the only chunk", &whole),
        asked::<UploadChunkEndpoint>("first chunk", &first),
        asked::<UploadChunkEndpoint>("second chunk", &second),
        asked::<UploadCommitEndpoint>("commit", &()),
        asked::<UploadAbortEndpoint>("abort", &()),
        asked::<UploadProgressEndpoint>("progress", &()),
        asked::<SlotsEndpoint>("slots", &()),
        asked::<ListEndpoint>("list", &first_of(SlotId::A)),
        asked::<ListSceneEndpoint>("list scenes", &first_of(SlotId::B)),
        proposed("set a value out of range", &[change(Setting::HardLimit, 99.0)]),
        proposed("propose and forget", &[change(Setting::OutputGain, 0.5)]),
        applied("apply by a token of nobody", ProposalToken(0)),
        asked::<SettingsGetEndpoint>("settings", &()),
        renews::<PlayEndpoint>("play by the sensors", &by_sensors),
        renews::<PlayEndpoint>("play a scene at another rate", &fast_scene),
        asked::<PlayEndpoint>("play what is not there", &play("nothing", 1.0)),
        renews::<MotionEndpoint>("motion", &MOTION),
        told::<MotionTopic>("live motion", &MOTION),
        told::<KeepAliveTopic>("keep alive", &()),
        asked::<RecordStartEndpoint>("record", &()),
        asked::<RecordStopEndpoint>("end of the recording", &()),
        asked::<SelfTestEndpoint>("self test of the chip", &SelfTestRequest::Chip),
        asked::<UpdateBeginEndpoint>("begin an update", &update),
        asked::<UpdateBeginEndpoint>("begin no update", &UpdateBegin::default()),
        asked::<UpdateCommitEndpoint>("commit an update", &()),
        asked::<UpdateConfirmEndpoint>("confirm an update", &()),
        asked::<UpdateStateEndpoint>("update state", &()),
        asked::<StatusEndpoint>("status", &()),
        asked::<CyclesEndpoint>("cycles", &()),
        asked::<InfoEndpoint>("info", &()),
        asked::<PingEndpoint>("ping", &7),
        asked::<PlayEndpoint>("a request without its body", &()),
        request("an unknown request", Key::for_path::<()>("nowhere"), &()),
    ]
});

#[test]
fn no_request_of_the_link_is_missing_in_the_list() {
    let requests = ENDPOINTS.endpoints.iter().map(|entry| (entry.0, entry.1));
    let all = requests.chain(TOPICS_IN.topics.iter().copied());
    // Another crate has requests of its own, which tell schemas.
    for (path, key) in all.filter(|(path, _)| path.starts_with("stylus/")) {
        assert!(REQUESTS.iter().any(|request| request.key == key), "{path}");
    }
}

/// Bytes of the first chunk of an upload in two chunks.
const HALF: usize = 64;

/// Number of requests at the beginning of [`REQUESTS`] that are chosen more often.
pub const FIRST: usize = 19;

/// Value of all samples of the probe, large enough that some of it passes the DC blocker.
const PROBE: i16 = 30_000;

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

fn play(texture: &str, gain: f32) -> PlayRequest {
    PlayRequest {
        gain,
        ..play_request(texture)
    }
}

fn first_of(slot: SlotId) -> ListRequest {
    ListRequest { slot, index: 0 }
}

/// The part of a library from an offset to an end.
fn chunk((offset, end): (usize, usize)) -> UploadChunk<'static> {
    let bytes = &LIBRARIES[2];
    let data = &bytes[offset..bytes.len().min(end)];
    let offset = offset as u32;
    UploadChunk { offset, data }
}
