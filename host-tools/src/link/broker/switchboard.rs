//! The rules of a broker, without input and output: each event gives the frames and messages that follow from it.

use std::collections::{BTreeMap, HashMap};
use std::time::{Duration, Instant};

use model_format::link::{
    ActivateEndpoint, KeepAliveTopic, MotionEndpoint, MotionTopic, PlayEndpoint, RecordBlock,
    RecordBlockTopic, RecordError, RecordStartEndpoint, RecordStopEndpoint, RecordStopped,
    SelfTestEndpoint, SettingsApplyEndpoint, SettingsProposeEndpoint, StopEndpoint,
    UploadAbortEndpoint, UploadBeginEndpoint, UploadChunkEndpoint, UploadCommitEndpoint,
};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::{ERROR_KEY, WireError};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;

use super::message::{ClientId, FromBroker, Program};

use super::recording::{Recording, Start, Stop};

/// Urgency of a frame for the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Urgency {
    /// A play or a stop. They are in one queue, so that a stop never overtakes the play that it is to end.
    Command,
    /// A motion or a keep-alive, which is worth less the later it comes.
    Motion,
    /// All others.
    Other,
}

/// Consequence of an event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// A frame for the device.
    ToDevice(Urgency, Vec<u8>),
    /// A message for a client. One that `may_be_lost` is left out where the client reads too slowly.
    ToClient {
        /// The client.
        to: ClientId,
        /// The message.
        message: FromBroker,
        /// True for blocks of a recording, whose numbers show what is missing.
        may_be_lost: bool,
    },
}

/// A client that has something alone.
#[derive(Clone, Copy, Debug)]
struct Holder {
    client: ClientId,
    since: Instant,
}

/// A request that the device has not answered.
#[derive(Debug)]
struct Asked {
    /// The client; none if it has left, or if the request is the broker's own.
    client: Option<ClientId>,
    header: VarHeader,
    request: Request,
}

/// Requests whose answers change what the broker knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    /// A play; true if its client holds the motion because of it.
    Play(bool),
    /// The begin of an upload; true if its client holds the upload because of it.
    UploadBegin(bool),
    UploadEnd,
    RecordStart,
    RecordStop,
    Other,
}

/// All that a broker knows of its clients and of the device.
#[derive(Debug, Default)]
pub(super) struct Switchboard {
    clients: BTreeMap<ClientId, Program>,
    asked: HashMap<u16, Asked>,
    last_number: u16,
    motion: Option<Holder>,
    upload: Option<Holder>,
    recording: Recording,
    /// Starts of recordings that wait for the answer to another client's.
    waiting: Vec<(ClientId, VarHeader)>,
}

impl Switchboard {
    /// A client has come.
    pub(super) fn joined(&mut self, client: ClientId, program: Program) {
        self.clients.insert(client, program);
    }

    /// The programs, in words.
    pub(super) fn programs(&self) -> String {
        let words: Vec<String> = self.clients.values().map(Program::to_string).collect();
        words.join(", ")
    }

    /// A client has left, in the middle of whatever it did.
    ///
    /// Its play goes as one whose host is gone: nobody sends the keep-alives that the device waits for.
    pub(super) fn left(&mut self, client: ClientId) -> Vec<Action> {
        self.clients.remove(&client);
        self.waiting.retain(|(waiting, _)| *waiting != client);
        for asked in self.asked.values_mut() {
            if asked.client == Some(client) {
                asked.client = None;
            }
        }
        release(&mut self.motion, Some(client));
        release(&mut self.upload, Some(client));
        let mut actions = Vec::new();
        if self.recording.left(client) {
            actions.push(self.stop_recording());
        }
        actions
    }

