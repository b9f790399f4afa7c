//! A frame in, the answer out: the protocol by hand, over the application.

use model_format::link::{
    ActivateEndpoint, DeviceInfo, ENDPOINTS, InfoEndpoint, KeepAliveTopic, ListEndpoint,
    ListSceneEndpoint, MotionEndpoint, MotionTopic, PlayEndpoint, RecordStartEndpoint,
    RecordStopEndpoint, SettingsGetEndpoint, SettingsResetEndpoint, SettingsSetEndpoint,
    SlotsEndpoint, StatusEndpoint, StopEndpoint, TOPICS_IN, TOPICS_OUT, UploadAbortEndpoint,
    UploadBeginEndpoint, UploadChunkEndpoint, UploadCommitEndpoint, UploadProgressEndpoint,
};
use postcard_rpc::header::{VarHeader, VarKey, VarKeyKind};
use postcard_rpc::server::min_key_needed;
use postcard_rpc::standard_icd::{ERROR_KEY, WireError};
use postcard_rpc::{Endpoint, Key, Topic, postcard};
use serde::Serialize;

use super::bench::Stylus;

/// The shortest keys that tell all messages apart, as a device answers with.
pub fn key_kind() -> VarKeyKind {
    let requests: Vec<Key> = ENDPOINTS.endpoints.iter().map(|e| e.1).collect();
    let answers: Vec<Key> = ENDPOINTS.endpoints.iter().map(|e| e.2).collect();
    let heard: Vec<Key> = TOPICS_IN.topics.iter().map(|t| t.1).collect();
    let told: Vec<Key> = TOPICS_OUT.topics.iter().map(|t| t.1).collect();
    let needed = min_key_needed(&[&requests, &heard]).max(min_key_needed(&[&answers, &told]));
    match needed {
        1 => VarKeyKind::Key1,
        2 => VarKeyKind::Key2,
        4 => VarKeyKind::Key4,
        _ => VarKeyKind::Key8,
    }
}

/// A frame of `body` under `key`.
pub fn frame(key: Key, mut header: VarHeader, body: &impl Serialize) -> Vec<u8> {
    header.key = VarKey::Key8(key);
    header.key.shrink_to(key_kind());
    let mut bytes = header.write_to_vec();
    bytes.extend(postcard::to_stdvec(body).expect("it fits in memory"));
    bytes
}

/// The path that a frame is for.
pub fn path_of(header: &VarHeader) -> Option<&'static str> {
    let endpoints = ENDPOINTS.endpoints.iter().map(|e| (e.0, e.1));
    let topics = TOPICS_IN.topics.iter().map(|t| (t.0, t.1));
    endpoints
        .chain(topics)
        .find(|(_, key)| VarKey::Key8(*key) == header.key)
        .map(|(path, _)| path)
}

/// Whether a frame asks for what the device does apart from the rest.
pub fn needs_flash(header: &VarHeader) -> bool {
    let path = path_of(header).unwrap_or_default();
    let prefixes = [
        "stylus/upload/",
        "stylus/slots",
        "stylus/list",
        "stylus/activate",
    ];
    prefixes.iter().any(|prefix| path.starts_with(prefix))
}

/// Serves one frame; `disguise` may change what the device says it is.
pub async fn serve(
    stylus: &mut Stylus,
    header: &VarHeader,
    body: &[u8],
    disguise: impl FnOnce(&mut DeviceInfo),
) -> Option<Vec<u8>> {
    let control = stylus.control.clone();
    let (storage, hall) = (&mut stylus.storage, &mut stylus.hall);
    macro_rules! endpoint {
        ($endpoint:ty, $request:pat => $answer:expr) => {
            if header.key == VarKey::Key8(<$endpoint as Endpoint>::REQ_KEY) {
                let Ok($request) = postcard::from_bytes::<<$endpoint as Endpoint>::Request>(body)
                else {
                    return Some(frame(ERROR_KEY, *header, &WireError::DeserFailed));
                };
                control.borrow_mut().heard();
                let answer: <$endpoint as Endpoint>::Response = $answer;
                return Some(frame(<$endpoint as Endpoint>::RESP_KEY, *header, &answer));
            }
        };
    }
    endpoint!(InfoEndpoint, () => {
        let mut info = control.borrow().info();
        disguise(&mut info);
        info
    });
    endpoint!(StatusEndpoint, () => control.borrow().status());
    endpoint!(UploadBeginEndpoint, begin => storage.upload_begin(hall, begin).await);
    endpoint!(UploadChunkEndpoint<'_>, chunk => storage.upload_chunk(hall, chunk).await);
    endpoint!(UploadCommitEndpoint, () => storage.upload_commit(hall).await);
    endpoint!(UploadAbortEndpoint, () => storage.upload_abort(hall));
    endpoint!(UploadProgressEndpoint, () => control.borrow().upload());
    endpoint!(SlotsEndpoint, () => storage.slots());
    endpoint!(ListEndpoint, request => storage.list(request));
    endpoint!(ListSceneEndpoint, request => storage.list_scene(request));
    endpoint!(ActivateEndpoint, slot => storage.activate(hall, slot).await);
    endpoint!(PlayEndpoint, request => control.borrow_mut().play(request));
    endpoint!(StopEndpoint, () => control.borrow_mut().stop());
    endpoint!(MotionEndpoint, sample => control.borrow_mut().motion(sample));
    endpoint!(RecordStartEndpoint, () => control.borrow_mut().record_start());
    endpoint!(RecordStopEndpoint, () => control.borrow_mut().record_stop());
    endpoint!(SettingsGetEndpoint, () => Ok(control.borrow().settings()));
    endpoint!(SettingsSetEndpoint, change => storage.settings_set(hall, change).await);
    endpoint!(SettingsResetEndpoint, () => storage.settings_reset(hall).await);
    if header.key == VarKey::Key8(MotionTopic::TOPIC_KEY)
        && let Ok(sample) = postcard::from_bytes(body)
    {
        control.borrow_mut().heard();
        // What is refused is told to those who ask.
        let _ = control.borrow_mut().motion(sample);
        return None;
    }
    if header.key == VarKey::Key8(KeepAliveTopic::TOPIC_KEY) {
        control.borrow_mut().heard();
        return None;
    }
    Some(frame(ERROR_KEY, *header, &WireError::UnknownKey))
}
