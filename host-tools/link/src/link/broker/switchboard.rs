//! The rules of a broker, without input and output. The function for each event returns the frames and messages that
//! follow from the event.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::{Duration, Instant};

use model_format::link::{
    ActivateEndpoint, KeepAliveTopic, MAX_HOST_FRAME_BYTES, MotionEndpoint, MotionTopic,
    PlayEndpoint, ProbeLoadEndpoint, ProbeStartEndpoint, RecordBlock, RecordBlockTopic,
    RecordStartEndpoint, RecordStopEndpoint, RecordStopped, ResponseProposeEndpoint,
    ResponseSetEndpoint, SelfTestEndpoint, SettingsApplyEndpoint, SettingsProposeEndpoint,
    StopEndpoint, UpdateBeginEndpoint, UpdateCommitEndpoint, UpdateConfirmEndpoint,
    UploadAbortEndpoint, UploadBeginEndpoint, UploadChunkEndpoint, UploadCommitEndpoint,
};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::{ERROR_KEY, WireError};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;

use super::message::{ClientId, FromBroker, Program};

/// Consequence of an event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// A frame for the device.
    ToDevice(Vec<u8>),
    /// A message for a client.
    ToClient(ClientId, FromBroker),
    /// A block of a recording, for every client that does not read too slowly. The block's number shows a client which
    /// blocks it has missed.
    Block(Vec<u8>),
}

/// An activity of a client that activities of other clients would disturb.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Activity {
    /// Lasts until the stop.
    Play,
    /// Lasts until the commit or the abort.
    Upload,
    /// Measurement of the actuator. Lasts until a response is stored or removed, or its client leaves, because nothing
    /// may heat the coil in the pause between two probes.
    Measurement,
    /// Lasts until its client leaves.
    SelfTest,
    /// Lasts until its client leaves.
    Update,
    /// A change of settings. No client stays in it. Its requests are only refused while another client is in an
    /// activity that they would disturb.
    Settings,
    /// Like [`Self::Settings`].
    Activation,
}

impl Activity {
    /// Returns the activity to which a request or message with this key belongs.
    fn of(key: Key) -> Option<Self> {
        Some(match key {
            MotionTopic::TOPIC_KEY
            | KeepAliveTopic::TOPIC_KEY
            | MotionEndpoint::REQ_KEY
            | PlayEndpoint::REQ_KEY => Self::Play,
            UploadBeginEndpoint::REQ_KEY
            | UploadChunkEndpoint::REQ_KEY
            | UploadCommitEndpoint::REQ_KEY
            | UploadAbortEndpoint::REQ_KEY => Self::Upload,
            ProbeLoadEndpoint::REQ_KEY
            | ProbeStartEndpoint::REQ_KEY
            | ResponseProposeEndpoint::REQ_KEY
            | ResponseSetEndpoint::REQ_KEY => Self::Measurement,
            SelfTestEndpoint::REQ_KEY => Self::SelfTest,
            UpdateBeginEndpoint::REQ_KEY
            | UpdateCommitEndpoint::REQ_KEY
            | UpdateConfirmEndpoint::REQ_KEY => Self::Update,
            SettingsProposeEndpoint::REQ_KEY | SettingsApplyEndpoint::REQ_KEY => Self::Settings,
            ActivateEndpoint::REQ_KEY => Self::Activation,
            _ => return None,
        })
    }

    /// Returns true if `self` of one client and `other` of another client exclude each other.
    fn disturbs(self, other: Self) -> bool {
        // An upload writes only the slot that is not played. The settings have sectors of their own.
        let beside_upload = |one| matches!(one, Self::Play | Self::Settings);
        !(self == Self::Upload && beside_upload(other)
            || other == Self::Upload && beside_upload(self))
    }

    /// Returns the verb that says what a client in this activity does.
    fn verb(self) -> &'static str {
        match self {
            Self::Play => "plays",
            Self::Upload => "uploads",
            Self::Measurement => "measures the actuator",
            Self::SelfTest => "tests the device",
            Self::Update => "updates the device",
            Self::Settings | Self::Activation => "changes the device",
        }
    }

    fn remedy(self) -> &'static str {
        match self {
            Self::Play => "stop it with `stylus stop`, or wait for its end",
            _ => "wait for its end, or end it with Ctrl-C",
        }
    }
}