    /// A frame of a client.
    pub(super) fn frame_of(&mut self, client: ClientId, frame: &[u8]) -> Vec<Action> {
        let Some((header, body)) = VarHeader::take_from_slice(frame) else {
            return Vec::new();
        };
        let VarKey::Key8(key) = header.key else {
            return vec![self.ask(client, header, Request::Other, Urgency::Other, body)];
        };
        if let Some((holder, does)) = self.in_the_way(client, key) {
            return self.refuse(client, header, key, holder, does);
        }
        match key {
            // Topics are not answered, and keep their number.
            MotionTopic::TOPIC_KEY | KeepAliveTopic::TOPIC_KEY => {
                vec![Action::ToDevice(Urgency::Motion, frame.to_vec())]
            }
            MotionEndpoint::REQ_KEY => {
                vec![self.ask(client, header, Request::Other, Urgency::Motion, body)]
            }
            PlayEndpoint::REQ_KEY => {
                let is_new = hold(&mut self.motion, client);
                vec![self.ask(
                    client,
                    header,
                    Request::Play(is_new),
                    Urgency::Command,
                    body,
                )]
            }
            StopEndpoint::REQ_KEY => self.stop(client, header, body),
            UploadBeginEndpoint::REQ_KEY => {
                let is_new = hold(&mut self.upload, client);
                let request = Request::UploadBegin(is_new);
                vec![self.ask(client, header, request, Urgency::Other, body)]
            }
            UploadCommitEndpoint::REQ_KEY | UploadAbortEndpoint::REQ_KEY => {
                vec![self.ask(client, header, Request::UploadEnd, Urgency::Other, body)]
            }
            RecordStartEndpoint::REQ_KEY => self.start_recording(client, header, body),
            RecordStopEndpoint::REQ_KEY => self.end_recording(client, header, body),
            _ => vec![self.ask(client, header, Request::Other, Urgency::Other, body)],
        }
    }

    /// A frame of the device.
    pub(super) fn frame_of_device(&mut self, frame: &[u8]) -> Vec<Action> {
        let Some((header, body)) = VarHeader::take_from_slice(frame) else {
            return Vec::new();
        };
        if header.key == VarKey::Key8(RecordBlockTopic::TOPIC_KEY) {
            return self.block(header, body);
        }
        let number = match header.seq_no {
            VarSeq::Seq1(number) => number.into(),
            VarSeq::Seq2(number) => number,
            VarSeq::Seq4(number) => number as u16,
        };
        // The answer to a request that a later one of its number has replaced goes to nobody.
        let Some(asked) = self.asked.remove(&number) else {
            return Vec::new();
        };
        self.answer(&asked, header, body)
    }

    /// The holder that keeps `client` from the request or topic of this key, with what it does.
    fn in_the_way(&self, client: ClientId, key: Key) -> Option<(Holder, &'static str)> {
        let of = |holder: Option<Holder>| holder.filter(|holder| holder.client != client);
        let playing = || of(self.motion).map(|holder| (holder, "plays"));
        let uploading = || of(self.upload).map(|holder| (holder, "uploads"));
        match key {
            MotionTopic::TOPIC_KEY
            | KeepAliveTopic::TOPIC_KEY
            | MotionEndpoint::REQ_KEY
            | PlayEndpoint::REQ_KEY
            | SettingsProposeEndpoint::REQ_KEY
            | SettingsApplyEndpoint::REQ_KEY => playing(),
            UploadBeginEndpoint::REQ_KEY
            | UploadChunkEndpoint::REQ_KEY
            | UploadCommitEndpoint::REQ_KEY
            | UploadAbortEndpoint::REQ_KEY => uploading(),
            ActivateEndpoint::REQ_KEY | SelfTestEndpoint::REQ_KEY => playing().or_else(uploading),
            _ => None,
        }
    }

    fn refuse(
        &self,
        client: ClientId,
        header: VarHeader,
        key: Key,
        holder: Holder,
        does: &str,
    ) -> Vec<Action> {
        if [MotionTopic::TOPIC_KEY, KeepAliveTopic::TOPIC_KEY].contains(&key) {
            return Vec::new();
        }
        let program = self.clients.get(&holder.client);
        let program = program.map_or_else(|| "another program".to_owned(), Program::to_string);
        let remedy = match does {
            "plays" => "stop it with `stylus stop`, or wait for its end",
            _ => "wait for its end, or end it with Ctrl-C",
        };
        let words = format!(
            "{program} {does}, since {}: {remedy}",
            ago(holder.since.elapsed())
        );
        let refusal = FromBroker::Refused {
            key: key.to_bytes(),
            words,
        };
        vec![
            to(client, refusal),
            to(client, error_frame(header, &WireError::SerFailed)),
        ]
    }

