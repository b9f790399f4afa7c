//! Tests of the protocol: sizes of frames, encodings and keys.

extern crate std;

use std::string::{String, ToString};
use std::vec::Vec;

use postcard_rpc::Key;
use postcard_schema::Schema;
use postcard_schema::schema::{DataModelType, DataModelVariant, NamedType, NamedValue, NamedVariant};
use proptest::prelude::*;

use super::*;
use crate::scene::SceneName;
use crate::{AdcCode, SAMPLE_RATE_HZ};

/// Length of postcard-rpc's header with the longest key and sequence number, bytes: 1, then 8 for the key and 4 for the
/// number.
const FRAME_HEADER_BYTES: usize = 13;

/// Largest length of a value of this type, bytes, if no text has more than `text` bytes and no sequence more than
/// `items` elements.
fn longest(of: &NamedType, [text, items]: [usize; 2]) -> usize {
    use DataModelType as Type;
    let one = |of: &NamedType| longest(of, [text, items]);
    let all = |of: &[&NamedType]| of.iter().map(|&of| one(of)).sum();
    let fields = |of: &[&NamedValue]| of.iter().map(|field| one(field.ty)).sum();
    let variant = |of: &NamedVariant| match of.ty {
        DataModelVariant::UnitVariant => 0,
        DataModelVariant::NewtypeVariant(of) => one(of),
        DataModelVariant::TupleVariant(of) => all(of),
        DataModelVariant::StructVariant(of) => fields(of),
    };
    match of.ty {
        Type::Unit | Type::UnitStruct => 0,
        Type::Bool | Type::I8 | Type::U8 => 1,
        Type::I16 | Type::U16 => 3,
        Type::I32 | Type::U32 => 5,
        Type::I64 | Type::U64 => 10,
        Type::F32 => 4,
        Type::String => 2 + text,
        // A response is the only byte array that is sent to the host.
        Type::ByteArray => 2 + RESPONSE_BYTES,
        Type::Seq(of) => 2 + items * one(of),
        Type::Option(of) => 1 + one(of),
        Type::NewtypeStruct(of) => one(of),
        Type::Tuple(of) | Type::TupleStruct(of) => all(of),
        Type::Struct(of) => fields(of),
        Type::Enum(of) => 1 + of.iter().map(|of| variant(of)).max().unwrap_or(0),
        other => panic!("{}: no message has a {other:?}", of.name),
    }
}

fn capacity<const N: usize>(_: fn(heapless::String<N>)) -> usize {
    N
}

