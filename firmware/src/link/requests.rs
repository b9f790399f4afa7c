//! Dispatch of requests: each is served at once or handed to the storage task, and answered on the wire it came by.
//!
//! Every request gets the answer of its endpoint, or an error of postcard-rpc with its sequence number: for an unknown
//! key, a body that is not of the key's type, or a full queue of the storage. A topic is not answered.

use embassy_time::Timer;
use model_format::link::{
    ActivateEndpoint, CyclesEndpoint, InfoEndpoint, KeepAliveTopic, LinkId, ListEndpoint,
    ListSceneEndpoint, MotionEndpoint, MotionTopic, PlayEndpoint, PlayError, PlayRequest, Playing,
    RecordStartEndpoint, RecordStopEndpoint, SelfTestEndpoint, SettingsApplyEndpoint,
    SettingsGetEndpoint, SettingsProposeEndpoint, SlotsEndpoint, StatusEndpoint, StopEndpoint,
    UploadAbortEndpoint, UploadBeginEndpoint, UploadChunk, UploadChunkEndpoint,
    UploadCommitEndpoint, UploadProgressEndpoint,
};
use postcard_rpc::header::{VarHeader, VarKey, VarKeyKind, VarSeq};
use postcard_rpc::server::{Dispatch, Sender, Server, WireRx, WireTxErrorKind};
use postcard_rpc::standard_icd::{PingEndpoint, WireError};
use postcard_rpc::{Endpoint, Topic};
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};
use stylus_app::control::Control;

use crate::link::recording;
use crate::link::storage::{self, Job, with_control};
use crate::link::wire::{KEY_KIND, Wire};

type Result = core::result::Result<(), WireTxErrorKind>;

/// Dispatcher of the requests of one wire.
pub struct Dispatcher {
    wire: Wire,
}

/// One request: its body, and the way of its answer.
struct Request<'a> {
    wire: Wire,
    tx: &'a Sender<Wire>,
    sequence: VarSeq,
    body: &'a [u8],
}

impl Request<'_> {
    /// Decodes the body. A body of a known type counts as a frame.
    fn read<'b, T: Deserialize<'b>>(&'b self) -> core::result::Result<T, WireError> {
        let read = postcard::from_bytes(self.body).map_err(|_| WireError::DeserFailed)?;
        self.wire.counters().count(|counters| &mut counters.frames);
        Ok(read)
    }

    async fn refuse(&self, error: WireError) -> Result {
        self.wire
            .counters()
            .count(|counters| &mut counters.malformed);
        self.tx.error(self.sequence, error).await
    }

    /// Answers with the result of `work`, at once.
    async fn answer<'b, E>(&'b self, work: impl FnOnce(E::Request) -> E::Response) -> Result
    where
        E: Endpoint,
        E::Request: Deserialize<'b>,
        E::Response: Serialize + Schema,
    {
        match self.read() {
            Ok(request) => self.tx.reply::<E>(self.sequence, &work(request)).await,
            Err(error) => self.refuse(error).await,
        }
    }

    /// Queues the job for the storage task, which answers.
    async fn hand_over<'b, T: Deserialize<'b>>(
        &'b self,
        job: impl FnOnce(T) -> Option<Job>,
    ) -> Result {
        match self.read().map(job) {
            Ok(Some(job)) => {
                if storage::queue(job, self.tx.clone(), self.sequence) {
                    return Ok(());
                }
                self.tx.error(self.sequence, WireError::FailedToSpawn).await
            }
            Ok(None) => self.refuse(WireError::DeserFailed).await,
            Err(error) => self.refuse(error).await,
        }
    }

    /// Passes a message, which is not answered, to `work`.
    fn take<'b, T>(&'b self, work: impl FnOnce(T::Message))
    where
        T: Topic,
        T::Message: Deserialize<'b>,
    {
        match self.read() {
            Ok(message) => work(message),
            Err(_) => self
                .wire
                .counters()
                .count(|counters| &mut counters.malformed),
        }
    }
}

/// Server of `PlayEndpoint` for the host on the link `from`.
#[expect(
    clippy::result_large_err,
    reason = "without allocation the answer is as large as its longest text"
)]
fn play(from: LinkId) -> impl FnOnce(PlayRequest) -> core::result::Result<Playing, PlayError> {
    move |request| with_control(|control| control.play(from, request))
}

impl Dispatch for Dispatcher {
    type Tx = Wire;

    fn min_key_len(&self) -> VarKeyKind {
        KEY_KIND
    }