    /// Asks the device, under a number of the broker's own.
    fn ask(
        &mut self,
        client: ClientId,
        header: VarHeader,
        request: Request,
        urgency: Urgency,
        body: &[u8],
    ) -> Action {
        self.ask_as(Some(client), header, request, urgency, body)
    }

    fn ask_as(
        &mut self,
        client: Option<ClientId>,
        header: VarHeader,
        request: Request,
        urgency: Urgency,
        body: &[u8],
    ) -> Action {
        // A number that comes again is that of the oldest request, whose answer was lost.
        self.last_number = self.last_number.wrapping_add(1);
        let asked = Asked {
            client,
            header,
            request,
        };
        self.asked.insert(self.last_number, asked);
        let header = VarHeader {
            key: header.key,
            seq_no: VarSeq::Seq2(self.last_number),
        };
        Action::ToDevice(urgency, frame(header, body))
    }

    /// A stop, which any client may send. It ends what the holder of the motion plays, and tells it so.
    fn stop(&mut self, client: ClientId, header: VarHeader, body: &[u8]) -> Vec<Action> {
        let mut actions = vec![self.ask(client, header, Request::Other, Urgency::Command, body)];
        if let Some(holder) = self.motion.take()
            && holder.client != client
        {
            actions.push(to(holder.client, self.stopped_by(client)));
        }
        actions
    }

    fn stopped_by(&self, client: ClientId) -> FromBroker {
        let by = self.clients.get(&client);
        FromBroker::Stopped {
            by: by.map_or_else(|| "another program".to_owned(), Program::to_string),
        }
    }

    fn start_recording(&mut self, client: ClientId, header: VarHeader, body: &[u8]) -> Vec<Action> {
        match self.recording.start(client) {
            Start::Ask => {
                vec![self.ask(client, header, Request::RecordStart, Urgency::Other, body)]
            }
            Start::Wait => {
                self.waiting.push((client, header));
                Vec::new()
            }
            Start::Joined(answer) => vec![to(
                client,
                answer_frame(RecordStartEndpoint::RESP_KEY, header, &answer),
            )],
            Start::Refused => {
                let refusal: <RecordStartEndpoint as Endpoint>::Response =
                    Err(RecordError::Recording);
                vec![to(
                    client,
                    answer_frame(RecordStartEndpoint::RESP_KEY, header, &encoded(&refusal)),
                )]
            }
        }
    }

    fn end_recording(&mut self, client: ClientId, header: VarHeader, body: &[u8]) -> Vec<Action> {
        match self.recording.stop(client) {
            Stop::Ask(others) => {
                let mut actions = vec![
                    to(client, FromBroker::OthersRecord(false)),
                    self.ask(client, header, Request::RecordStop, Urgency::Other, body),
                ];
                let told = others.into_iter();
                actions.extend(told.map(|other| to(other, self.stopped_by(client))));
                actions
            }
            Stop::Left(stopped) => {
                let answer: <RecordStopEndpoint as Endpoint>::Response = Ok(stopped);
                vec![
                    to(client, FromBroker::OthersRecord(true)),
                    to(
                        client,
                        answer_frame(RecordStopEndpoint::RESP_KEY, header, &encoded(&answer)),
                    ),
                ]
            }
        }
    }

    /// Stops a recording that no client wants any more.
    fn stop_recording(&mut self) -> Action {
        let header = VarHeader {
            key: VarKey::Key8(RecordStopEndpoint::REQ_KEY),
            seq_no: VarSeq::Seq2(0),
        };
        self.ask_as(None, header, Request::Other, Urgency::Other, &[])
    }