#[test]
fn every_message_fits_a_frame() {
    fn fits<T: Schema + ?Sized>(text: usize, frame: usize) {
        let length = longest(T::SCHEMA, [text, SETTING_COUNT]) + FRAME_HEADER_BYTES;
        assert!(length <= frame, "{}: {length} bytes", T::SCHEMA.name);
    }
    fn to_host<E: postcard_rpc::Endpoint>(text: usize)
    where
        E::Response: Schema,
    {
        fits::<E::Response>(text, MAX_DEVICE_FRAME_BYTES);
    }
    let name = capacity(drop::<TextureName>).max(capacity(drop::<SceneName>));
    let fault = capacity(drop::<FaultText>).max(name);
    let reason = capacity(drop::<Reason>).max(name);
    to_host::<InfoEndpoint>(
        capacity(drop::<VersionText>)
            .max(capacity(drop::<ProductName>))
            .max(capacity(drop::<Serial>)),
    );
    to_host::<StatusEndpoint>(fault);
    to_host::<CyclesEndpoint>(0);
    to_host::<UploadBeginEndpoint>(reason);
    to_host::<UploadCommitEndpoint>(reason);
    to_host::<UploadAbortEndpoint>(reason);
    to_host::<UploadProgressEndpoint>(0);
    to_host::<SlotsEndpoint>(reason);
    to_host::<ListEndpoint>(reason);
    to_host::<ListSceneEndpoint>(reason);
    to_host::<ActivateEndpoint>(reason);
    to_host::<PlayEndpoint>(capacity(drop::<Arithmetic>).max(reason));
    to_host::<StopEndpoint>(name);
    to_host::<MotionEndpoint>(0);
    to_host::<RecordStartEndpoint>(0);
    to_host::<RecordStopEndpoint>(0);
    to_host::<SettingsGetEndpoint>(0);
    to_host::<SettingsProposeEndpoint>(0);
    to_host::<SettingsApplyEndpoint>(0);
    to_host::<ProbeLoadEndpoint>(capacity(drop::<Arithmetic>).max(reason));
    to_host::<ProbeStartEndpoint>(capacity(drop::<Arithmetic>).max(reason));
    to_host::<ResponseGetEndpoint>(0);
    to_host::<ResponseProposeEndpoint>(0);
    to_host::<ResponseSetEndpoint>(0);
    to_host::<SelfTestEndpoint>(reason);
    to_host::<UpdateBeginEndpoint>(reason);
    to_host::<UpdateCommitEndpoint>(reason);
    to_host::<UpdateConfirmEndpoint>(reason);
    to_host::<UpdateStateEndpoint>(0);
    // Header and signature with their length, checksum, and flag.
    const { assert!(2 + SIGNED_BYTES + 5 + 1 + FRAME_HEADER_BYTES <= MAX_HOST_FRAME_BYTES) };
    fits::<PlayRequest>(name, MAX_HOST_FRAME_BYTES);
    fits::<MotionSample>(0, MAX_HOST_FRAME_BYTES);
    fits::<SettingsChange>(0, MAX_HOST_FRAME_BYTES);
    fits::<SelfTestRequest>(0, MAX_HOST_FRAME_BYTES);
    fits::<Response>(0, MAX_HOST_FRAME_BYTES);
    // Offset, length and samples of a part of a probe.
    const { assert!(3 + 2 + 3 * PROBE_CHUNK_SAMPLES + FRAME_HEADER_BYTES <= MAX_HOST_FRAME_BYTES) };
    // Offset, length and bytes of a chunk.
    const { assert!(5 + 2 + MAX_CHUNK_BYTES + FRAME_HEADER_BYTES <= MAX_HOST_FRAME_BYTES) };
}

proptest! {
    #[test]
    fn a_response_is_its_bytes_on_every_way(mut bytes: [u8; 32], seed: u8) {
        let mut all = [0; RESPONSE_BYTES];
        for (at, byte) in all.iter_mut().enumerate() {
            bytes[at % 32] = bytes[at % 32].wrapping_mul(167).wrapping_add(seed | 1);
            *byte = bytes[at % 32];
        }
        let response = Response::from_bytes(&all);
        prop_assert_eq!(response.bytes(), all);
        let sent = postcard::to_slice(&response, &mut [0; 400]).expect("it fits").to_vec();
        prop_assert_eq!(postcard::from_bytes::<Response>(&sent), Ok(response));
        prop_assert!(postcard::from_bytes::<Response>(&sent[..sent.len() - 1]).is_err());
    }
}

#[test]
fn a_record_block_takes_less_than_400_bytes_whatever_is_in_it() {
    let block = |code: u16, sequence| RecordBlock {
        sequence,
        first_tick: u64::from(sequence) << 32,
        lost_blocks: sequence,
        torn: sequence,
        samples: [RecordSample {
            acceleration: [AdcCode(code); 3],
            force: AdcCode(code),
            encoder_delta: code as i16,
        }
        .into(); BLOCK_SAMPLES],
    };
    let length = postcard::to_slice(&block(u16::MAX, u32::MAX), &mut [0; 4096])
        .expect("no message is so long")
        .len();
    assert!(length + FRAME_HEADER_BYTES <= 400, "{length} bytes");
    // At the serial rate, 10 bits per byte, blocks take less than three quarters of the line.
    let bytes_per_second = SAMPLE_RATE_HZ / BLOCK_SAMPLES as u32 * (length as u32 + 20);
    assert!(bytes_per_second * 10 < SERIAL_BAUD / 4 * 3);
    // Twice as many samples would not fit, so recordings stay at this sample rate.
    assert!(2 * bytes_per_second * 10 > SERIAL_BAUD);
}

