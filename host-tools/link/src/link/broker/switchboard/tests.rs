//! Schedules of requests of several clients, against a device in the test.

use std::collections::VecDeque;

use model_format::link::{
    BLOCK_SAMPLES, InfoEndpoint, ListEndpoint, PackedSample, RecordError, RecordStarted,
    StatusEndpoint,
};
use proptest::prelude::*;

use super::*;
use test_helpers::holds;

fn request(key: Key, number: u16, body: &[u8]) -> Vec<u8> {
    let header = VarHeader {
        key: VarKey::Key8(key),
        seq_no: VarSeq::Seq2(number),
    };
    frame(header, body)
}

/// The key, number and body of a frame.
fn parts(bytes: &[u8]) -> (Key, u16, Vec<u8>) {
    let (header, body) = VarHeader::take_from_slice(bytes).unwrap();
    match (header.key, header.seq_no) {
        (VarKey::Key8(key), VarSeq::Seq2(number)) => (key, number, body.to_vec()),
        other => panic!("{other:?}"),
    }
}

/// The answer of a device to `asked`, with this body.
fn answer_to(asked: &[u8], key: Key, body: &[u8]) -> Vec<u8> {
    request(key, parts(asked).1, body)
}

fn for_device(actions: &[Action]) -> Vec<Vec<u8>> {
    let of = |action: &Action| match action {
        Action::ToDevice(frame) => Some(frame.clone()),
        _ => None,
    };
    actions.iter().filter_map(of).collect()
}

fn for_client(actions: &[Action], client: ClientId) -> Vec<FromBroker> {
    let of = |action: &Action| match action {
        Action::ToClient(to, message) if *to == client => Some(message.clone()),
        _ => None,
    };
    actions.iter().filter_map(of).collect()
}

fn three() -> Switchboard {
    let mut board = Switchboard::default();
    for (client, command) in [(1, "play"), (2, "status"), (3, "stop")] {
        let (command, process) = (command.to_owned(), Some(7));
        board.joined(client, Program { command, process });
    }
    board
}

/// Returns the words with which a request of `client` is refused. Checks that the answer is an error under the
/// request's number.
fn refusal(board: &mut Switchboard, client: ClientId, key: Key) -> String {
    let actions = board.frame_of(client, &request(key, 6, &[]));
    assert!(for_device(&actions).is_empty(), "{actions:?}");
    let said = for_client(&actions, client);
    let [FromBroker::Refused { words, .. }, FromBroker::Frame(frame)] = &said[..] else {
        panic!("{said:?}")
    };
    let (key, answered, _) = parts(frame);
    assert_eq!((key, answered), (ERROR_KEY, 6));
    words.clone()
}

/// Sends a request of `client` and the device's answer, which is a refusal if `is_refused`.
fn done(board: &mut Switchboard, client: ClientId, keys: (Key, Key), is_refused: bool) {
    let frame = for_device(&board.frame_of(client, &request(keys.0, 5, &[]))).remove(0);
    board.frame_of_device(&answer_to(&frame, keys.1, &[is_refused.into()]));
}

const PLAY: (Key, Key) = (PlayEndpoint::REQ_KEY, PlayEndpoint::RESP_KEY);
const BEGIN: (Key, Key) = (UploadBeginEndpoint::REQ_KEY, UploadBeginEndpoint::RESP_KEY);
const COMMIT: (Key, Key) = (
    UploadCommitEndpoint::REQ_KEY,
    UploadCommitEndpoint::RESP_KEY,
);

/// A step of a schedule.
#[derive(Clone, Debug)]
enum Step {
    /// A client asks, under a number that others use too.
    Ask(ClientId, u16),
    /// The device answers the waiting request at this place.
    Answer(prop::sample::Index),
    /// A client leaves, and comes again as another one.
    Leave(ClientId),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => (0..5u64, 0..4u16).prop_map(|(client, number)| Step::Ask(client, number)),
        6 => any::<prop::sample::Index>().prop_map(Step::Answer),
        1 => (0..5u64).prop_map(Step::Leave),
    ]
}

