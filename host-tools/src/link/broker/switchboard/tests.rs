//! Schedules of requests of several clients, against a device in the test.

use std::collections::{BTreeSet, VecDeque};

use model_format::link::{
    BLOCK_SAMPLES, InfoEndpoint, PackedSample, PlayRequest, RecordStarted, Selection,
    StatusEndpoint,
};
use proptest::prelude::*;

use super::*;

fn program(command: &str) -> Program {
    Program {
        command: command.to_owned(),
        process: Some(7),
    }
}

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
    let VarKey::Key8(key) = header.key else {
        panic!("{header:?}")
    };
    let VarSeq::Seq2(number) = header.seq_no else {
        panic!("{header:?}")
    };
    (key, number, body.to_vec())
}

/// The answer of a device to `asked`, with this body.
fn answer_to(asked: &[u8], key: Key, body: &[u8]) -> Vec<u8> {
    let (_, number, _) = parts(asked);
    request(key, number, body)
}

fn for_device(actions: &[Action]) -> Vec<(Urgency, Vec<u8>)> {
    let of = |action: &Action| match action {
        Action::ToDevice(urgency, frame) => Some((*urgency, frame.clone())),
        Action::ToClient { .. } => None,
    };
    actions.iter().filter_map(of).collect()
}

fn for_client(actions: &[Action], client: ClientId) -> Vec<FromBroker> {
    let of = |action: &Action| match action {
        Action::ToClient { to, message, .. } if *to == client => Some(message.clone()),
        _ => None,
    };
    actions.iter().filter_map(of).collect()
}

/// The refusal in `actions`, which must be the words and an error under the request's number.
fn refusal(actions: &[Action], client: ClientId, number: u16) -> String {
    assert!(for_device(actions).is_empty(), "{actions:?}");
    let said = for_client(actions, client);
    let [FromBroker::Refused { words, .. }, FromBroker::Frame(frame)] = &said[..] else {
        panic!("{said:?}")
    };
    let (key, answered, _) = parts(frame);
    assert_eq!((key, answered), (ERROR_KEY, number));
    words.clone()
}

fn three() -> Switchboard {
    let mut board = Switchboard::default();
    for (client, command) in [(1, "play"), (2, "status"), (3, "stop")] {
        board.joined(client, program(command));
    }
    board
}

fn play() -> Vec<u8> {
    encoded(&PlayRequest {
        selection: Selection::Texture("silk".try_into().unwrap()),
        gain: 1.0,
        motion: model_format::link::MotionSource::Host,
        seed: 1,
    })
}