/// A client in an activity.
#[derive(Clone, Copy, Debug)]
struct Holder {
    client: ClientId,
    activity: Activity,
    since: Instant,
}

/// A request that the device has not answered.
#[derive(Debug)]
struct Asked {
    /// The client that asked. None if it has left, or if the broker itself asked.
    client: Option<ClientId>,
    header: VarHeader,
    request: Request,
}

/// Kind of a request: what its answer changes in the broker's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    /// The begin of an activity. True if its client was not in it before.
    Begin(Activity, bool),
    /// The end of an activity.
    End(Activity),
    RecordStart,
    Other,
}

/// A recording of the device, for several clients: it begins with the first and ends with the last.
#[derive(Debug)]
struct Recording {
    clients: BTreeSet<ClientId>,
    /// Body of the device's answer to the start.
    answer: Vec<u8>,
    /// The answer that the device would give to a stop at this moment, according to the last block.
    so_far: RecordStopped,
}

/// All that a broker knows of its clients and of the device.
#[derive(Debug, Default)]
pub(super) struct Switchboard {
    clients: BTreeMap<ClientId, Program>,
    asked: HashMap<u16, Asked>,
    last_number: u16,
    held: Vec<Holder>,
    recording: Option<Recording>,
}

impl Switchboard {
    /// Adds a client that has connected.
    pub(super) fn joined(&mut self, client: ClientId, program: Program) {
        self.clients.insert(client, program);
    }

    /// The programs, in words.
    pub(super) fn programs(&self) -> String {
        let words: Vec<String> = self.clients.values().map(Program::to_string).collect();
        words.join(", ")
    }

    /// Removes a client that has left, whatever it was doing.
    ///
    /// The client's play then ends by itself, because nobody sends the keep-alives that the device waits for.
    pub(super) fn left(&mut self, client: ClientId) -> Vec<Action> {
        self.clients.remove(&client);
        for asked in self.asked.values_mut() {
            if asked.client == Some(client) {
                asked.client = None;
            }
        }
        self.held.retain(|holder| holder.client != client);
        if let Some(recording) = &mut self.recording {
            recording.clients.remove(&client);
        }
        self.end_unwanted_recording()
    }

    /// Handles a frame that a client has sent.
    pub(super) fn frame_of(&mut self, client: ClientId, frame: &[u8]) -> Vec<Action> {
        // The device would refuse a longer frame, but only after the other clients had waited for its transmission.
        if frame.len() > MAX_HOST_FRAME_BYTES {
            let bytes = frame.len();
            let reason =
                format!("a frame of {bytes} bytes, more than the {MAX_HOST_FRAME_BYTES} allowed");
            return vec![Action::ToClient(client, FromBroker::Ended(reason))];
        }
        let Some((header, body)) = VarHeader::take_from_slice(frame) else {
            return Vec::new();
        };
        let VarKey::Key8(key) = header.key else {
            // The device refuses a shortened key, and its error goes back to the client.
            return vec![self.ask(Some(client), header, Request::Other, body)];
        };
        let activity = Activity::of(key);
        if let Some(holder) = activity.and_then(|activity| self.in_the_way(client, activity)) {
            return self.refuse(client, header, key, holder);
        }
        let request = match key {
            // Topics are not answered, so they keep the client's number.
            MotionTopic::TOPIC_KEY | KeepAliveTopic::TOPIC_KEY => {
                return vec![Action::ToDevice(frame.to_vec())];
            }
            UploadCommitEndpoint::REQ_KEY | UploadAbortEndpoint::REQ_KEY => {
                Request::End(Activity::Upload)
            }
            ResponseSetEndpoint::REQ_KEY => Request::End(Activity::Measurement),
            // While a recording is under way, the device refuses to start another one. The broker then replaces this
            // refusal.
            RecordStartEndpoint::REQ_KEY => Request::RecordStart,
            StopEndpoint::REQ_KEY => {
                let moves = [Activity::Play, Activity::Measurement];
                let moving = self
                    .held
                    .iter()
                    .filter(|held| moves.contains(&held.activity));
                let clients: Vec<ClientId> = moving.map(|holder| holder.client).collect();
                // A measurement stops each probe itself and holds on, because nothing may heat the coil between two
                // probes.
                self.held.retain(|holder| holder.activity != Activity::Play);
                return self.stop(client, header, body, clients);
            }
            RecordStopEndpoint::REQ_KEY => return self.stop_recording(client, header, body),
            PlayEndpoint::REQ_KEY
            | UploadBeginEndpoint::REQ_KEY
            | ProbeLoadEndpoint::REQ_KEY
            | ProbeStartEndpoint::REQ_KEY
            | ResponseProposeEndpoint::REQ_KEY
            | SelfTestEndpoint::REQ_KEY
            | UpdateBeginEndpoint::REQ_KEY => self.begin(client, activity),
            _ => Request::Other,
        };
        vec![self.ask(Some(client), header, request, body)]
    }