proptest! {
    #[test]
    fn every_answer_goes_to_who_asked_under_its_number_and_none_is_lost(
        schedule in prop::collection::vec(step(), 1..300)
    ) {
        let mut board = Switchboard::default();
        let mut names: Vec<ClientId> = (0..5).collect();
        let (mut next, mut serial, mut left) = (5, 0u32, BTreeSet::new());
        let mut device: VecDeque<(ClientId, u16, u32, Vec<u8>)> = VecDeque::new();
        for step in schedule {
            match step {
                Step::Ask(place, number) => {
                    let client = names[place as usize];
                    serial += 1;
                    let key =
                        [StatusEndpoint::REQ_KEY, InfoEndpoint::REQ_KEY][serial as usize % 2];
                    let frame = request(key, number, &serial.to_le_bytes());
                    let asked = for_device(&board.frame_of(client, &frame)).remove(0);
                    let (found, _, body) = parts(&asked);
                    prop_assert_eq!((found, body), (key, serial.to_le_bytes().to_vec()));
                    device.push_back((client, number, serial, asked));
                }
                Step::Answer(index) if !device.is_empty() => {
                    let place = index.index(device.len());
                    let (client, number, serial, frame) = device.remove(place).unwrap();
                    let body = serial.to_le_bytes();
                    let answer = answer_to(&frame, StatusEndpoint::RESP_KEY, &body);
                    let expected = request(StatusEndpoint::RESP_KEY, number, &body);
                    let expected = Action::ToClient(client, FromBroker::Frame(expected));
                    let actions = board.frame_of_device(&answer);
                    let is_there = !left.contains(&client);
                    prop_assert_eq!(actions, Vec::from_iter(is_there.then_some(expected)));
                    // A second answer goes to nobody.
                    prop_assert!(board.frame_of_device(&answer).is_empty());
                }
                Step::Answer(_) => {}
                Step::Leave(place) => {
                    let client = std::mem::replace(&mut names[place as usize], next);
                    left.insert(client);
                    prop_assert!(board.left(client).is_empty());
                    next += 1;
                }
            }
        }
        prop_assert_eq!(board.asked.len(), device.len());
    }

    /// Each of several clients sees all blocks of its recording, whenever others begin and end theirs.
    #[test]
    fn a_recording_of_several_clients_is_each_ones_own(
        steps in prop::collection::vec((0..4u64, 0..3u8), 1..200)
    ) {
        let mut board = Switchboard::default();
        let mut device = Device::default();
        let mut seen = Seen::default();
        for (client, what) in steps {
            let of = |key| request(key, 9, &[]);
            let records = seen.get(client as usize).is_some_and(Option::is_some);
            let actions = match (client, what) {
                (3, _) => match device.block() {
                    Some(block) => board.frame_of_device(&block),
                    None => continue,
                },
                (_, 0) if !records => board.frame_of(client, &of(RecordStartEndpoint::REQ_KEY)),
                (_, 1) if records => board.frame_of(client, &of(RecordStopEndpoint::REQ_KEY)),
                (_, 2) => {
                    seen[client as usize] = None;
                    board.left(client)
                }
                _ => continue,
            };
            let mut queue = VecDeque::from(actions);
            let mut before = 0;
            while let Some(action) = queue.pop_front() {
                match action {
                    Action::ToDevice(frame) => {
                        queue.extend(board.frame_of_device(&device.answer(&frame)));
                    }
                    Action::Block(frame) => see_block(&mut seen, &frame)?,
                    Action::ToClient(_, FromBroker::Joins { blocks, .. }) => before = blocks,
                    Action::ToClient(_, FromBroker::Frame(frame)) => {
                        see_answer(&mut seen[client as usize], &frame, before)?;
                    }
                    other @ Action::ToClient(..) => panic!("{other:?}"),
                }
            }
            // The device records exactly while somebody wants it.
            prop_assert_eq!(device.recording.is_some(), seen.iter().any(Option::is_some));
        }
    }
}