/// Lets `client` play.
fn playing(board: &mut Switchboard, client: ClientId) {
    let asked = board.frame_of(client, &request(PlayEndpoint::REQ_KEY, 5, &play()));
    let (urgency, frame) = for_device(&asked).remove(0);
    assert_eq!(urgency, Urgency::Command);
    board.frame_of_device(&answer_to(&frame, PlayEndpoint::RESP_KEY, &[0]));
}

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
        names.iter().for_each(|&name| board.joined(name, program("status")));
        let mut next = 5;
        let mut serial = 0u32;
        let mut device: VecDeque<(ClientId, u16, u32, Vec<u8>)> = VecDeque::new();
        let mut left = BTreeSet::new();
        let rest = std::iter::repeat_n(Step::Answer(any_index()), 300);
        for step in schedule.into_iter().chain(rest) {
            match step {
                Step::Ask(place, number) => {
                    let client = names[place as usize];
                    serial += 1;
                    let key = [StatusEndpoint::REQ_KEY, InfoEndpoint::REQ_KEY][serial as usize % 2];
                    let frame = request(key, number, &serial.to_le_bytes());
                    let asked = for_device(&board.frame_of(client, &frame));
                    prop_assert_eq!(asked.len(), 1);
                    let (found, _, body) = parts(&asked[0].1);
                    prop_assert_eq!((found, body), (key, serial.to_le_bytes().to_vec()));
                    device.push_back((client, number, serial, asked[0].1.clone()));
                }
                Step::Answer(index) if !device.is_empty() => {
                    let place = index.index(device.len());
                    let (client, number, serial, frame) = device.remove(place).unwrap();
                    let answer = answer_to(&frame, StatusEndpoint::RESP_KEY, &serial.to_le_bytes());
                    let actions = board.frame_of_device(&answer);
                    if left.contains(&client) {
                        prop_assert!(actions.is_empty());
                        continue;
                    }
                    prop_assert_eq!(actions.len(), 1);
                    let said = for_client(&actions, client);
                    let expected = request(
                        StatusEndpoint::RESP_KEY, number, &serial.to_le_bytes());
                    prop_assert_eq!(said, vec![FromBroker::Frame(expected)]);
                    // It comes once.
                    prop_assert!(board.frame_of_device(&answer).is_empty());
                }
                Step::Answer(_) => {}
                Step::Leave(place) => {
                    let client = std::mem::replace(&mut names[place as usize], next);
                    left.insert(client);
                    prop_assert!(board.left(client).is_empty());
                    board.joined(next, program("status"));
                    next += 1;
                }
            }
        }
        prop_assert!(device.is_empty());
        prop_assert!(board.asked.is_empty());
    }

    /// Each of several clients sees a recording as its own, whenever others begin and end theirs.
    #[test]
    fn a_recording_of_several_clients_is_each_ones_own(
        steps in prop::collection::vec((0..4u64, 0..3u8), 1..200)
    ) {
        let mut board = Switchboard::default();
        (0..3).for_each(|client| board.joined(client, program("monitor")));
        let mut device = Device::default();
        // Blocks that each client has seen of its recording.
        let mut seen: [Option<u32>; 3] = [None; 3];
        for (client, what) in steps {
            let actions = match (client, what) {
                (3, _) => device.block().map_or_else(Vec::new, |block| board.frame_of_device(&block)),
                (client, 0) => {
                    board.frame_of(client, &request(RecordStartEndpoint::REQ_KEY, 9, &[]))
                }
                (client, 1) if seen[client as usize].is_some() => {
                    board.frame_of(client, &request(RecordStopEndpoint::REQ_KEY, 8, &[]))
                }
                (client, 2) => {
                    seen[client as usize] = None;
                    let actions = board.left(client);
                    board.joined(client, program("monitor"));
                    actions
                }
                _ => Vec::new(),
            };
            let mut queue = VecDeque::from(actions);
            while let Some(action) = queue.pop_front() {
                let (to, bytes) = match action {
                    Action::ToDevice(_, frame) => {
                        queue.extend(board.frame_of_device(&device.answer(&frame)));
                        continue;
                    }
                    Action::ToClient { to, message: FromBroker::Frame(bytes), .. } => (to, bytes),
                    Action::ToClient { .. } => continue,
                };
                let (header, body) = VarHeader::take_from_slice(&bytes).unwrap();
                let mine = &mut seen[to as usize];
                if header.key == VarKey::Key8(RecordStartEndpoint::RESP_KEY) {
                    let answer: Result<RecordStarted, RecordError> =
                        postcard::from_bytes(body).unwrap();
                    prop_assert_eq!(answer.is_err(), mine.is_some());
                    mine.get_or_insert(0);
                } else if header.key == VarKey::Key8(RecordStopEndpoint::RESP_KEY) {
                    let answer: Result<RecordStopped, RecordError> =
                        postcard::from_bytes(body).unwrap();
                    prop_assert_eq!(answer.unwrap().blocks, mine.take().unwrap());
                } else if let Some(count) = mine {
                    let block: RecordBlock = postcard::from_bytes(body).unwrap();
                    prop_assert_eq!(block.sequence, *count);
                    *count += 1;
                }
            }
            // The device records exactly while somebody wants it.
            prop_assert_eq!(device.recording.is_some(), seen.iter().any(Option::is_some));
        }
    }
}

fn any_index() -> prop::sample::Index {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    any::<prop::sample::Index>()
        .new_tree(&mut runner)
        .unwrap()
        .current()
}