    /// Handles a frame that the device has sent.
    pub(super) fn frame_of_device(&mut self, frame: &[u8]) -> Vec<Action> {
        let Some((header, body)) = VarHeader::take_from_slice(frame) else {
            return Vec::new();
        };
        if header.key == VarKey::Key8(RecordBlockTopic::TOPIC_KEY) {
            if let Some(recording) = &mut self.recording
                && let Ok(block) = postcard::from_bytes::<RecordBlock>(body)
            {
                recording.so_far = RecordStopped {
                    blocks: block.sequence.wrapping_add(1),
                    lost_blocks: block.lost_blocks,
                };
            }
            return vec![Action::Block(frame.to_vec())];
        }
        let number = match header.seq_no {
            VarSeq::Seq1(number) => number.into(),
            VarSeq::Seq2(number) => number,
            // Only blocks have numbers of four bytes, and they were passed on above.
            VarSeq::Seq4(number) => number as u16,
        };
        // A frame that answers no waiting request goes to nobody.
        let Some(asked) = self.asked.remove(&number) else {
            return Vec::new();
        };
        self.answer(&asked, header, body)
    }

    /// Returns the other client whose activity keeps `client` from `activity`, if there is one.
    fn in_the_way(&self, client: ClientId, activity: Activity) -> Option<Holder> {
        let mut others = self.held.iter().filter(|holder| holder.client != client);
        let holder = others.find(|holder| activity.disturbs(holder.activity))?;
        Some(*holder)
    }

    /// Notes that `client` begins an activity, and returns the kind of its request.
    fn begin(&mut self, client: ClientId, activity: Option<Activity>) -> Request {
        let Some(activity) = activity else {
            return Request::Other;
        };
        let mut held = self.held.iter();
        let is_new = !held.any(|held| (held.client, held.activity) == (client, activity));
        if is_new {
            self.held.push(Holder {
                client,
                activity,
                since: Instant::now(),
            });
        }
        Request::Begin(activity, is_new)
    }

    fn end(&mut self, client: Option<ClientId>, activity: Activity) {
        let held = |held: &Holder| (Some(held.client), held.activity) == (client, activity);
        self.held.retain(|holder| !held(holder));
    }

    fn refuse(&self, client: ClientId, header: VarHeader, key: Key, holder: Holder) -> Vec<Action> {
        // A topic has no answer, so a refusal would have no reader.
        if [MotionTopic::TOPIC_KEY, KeepAliveTopic::TOPIC_KEY].contains(&key) {
            return Vec::new();
        }
        let words = format!(
            "{} {}, begun {}: {}",
            self.named(holder.client),
            holder.activity.verb(),
            ago(holder.since.elapsed()),
            holder.activity.remedy()
        );
        let refusal = FromBroker::Refused {
            key: key.to_bytes(),
            words,
        };
        let error = encoded(&WireError::SerFailed);
        vec![
            Action::ToClient(client, refusal),
            Action::ToClient(
                client,
                answer_frame(VarKey::Key8(ERROR_KEY), header, &error),
            ),
        ]
    }

    fn named(&self, client: ClientId) -> String {
        let program = self.clients.get(&client);
        program.map_or_else(|| "another program".to_owned(), Program::to_string)
    }

    /// Sends a request to the device under the broker's own number.
    fn ask(
        &mut self,
        client: Option<ClientId>,
        header: VarHeader,
        request: Request,
        body: &[u8],
    ) -> Action {
        // When the numbers wrap around, a reused number belonged to the oldest request, whose answer was lost.
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
        Action::ToDevice(frame(header, body))
    }