/// First block of each client's recording, and the number of blocks that the client has seen.
type Seen = [Option<(u32, u32)>; 3];

fn see_block(seen: &mut Seen, frame: &[u8]) -> Result<(), TestCaseError> {
    let block: RecordBlock = postcard::from_bytes(&parts(frame).2).unwrap();
    for (first, count) in seen.iter_mut().flatten() {
        prop_assert_eq!(block.sequence, *first + *count);
        *count += 1;
    }
    Ok(())
}

/// Checks the answer to a client that has seen `mine`. A start joins a recording that already had `before` blocks.
fn see_answer(
    mine: &mut Option<(u32, u32)>,
    frame: &[u8],
    before: u32,
) -> Result<(), TestCaseError> {
    let (key, _, body) = parts(frame);
    if key == RecordStartEndpoint::RESP_KEY {
        let answer: Result<RecordStarted, RecordError> = postcard::from_bytes(&body).unwrap();
        prop_assert!(answer.is_ok());
        *mine = Some((before, 0));
    } else {
        let answer: Result<RecordStopped, RecordError> = postcard::from_bytes(&body).unwrap();
        let (first, count) = mine.take().unwrap();
        prop_assert_eq!(answer.unwrap().blocks, first + count);
    }
    Ok(())
}

/// A recorder, with the number of its next block.
#[derive(Default)]
struct Device {
    recording: Option<u32>,
}

impl Device {
    fn answer(&mut self, frame: &[u8]) -> Vec<u8> {
        if parts(frame).0 == RecordStartEndpoint::REQ_KEY {
            let answer = match self.recording {
                Some(_) => Err(RecordError::Recording),
                None => Ok(RecordStarted {
                    sample_rate_hz: 5000,
                    block_samples: BLOCK_SAMPLES as u32,
                }),
            };
            self.recording.get_or_insert(0);
            return answer_to(frame, RecordStartEndpoint::RESP_KEY, &encoded(&answer));
        }
        let stopped = self.recording.take().map(|blocks| RecordStopped {
            blocks,
            lost_blocks: 0,
        });
        let answer = stopped.ok_or(RecordError::NotRecording);
        answer_to(frame, RecordStopEndpoint::RESP_KEY, &encoded(&answer))
    }

    fn block(&mut self) -> Option<Vec<u8>> {
        let sequence = self.recording?;
        self.recording = Some(sequence + 1);
        let block = RecordBlock {
            sequence,
            first_tick: u64::from(sequence) * BLOCK_SAMPLES as u64,
            lost_blocks: 0,
            torn: 0,
            samples: [PackedSample::ZERO; BLOCK_SAMPLES],
        };
        Some(request(RecordBlockTopic::TOPIC_KEY, 0, &encoded(&block)))
    }
}