proptest! {
    #[test]
    fn a_packed_sample_is_the_sample(x: u16, y: u16, z: u16, force: u16, encoder_delta: i16) {
        let sample = RecordSample {
            acceleration: [x, y, z].map(AdcCode),
            force: AdcCode(force),
            encoder_delta,
        };
        prop_assert_eq!(RecordSample::from(PackedSample::from(sample)), sample);
    }

    #[test]
    fn settings_off_the_wire_are_in_range_or_refused(index in 0..SETTING_COUNT, value: f32) {
        let mut values = Setting::ALL.map(|setting| setting.spec().default);
        values[index] = value;
        let mut bytes = [0; 4 * SETTING_COUNT];
        let used = postcard::to_slice(&values, &mut bytes).expect("four bytes each");
        let decoded = postcard::from_bytes::<Settings>(used);
        let setting = Setting::ALL[index];
        prop_assert_eq!(decoded.is_ok(), setting.check(value).is_ok());
        if let Ok(settings) = decoded {
            prop_assert_eq!(settings.get(setting), value);
        }
    }
}

#[test]
fn settings_stand_at_their_numbers_with_defaults_in_range() {
    for (index, setting) in Setting::ALL.into_iter().enumerate() {
        let spec = setting.spec();
        assert_eq!(setting as usize, index);
        assert_eq!(setting.check(spec.default), Ok(spec.default));
        assert_eq!(Setting::named(spec.name), Some(setting));
        for outside in [spec.lowest - 1.0, spec.highest + 1.0, f32::NAN, f32::INFINITY] {
            assert!(setting.check(outside).is_err(), "{setting} {outside}");
        }
        assert_eq!(
            setting.check(0.5).is_ok(),
            !spec.whole && (spec.lowest..=spec.highest).contains(&0.5)
        );
    }
    assert_eq!(Setting::named("no such setting"), None);
}

#[test]
fn mute_reasons_are_kept_apart() {
    for (index, reason) in MuteReason::ALL.into_iter().enumerate() {
        assert_eq!(reason as usize, index);
        let one = MuteReasons::NONE.set(reason, true);
        assert_eq!(one.iter().collect::<Vec<_>>(), [reason]);
        assert_eq!(one.to_string(), reason.to_string());
        assert!(one.set(reason, false).is_empty());
    }
    assert_eq!(MuteReasons::from_bits(u8::MAX).iter().count(), MUTE_REASON_COUNT);
}

/// Path and key of each of this protocol's own entries.
fn keys() -> Vec<(String, Key)> {
    let own = |path: &str| path.starts_with("stylus/");
    let mut keys = Vec::new();
    for (path, request, response) in ENDPOINTS.endpoints {
        if own(path) {
            keys.push((std::format!("request  {path}"), *request));
            keys.push((std::format!("response {path}"), *response));
        }
    }
    for (direction, topics) in [("to device", TOPICS_IN.topics), ("to host", TOPICS_OUT.topics)] {
        for (path, key) in topics {
            if own(path) {
                keys.push((std::format!("{direction}  {path}"), *key));
            }
        }
    }
    keys
}

/// postcard-rpc's dispatcher computes its key length at compile time. Two equal keys, for example of a topic and an
/// endpoint with the same path and type, cause a panic there.
#[test]
fn a_dispatcher_can_tell_all_messages_apart() {
    use postcard_rpc::server::min_key_needed;
    let requests: Vec<Key> = ENDPOINTS.endpoints.iter().map(|entry| entry.1).collect();
    let responses: Vec<Key> = ENDPOINTS.endpoints.iter().map(|entry| entry.2).collect();
    let of = |topics: &[(&str, Key)]| -> Vec<Key> { topics.iter().map(|entry| entry.1).collect() };
    assert!(min_key_needed(&[&requests, &of(TOPICS_IN.topics)]) <= 8);
    assert!(min_key_needed(&[&responses, &of(TOPICS_OUT.topics)]) <= 8);
}

#[test]
fn keys_and_versions_are_those_that_are_written_down() {
    let mut lines = String::new();
    for (name, key) in keys() {
        let key = u64::from_be_bytes(key.to_bytes());
        lines += &std::format!("{key:016x}  {name}\n");
    }
    lines += &std::format!("{SCHEMA_HASH:016x}  all of them, protocol version {PROTOCOL_VERSION}\n");
    assert_eq!(
        lines,
        include_str!("keys.txt"),
        "the protocol has changed: if this was meant, copy the new lines to keys.txt, and raise PROTOCOL_VERSION if an \
         older program could misunderstand a message whose key is the same"
    );
}