    /// Passes on a stop, which any client may send. Informs the other `clients`, whose activity or recording the stop
    /// ends.
    fn stop(
        &mut self,
        client: ClientId,
        header: VarHeader,
        body: &[u8],
        clients: impl IntoIterator<Item = ClientId>,
    ) -> Vec<Action> {
        let by = self.named(client);
        let others = clients.into_iter().filter(|&other| other != client);
        let told = others.map(|other| {
            let by = by.clone();
            Action::ToClient(other, FromBroker::Stopped { by })
        });
        let told: Vec<Action> = told.collect();
        let mut actions = vec![self.ask(Some(client), header, Request::Other, body)];
        actions.extend(told);
        actions
    }

    /// Ends a client's recording. The device continues to record while other clients need it. A client that does not
    /// record itself ends the recording of all.
    fn stop_recording(&mut self, client: ClientId, header: VarHeader, body: &[u8]) -> Vec<Action> {
        if let Some(recording) = &mut self.recording
            && recording.clients.remove(&client)
            && !recording.clients.is_empty()
        {
            let answer: <RecordStopEndpoint as Endpoint>::Response = Ok(recording.so_far);
            let key = VarKey::Key8(RecordStopEndpoint::RESP_KEY);
            let answer = answer_frame(key, header, &encoded(&answer));
            return vec![Action::ToClient(client, answer)];
        }
        let recording = self.recording.take();
        let clients = recording.map_or_else(BTreeSet::new, |recording| recording.clients);
        self.stop(client, header, body, clients)
    }

    /// Stops a recording that no client needs any more.
    fn end_unwanted_recording(&mut self) -> Vec<Action> {
        if (self.recording)
            .take_if(|recording| recording.clients.is_empty())
            .is_none()
        {
            return Vec::new();
        }
        let header = VarHeader {
            key: VarKey::Key8(RecordStopEndpoint::REQ_KEY),
            seq_no: VarSeq::Seq2(0),
        };
        vec![self.ask(None, header, Request::Other, &[])]
    }

    /// Passes an answer of the device to the client that asked, and updates the broker's state.
    fn answer(&mut self, asked: &Asked, header: VarHeader, body: &[u8]) -> Vec<Action> {
        let is_error = header.key == VarKey::Key8(ERROR_KEY);
        // The first byte of a result in postcard is 0 if the device has not refused.
        let is_done = !is_error && body.first() == Some(&0);
        let mut body = body.to_vec();
        let mut actions = Vec::new();
        match asked.request {
            // A refused request ends only the activity that it began: a client that plays still plays what it played
            // before.
            Request::Begin(activity, true) if !is_done => self.end(asked.client, activity),
            Request::End(activity) if !is_error => self.end(asked.client, activity),
            Request::RecordStart if is_done => {
                self.recording = Some(Recording {
                    clients: asked.client.into_iter().collect(),
                    answer: body.clone(),
                    so_far: RecordStopped {
                        blocks: 0,
                        lost_blocks: 0,
                    },
                });
                // The client may have left before the device answered.
                actions = self.end_unwanted_recording();
            }
            Request::RecordStart if !is_error => {
                if let (Some(recording), Some(client)) = (&mut self.recording, asked.client)
                    && recording.clients.insert(client)
                {
                    body.clone_from(&recording.answer);
                    let RecordStopped {
                        blocks,
                        lost_blocks,
                    } = recording.so_far;
                    let joins = FromBroker::Joins {
                        blocks,
                        lost_blocks,
                    };
                    actions.push(Action::ToClient(client, joins));
                }
            }
            _ => {}
        }
        if let Some(client) = asked.client {
            let answer = answer_frame(header.key, asked.header, &body);
            actions.push(Action::ToClient(client, answer));
        }
        actions
    }
}

/// A time that has passed, in words.
fn ago(time: Duration) -> String {
    match time.as_secs() {
        0..120 => format!("{:.0} s ago", time.as_secs_f64()),
        seconds => format!("{} min ago", seconds / 60),
    }
}

fn frame(header: VarHeader, body: &[u8]) -> Vec<u8> {
    let mut bytes = header.write_to_vec();
    bytes.extend(body);
    bytes
}

/// Returns an answer under the number that the client gave its request.
fn answer_frame(key: VarKey, asked: VarHeader, body: &[u8]) -> FromBroker {
    let seq_no = asked.seq_no;
    FromBroker::Frame(frame(VarHeader { key, seq_no }, body))
}

fn encoded(value: &impl Serialize) -> Vec<u8> {
    postcard::to_allocvec(value).expect("plain data")
}

#[cfg(test)]
mod tests;