#[test]
fn what_would_disturb_a_play_does_not_reach_the_device_and_the_rest_goes_on() {
    let mut board = three();
    let motion = request(MotionTopic::TOPIC_KEY, 0, &[1, 2, 3]);
    let keep_alive = request(KeepAliveTopic::TOPIC_KEY, 0, &[]);
    // Nobody plays.
    let reached = for_device(&board.frame_of(2, &motion));
    assert_eq!(reached, std::slice::from_ref(&motion));
    done(&mut board, 1, PLAY, false);
    for frame in [&motion, &keep_alive] {
        assert!(board.frame_of(2, frame).is_empty());
        let reached = for_device(&board.frame_of(1, frame));
        assert_eq!(reached, std::slice::from_ref(frame));
    }
    for key in [
        MotionEndpoint::REQ_KEY,
        PlayEndpoint::REQ_KEY,
        ActivateEndpoint::REQ_KEY,
        SelfTestEndpoint::REQ_KEY,
        SettingsProposeEndpoint::REQ_KEY,
        SettingsApplyEndpoint::REQ_KEY,
    ] {
        let who = "`stylus play` (process 7) plays, begun 0 s ago";
        let told = format!("{who}: stop it with `stylus stop`, or wait for its end");
        assert_eq!(refusal(&mut board, 2, key), told);
    }
    for key in [
        StatusEndpoint::REQ_KEY,
        UploadBeginEndpoint::REQ_KEY,
        UploadChunkEndpoint::REQ_KEY,
        RecordStartEndpoint::REQ_KEY,
    ] {
        let actions = board.frame_of(2, &request(key, 6, &[]));
        assert_eq!(for_device(&actions).len(), 1);
    }
    for frame in [&[][..], &[0xff], &[0xc0, 1, 2]] {
        assert!(board.frame_of(2, frame).is_empty());
        assert!(board.frame_of_device(frame).is_empty());
    }
    refusal(&mut board, 2, PLAY.0);
}

#[test]
fn a_stop_of_any_client_ends_a_play_and_tells_who_played() {
    let mut board = three();
    done(&mut board, 1, PLAY, false);
    let stop = request(StopEndpoint::REQ_KEY, 1, &[]);
    let stopped = board.frame_of(3, &stop);
    assert_eq!(for_device(&stopped).len(), 1);
    let by = "`stylus stop` (process 7)".to_owned();
    assert_eq!(for_client(&stopped, 1), [FromBroker::Stopped { by }]);
    // Another client may play now, and late motions of the first client do not reach the device.
    done(&mut board, 2, PLAY, false);
    let late = request(KeepAliveTopic::TOPIC_KEY, 0, &[]);
    assert!(board.frame_of(1, &late).is_empty());
    // A player that stops itself gets no message about it.
    let stopped = board.frame_of(2, &stop);
    assert!(for_client(&stopped, 2).is_empty() && for_client(&stopped, 1).is_empty());
}

#[test]
fn the_motion_is_free_after_a_refused_play_and_after_its_holder_is_gone() {
    let mut board = three();
    done(&mut board, 1, PLAY, true);
    done(&mut board, 2, PLAY, false);
    // A refused change of what is played leaves the first play with its holder.
    done(&mut board, 2, PLAY, true);
    refusal(&mut board, 1, PLAY.0);
    // A client that is killed sends no stop; the device mutes by itself.
    assert!(board.left(2).is_empty());
    done(&mut board, 1, PLAY, false);
}

#[test]
fn one_client_uploads_until_the_end_of_it_or_its_own() {
    let mut board = three();
    done(&mut board, 1, BEGIN, true);
    done(&mut board, 2, BEGIN, false);
    for key in [
        UploadBeginEndpoint::REQ_KEY,
        UploadChunkEndpoint::REQ_KEY,
        UploadCommitEndpoint::REQ_KEY,
        UploadAbortEndpoint::REQ_KEY,
        ActivateEndpoint::REQ_KEY,
    ] {
        let message = refusal(&mut board, 1, key);
        holds(&message, &["`stylus status` (process 7) uploads"]);
    }
    done(&mut board, 2, COMMIT, false);
    done(&mut board, 1, BEGIN, false);
    board.left(1);
    done(&mut board, 2, BEGIN, false);
}

/// Keys of a request that begins an activity and of its answer, and what its client then does.
const BEGINNINGS: [(Key, Key, &str); 7] = [
    (PLAY.0, PLAY.1, "plays"),
    (BEGIN.0, BEGIN.1, "uploads"),
    beginning::<ProbeLoadEndpoint>("measures the actuator"),
    beginning::<ProbeStartEndpoint>("measures the actuator"),
    beginning::<ResponseProposeEndpoint>("measures the actuator"),
    beginning::<SelfTestEndpoint>("tests the device"),
    beginning::<UpdateBeginEndpoint>("updates the device"),
];