/// A recorder, with the number of its next block.
#[derive(Default)]
struct Device {
    recording: Option<u32>,
}

impl Device {
    fn answer(&mut self, frame: &[u8]) -> Vec<u8> {
        match parts(frame).0 {
            RecordStartEndpoint::REQ_KEY => {
                let answer = if self.recording.is_none() {
                    self.recording = Some(0);
                    Ok(RecordStarted {
                        sample_rate_hz: 5000,
                        block_samples: BLOCK_SAMPLES as u32,
                    })
                } else {
                    Err(RecordError::Recording)
                };
                answer_to(frame, RecordStartEndpoint::RESP_KEY, &encoded(&answer))
            }
            RecordStopEndpoint::REQ_KEY => {
                let answer = match self.recording.take() {
                    Some(blocks) => Ok(RecordStopped {
                        blocks,
                        lost_blocks: 0,
                    }),
                    None => Err(RecordError::NotRecording),
                };
                answer_to(frame, RecordStopEndpoint::RESP_KEY, &encoded(&answer))
            }
            key => panic!("{key:?}"),
        }
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
fn motions_and_keep_alives_of_who_does_not_play_do_not_reach_the_device() {
    let mut board = three();
    let motion = request(MotionTopic::TOPIC_KEY, 0, &[1, 2, 3]);
    let keep_alive = request(KeepAliveTopic::TOPIC_KEY, 0, &[]);
    // Nobody plays.
    let passed = board.frame_of(2, &motion);
    assert_eq!(for_device(&passed), [(Urgency::Motion, motion.clone())]);
    playing(&mut board, 1);
    for frame in [&motion, &keep_alive] {
        assert!(board.frame_of(2, frame).is_empty());
        let passed = board.frame_of(1, frame);
        assert_eq!(for_device(&passed), [(Urgency::Motion, frame.clone())]);
    }
    let refused = board.frame_of(2, &request(MotionEndpoint::REQ_KEY, 4, &[]));
    refusal(&refused, 2, 4);
}

#[test]
fn what_would_disturb_a_play_is_refused_with_who_plays_and_the_rest_goes_on() {
    let mut board = three();
    playing(&mut board, 1);
    for key in [
        PlayEndpoint::REQ_KEY,
        ActivateEndpoint::REQ_KEY,
        SelfTestEndpoint::REQ_KEY,
        SettingsProposeEndpoint::REQ_KEY,
        SettingsApplyEndpoint::REQ_KEY,
    ] {
        let words = refusal(&board.frame_of(2, &request(key, 6, &[])), 2, 6);
        assert_eq!(
            words,
            "`stylus play` (process 7) plays, since 0 s ago: stop it with `stylus stop`, or wait for its end"
        );
    }
    for key in [
        StatusEndpoint::REQ_KEY,
        InfoEndpoint::REQ_KEY,
        UploadBeginEndpoint::REQ_KEY,
        UploadChunkEndpoint::REQ_KEY,
        RecordStartEndpoint::REQ_KEY,
    ] {
        assert_eq!(
            for_device(&board.frame_of(2, &request(key, 6, &[]))).len(),
            1
        );
    }
}

#[test]
fn a_stop_of_any_client_goes_first_and_tells_who_played() {
    let mut board = three();
    playing(&mut board, 1);
    let stopped = board.frame_of(3, &request(StopEndpoint::REQ_KEY, 1, &[]));
    assert_eq!(for_device(&stopped)[0].0, Urgency::Command);
    let by = "`stylus stop` (process 7)".to_owned();
    assert_eq!(for_client(&stopped, 1), [FromBroker::Stopped { by }]);
    // Another may play now, and the first one's late motions do not reach it.
    playing(&mut board, 2);
    assert!(
        board
            .frame_of(1, &request(KeepAliveTopic::TOPIC_KEY, 0, &[]))
            .is_empty()
    );
    // A player that stops itself is told nothing.
    let stopped = board.frame_of(2, &request(StopEndpoint::REQ_KEY, 1, &[]));
    assert!(for_client(&stopped, 2).is_empty() && for_client(&stopped, 1).is_empty());
}

#[test]
fn the_motion_is_free_after_a_refused_play_and_after_its_holder_is_gone() {
    let mut board = three();
    let asked = board.frame_of(1, &request(PlayEndpoint::REQ_KEY, 5, &play()));
    let frame = for_device(&asked).remove(0).1;
    board.frame_of_device(&answer_to(&frame, PlayEndpoint::RESP_KEY, &[1, 0]));
    playing(&mut board, 2);
    // A refused change of what is played leaves the first play with its holder.
    let asked = board.frame_of(2, &request(PlayEndpoint::REQ_KEY, 5, &play()));
    let frame = for_device(&asked).remove(0).1;
    board.frame_of_device(&answer_to(&frame, ERROR_KEY, &[4]));
    refusal(
        &board.frame_of(1, &request(PlayEndpoint::REQ_KEY, 6, &play())),
        1,
        6,
    );
    // One that is killed sends no stop; the device mutes by itself.
    assert!(board.left(2).is_empty());
    playing(&mut board, 1);
}

#[test]
fn one_client_uploads_until_the_end_of_it_or_its_own() {
    let mut board = three();
    let begin = request(UploadBeginEndpoint::REQ_KEY, 1, &[]);
    let begun = |board: &mut Switchboard, client, result: u8| {
        let frame = for_device(&board.frame_of(client, &begin)).remove(0).1;
        board.frame_of_device(&answer_to(&frame, UploadBeginEndpoint::RESP_KEY, &[result]));
    };
    begun(&mut board, 1, 1);
    begun(&mut board, 2, 0);
    for key in [
        UploadBeginEndpoint::REQ_KEY,
        UploadChunkEndpoint::REQ_KEY,
        UploadCommitEndpoint::REQ_KEY,
        UploadAbortEndpoint::REQ_KEY,
        ActivateEndpoint::REQ_KEY,
    ] {
        let words = refusal(&board.frame_of(1, &request(key, 6, &[])), 1, 6);
        assert!(
            words.contains("`stylus status` (process 7) uploads"),
            "{words}"
        );
    }
    let commit = board.frame_of(2, &request(UploadCommitEndpoint::REQ_KEY, 2, &[]));
    let frame = for_device(&commit).remove(0).1;
    board.frame_of_device(&answer_to(&frame, UploadCommitEndpoint::RESP_KEY, &[0]));
    begun(&mut board, 1, 0);
    board.left(1);
    begun(&mut board, 2, 0);
}

#[test]
fn a_number_that_comes_again_belongs_to_the_newest_request() {
    let mut board = three();
    let status = request(StatusEndpoint::REQ_KEY, 1, &[]);
    let first = for_device(&board.frame_of(1, &status)).remove(0).1;
    for _ in 0..usize::from(u16::MAX) {
        let asked = for_device(&board.frame_of(2, &status)).remove(0).1;
        board.frame_of_device(&answer_to(&asked, StatusEndpoint::RESP_KEY, &[]));
    }
    let again = for_device(&board.frame_of(2, &status)).remove(0).1;
    assert_eq!(parts(&first).1, parts(&again).1);
    let actions = board.frame_of_device(&answer_to(&again, StatusEndpoint::RESP_KEY, &[]));
    assert!(for_client(&actions, 1).is_empty());
    assert_eq!(for_client(&actions, 2).len(), 1);
}

#[test]
fn what_is_no_frame_changes_nothing() {
    let mut board = three();
    playing(&mut board, 1);
    for frame in [&[][..], &[0xff], &[0xc0, 1, 2]] {
        assert!(board.frame_of(2, frame).is_empty());
        assert!(board.frame_of_device(frame).is_empty());
    }
    refusal(
        &board.frame_of(2, &request(PlayEndpoint::REQ_KEY, 6, &play())),
        2,
        6,
    );
}