    async fn handle(&mut self, tx: &Sender<Wire>, header: &VarHeader, body: &[u8]) -> Result {
        let request = Request {
            wire: self.wire,
            tx,
            sequence: header.seq_no,
            body,
        };
        let VarKey::Key8(key) = header.key else {
            return request.refuse(WireError::KeyTooSmall).await;
        };
        match key {
            PingEndpoint::REQ_KEY => request.answer::<PingEndpoint>(|number| number).await,
            InfoEndpoint::REQ_KEY => {
                request
                    .answer::<InfoEndpoint>(|()| with_control(|control| control.info()))
                    .await
            }
            StatusEndpoint::REQ_KEY => {
                request
                    .answer::<StatusEndpoint>(|()| with_control(|control| control.status()))
                    .await
            }
            CyclesEndpoint::REQ_KEY => {
                request
                    .answer::<CyclesEndpoint>(|()| with_control(Control::take_cycles))
                    .await
            }
            UploadProgressEndpoint::REQ_KEY => {
                request
                    .answer::<UploadProgressEndpoint>(|()| with_control(|control| control.upload()))
                    .await
            }
            PlayEndpoint::REQ_KEY => {
                request
                    .answer::<PlayEndpoint>(play(request.wire.id()))
                    .await
            }
            StopEndpoint::REQ_KEY => {
                request
                    .answer::<StopEndpoint>(|()| with_control(Control::stop))
                    .await
            }
            MotionEndpoint::REQ_KEY => {
                request
                    .answer::<MotionEndpoint>(|motion| {
                        with_control(|control| control.motion(request.wire.id(), motion))
                    })
                    .await
            }
            RecordStartEndpoint::REQ_KEY => {
                request
                    .answer::<RecordStartEndpoint>(|()| recording::start(self.wire))
                    .await
            }
            RecordStopEndpoint::REQ_KEY => {
                request
                    .answer::<RecordStopEndpoint>(|()| with_control(Control::record_stop))
                    .await
            }
            SettingsGetEndpoint::REQ_KEY => {
                request
                    .answer::<SettingsGetEndpoint>(|()| {
                        Ok(with_control(|control| control.settings()))
                    })
                    .await
            }
            _ => self.handle_storage_or_topic(&request, key).await,
        }
    }
}

impl Dispatcher {
    /// A dispatcher for the host on `wire`.
    pub const fn new(wire: Wire) -> Self {
        Self { wire }
    }

    async fn handle_storage_or_topic(
        &self,
        request: &Request<'_>,
        key: postcard_rpc::Key,
    ) -> Result {
        match key {
            UploadBeginEndpoint::REQ_KEY => {
                request
                    .hand_over(|begin| Some(Job::UploadBegin(begin)))
                    .await
            }
            UploadChunkEndpoint::REQ_KEY => {
                request
                    .hand_over(|UploadChunk { offset, data }| Job::chunk(offset, data))
                    .await
            }
            UploadCommitEndpoint::REQ_KEY => request.hand_over(|()| Some(Job::UploadCommit)).await,
            UploadAbortEndpoint::REQ_KEY => request.hand_over(|()| Some(Job::UploadAbort)).await,
            SlotsEndpoint::REQ_KEY => request.hand_over(|()| Some(Job::Slots)).await,
            ListEndpoint::REQ_KEY => request.hand_over(|list| Some(Job::List(list))).await,
            ListSceneEndpoint::REQ_KEY => {
                request.hand_over(|list| Some(Job::ListScene(list))).await
            }
            ActivateEndpoint::REQ_KEY => request.hand_over(|slot| Some(Job::Activate(slot))).await,
            SettingsProposeEndpoint::REQ_KEY => {
                request
                    .answer::<SettingsProposeEndpoint>(|change| {
                        with_control(|control| control.propose(request.wire.id(), change))
                    })
                    .await
            }
            SettingsApplyEndpoint::REQ_KEY => {
                request
                    .hand_over(|token| Some(Job::SettingsApply(request.wire.id(), token)))
                    .await
            }
            SelfTestEndpoint::REQ_KEY => {
                request
                    .hand_over(|measurement| Some(Job::SelfTest(measurement)))
                    .await
            }
            MotionTopic::TOPIC_KEY => {
                // A motion that is not finite is dropped. The endpoint of the same name would report it.
                request.take::<MotionTopic>(|motion| {
                    let _ = with_control(|control| control.motion(request.wire.id(), motion));
                });
                Ok(())
            }
            KeepAliveTopic::TOPIC_KEY => {
                request.take::<KeepAliveTopic>(|()| {
                    with_control(|control| control.keep_alive(request.wire.id()));
                });
                Ok(())
            }
            #[cfg(feature = "fault-injection")]
            crate::injection::KEY => {
                if let Ok(fault) = request.read() {
                    crate::injection::inject(fault);
                }
                Ok(())
            }
            _ => request.refuse(WireError::UnknownKey).await,
        }
    }
}

/// Serves the host on `wire` forever. Frames come from `receiver`, into `buffer`.
pub async fn serve<R: WireRx>(wire: Wire, receiver: R, buffer: &'static mut [u8]) -> ! {
    let mut server = Server::new(wire, receiver, buffer, Dispatcher::new(wire), KEY_KIND);
    loop {
        // Runs until the wire is lost. The receiver waits until the wire is back.
        server.run().await;
        Timer::after_millis(10).await;
    }
}