const fn beginning<E: Endpoint>(does: &'static str) -> (Key, Key, &'static str) {
    (E::REQ_KEY, E::RESP_KEY, does)
}

#[test]
fn of_all_activities_one_goes_on_at_a_time_and_who_asks_for_another_is_told_which() {
    for (first, answer, does) in BEGINNINGS {
        for (second, ..) in BEGINNINGS {
            let mut board = three();
            done(&mut board, 1, (first, answer), true);
            done(&mut board, 1, (first, answer), false);
            let pair = [first, second];
            if pair == [PLAY.0, BEGIN.0] || pair == [BEGIN.0, PLAY.0] {
                done(&mut board, 2, (second, second), true);
                continue;
            }
            let told = refusal(&mut board, 2, second);
            let words = format!("`stylus play` (process 7) {does}, begun 0 s ago: ");
            holds(&told, &[&words]);
            // The client in the activity may continue. Once it has left, another client may begin.
            let actions = board.frame_of(1, &request(second, 6, &[]));
            assert_eq!(for_device(&actions).len(), 1);
            board.left(1);
            done(&mut board, 2, (second, second), true);
        }
    }
}

#[test]
fn a_measurement_goes_on_between_its_probes_until_a_response_is_stored() {
    let mut board = three();
    let load = (ProbeLoadEndpoint::REQ_KEY, ProbeLoadEndpoint::RESP_KEY);
    let store = (ResponseSetEndpoint::REQ_KEY, ResponseSetEndpoint::RESP_KEY);
    let stop = request(StopEndpoint::REQ_KEY, 1, &[]);
    done(&mut board, 1, load, false);
    // The measuring client stops each probe itself. It is informed of a stop by another client.
    assert!(for_client(&board.frame_of(1, &stop), 1).is_empty());
    let told = for_client(&board.frame_of(3, &stop), 1);
    assert!(matches!(&told[..], [FromBroker::Stopped { .. }]));
    refusal(&mut board, 2, PLAY.0);
    done(&mut board, 1, store, false);
    done(&mut board, 2, PLAY, false);
}

#[test]
fn a_number_that_comes_again_belongs_to_the_newest_request() {
    let mut board = three();
    let status = request(StatusEndpoint::REQ_KEY, 1, &[]);
    let first = for_device(&board.frame_of(1, &status)).remove(0);
    for _ in 0..usize::from(u16::MAX) {
        let asked = for_device(&board.frame_of(2, &status)).remove(0);
        board.frame_of_device(&answer_to(&asked, StatusEndpoint::RESP_KEY, &[]));
    }
    let again = for_device(&board.frame_of(2, &status)).remove(0);
    assert_eq!(parts(&first).1, parts(&again).1);
    let actions = board.frame_of_device(&answer_to(&again, StatusEndpoint::RESP_KEY, &[]));
    assert!(for_client(&actions, 1).is_empty());
    assert_eq!(for_client(&actions, 2).len(), 1);
}

#[test]
fn a_frame_that_no_stylus_takes_ends_its_client_and_keeps_nobody_waiting() {
    let mut board = three();
    let header = request(ListEndpoint::REQ_KEY, 1, &[]).len();
    let longest = |more| vec![0; MAX_HOST_FRAME_BYTES - header + more];
    let fits = request(ListEndpoint::REQ_KEY, 1, &longest(0));
    assert_eq!(for_device(&board.frame_of(1, &fits)).len(), 1);
    let actions = board.frame_of(1, &request(ListEndpoint::REQ_KEY, 1, &longest(1)));
    assert!(for_device(&actions).is_empty());
    let told = for_client(&actions, 1);
    assert!(matches!(&told[..], [FromBroker::Ended(_)]));
}