    /// A block of the recording, for each client as it sees it.
    fn block(&mut self, header: VarHeader, body: &[u8]) -> Vec<Action> {
        let Ok(block) = postcard::from_bytes::<RecordBlock>(body) else {
            return Vec::new();
        };
        let blocks = self.recording.block(&block).into_iter();
        blocks
            .map(|(client, block)| Action::ToClient {
                to: client,
                message: FromBroker::Frame(frame(header, &encoded(&block))),
                may_be_lost: true,
            })
            .collect()
    }

    /// An answer of the device, for the client that has asked.
    fn answer(&mut self, asked: &Asked, header: VarHeader, body: &[u8]) -> Vec<Action> {
        let is_error = header.key == VarKey::Key8(ERROR_KEY);
        // The first byte of a result in postcard is 0 if it is none of the device's refusals.
        let is_done = !is_error && body.first() == Some(&0);
        let mut body = body.to_vec();
        let mut actions = Vec::new();
        match asked.request {
            Request::Play(true) if !is_done => release(&mut self.motion, asked.client),
            Request::UploadBegin(true) if !is_done => release(&mut self.upload, asked.client),
            Request::UploadEnd if !is_error => release(&mut self.upload, asked.client),
            Request::RecordStart => {
                let waiting = std::mem::take(&mut self.waiting);
                let clients: Vec<ClientId> = waiting.iter().map(|(client, _)| *client).collect();
                let answer = is_done.then_some(&body[..]);
                if self.recording.started(asked.client, &clients, answer) {
                    actions.push(self.stop_recording());
                }
                for (client, theirs) in waiting {
                    actions.push(to(client, renumbered(header, theirs, &body)));
                }
            }
            Request::RecordStop if is_done => {
                let stopped = postcard::from_bytes::<Result<RecordStopped, RecordError>>(&body);
                if let (Ok(Ok(whole)), Some(client)) = (stopped, asked.client) {
                    let part = self.recording.stopped(client, whole);
                    body = encoded(&Ok::<_, RecordError>(part));
                }
            }
            _ => {}
        }
        if let Some(client) = asked.client {
            actions.push(to(client, renumbered(header, asked.header, &body)));
        }
        actions
    }
}

/// Makes `client` the holder if there is none; returns true if it was not before.
fn hold(held: &mut Option<Holder>, client: ClientId) -> bool {
    let is_new = held.is_none();
    held.get_or_insert(Holder {
        client,
        since: Instant::now(),
    });
    is_new
}

fn release(held: &mut Option<Holder>, client: Option<ClientId>) {
    if held.is_some_and(|holder| Some(holder.client) == client) {
        *held = None;
    }
}

/// A time that has passed, in words.
fn ago(time: Duration) -> String {
    match time.as_secs() {
        0..120 => format!("{:.0} s ago", time.as_secs_f64()),
        120..7200 => format!("{} min ago", time.as_secs() / 60),
        seconds => format!("{} h ago", seconds / 3600),
    }
}

fn to(client: ClientId, message: FromBroker) -> Action {
    Action::ToClient {
        to: client,
        message,
        may_be_lost: false,
    }
}

fn frame(header: VarHeader, body: &[u8]) -> Vec<u8> {
    let mut bytes = header.write_to_vec();
    bytes.extend(body);
    bytes
}

/// The answer `body` under the number that the client has given its request.
fn renumbered(answer: VarHeader, asked: VarHeader, body: &[u8]) -> FromBroker {
    let header = VarHeader {
        key: answer.key,
        seq_no: asked.seq_no,
    };
    FromBroker::Frame(frame(header, body))
}

fn answer_frame(key: Key, asked: VarHeader, body: &[u8]) -> FromBroker {
    let header = VarHeader {
        key: VarKey::Key8(key),
        seq_no: asked.seq_no,
    };
    FromBroker::Frame(frame(header, body))
}

fn error_frame(asked: VarHeader, error: &WireError) -> FromBroker {
    answer_frame(ERROR_KEY, asked, &encoded(error))
}

fn encoded(value: &impl Serialize) -> Vec<u8> {
    postcard::to_allocvec(value).expect("plain data")
}

#[cfg(test)]
mod tests;
