//! Frames of the link as they arrive at the host, and the messages in them.

use std::collections::VecDeque;

use host_tools::link::FrameDecoder;
use host_tools::link::usb::{self, FromBus};
use model_format::link::{
    ActivateEndpoint, CyclesEndpoint, InfoEndpoint, ListEndpoint, ListSceneEndpoint, MAX_DEVICE_FRAME_BYTES,
    MotionEndpoint, PlayEndpoint, ProbeLoadEndpoint, ProbeStartEndpoint, RecordStartEndpoint, RecordStopEndpoint,
    ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint, SelfTestEndpoint, SettingsGetEndpoint,
    SettingsProposeEndpoint, SlotsEndpoint, StatusEndpoint, StopEndpoint, UpdateBeginEndpoint, UpdateCommitEndpoint,
    UpdateStateEndpoint, UploadAbortEndpoint, UploadBeginEndpoint, UploadCommitEndpoint, UploadProgressEndpoint,
};
use postcard_rpc::Endpoint;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Checks `input` as a stream of frames, and as one message.
pub fn judge(input: &[u8]) {
    let frames = decoded(input);
    // The decoded frames are sent again after noise, and must be decoded to the same frames.
    let mut stream = vec![0];
    for frame in &frames {
        assert!(frame.len() <= MAX_DEVICE_FRAME_BYTES);
        stream.extend(cobs::encode_vec(frame));
        stream.push(0);
    }
    assert_eq!(decoded(&stream), frames);
    frames.iter().for_each(|frame| messages(frame));
    messages(input);
    let mut bytes: VecDeque<u8> = input.iter().copied().collect();
    while let Ok(Some(message)) = usb::take::<FromBus>(&mut bytes) {
        let mut again = VecDeque::from(usb::encode(&message));
        assert_eq!(usb::take(&mut again).ok().flatten(), Some(message));
    }
}

fn decoded(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut decoder = FrameDecoder::default();
    stream.iter().filter_map(|&byte| decoder.push(byte)?.ok()).collect()
}

/// Decodes a frame as the answer of each endpoint. Chunks of an upload, applied settings and confirmed updates have
/// answers of the same types as others here.
fn messages(frame: &[u8]) {
    answer::<InfoEndpoint>(frame);
    answer::<StatusEndpoint>(frame);
    answer::<CyclesEndpoint>(frame);
    answer::<UploadBeginEndpoint>(frame);
    answer::<UploadCommitEndpoint>(frame);
    answer::<UploadAbortEndpoint>(frame);
    answer::<UploadProgressEndpoint>(frame);
    answer::<SlotsEndpoint>(frame);
    answer::<ListEndpoint>(frame);
    answer::<ListSceneEndpoint>(frame);
    answer::<ActivateEndpoint>(frame);
    answer::<PlayEndpoint>(frame);
    answer::<StopEndpoint>(frame);
    answer::<MotionEndpoint>(frame);
    answer::<RecordStartEndpoint>(frame);
    answer::<RecordStopEndpoint>(frame);
    answer::<SettingsGetEndpoint>(frame);
    answer::<SettingsProposeEndpoint>(frame);
    answer::<ProbeLoadEndpoint>(frame);
    answer::<ProbeStartEndpoint>(frame);
    answer::<ResponseGetEndpoint>(frame);
    answer::<ResponseProposeEndpoint>(frame);
    answer::<ResponseSetEndpoint>(frame);
    answer::<SelfTestEndpoint>(frame);
    answer::<UpdateBeginEndpoint>(frame);
    answer::<UpdateCommitEndpoint>(frame);
    answer::<UpdateStateEndpoint>(frame);
}

/// If an answer can be decoded, its encoding must mean the same. Bytes are compared, because NaN is not equal to
/// itself.
fn answer<E: Endpoint>(frame: &[u8])
where
    E::Response: Serialize + DeserializeOwned,
{
    let Ok(message) = postcard::from_bytes::<E::Response>(frame) else {
        return;
    };
    let bytes = postcard::to_allocvec(&message).expect("it was decoded");
    let again: E::Response = postcard::from_bytes(&bytes).expect("it was encoded");
    assert_eq!(postcard::to_allocvec(&again).expect("it was decoded"), bytes);
}
