//! Requests: what a frame asks for is done, or handed to the task of the storage, and answered on the wire it came by.
//!
//! Whatever comes in, the answer is the endpoint's, or an error of postcard-rpc's with the request's sequence number: an
//! unknown key, a body that is not of the key's type, or a storage that has enough to do. A topic is not answered.

use embassy_time::Timer;
use model_format::link::{
    ActivateEndpoint, InfoEndpoint, KeepAliveTopic, ListEndpoint, ListSceneEndpoint,
    MotionEndpoint, MotionTopic, PlayEndpoint, PlayError, PlayRequest, Playing,
    RecordStartEndpoint, RecordStopEndpoint, SettingsGetEndpoint, SettingsResetEndpoint,
    SettingsSetEndpoint, SlotsEndpoint, StatusEndpoint, StopEndpoint, UploadAbortEndpoint,
    UploadBeginEndpoint, UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint,
    UploadProgressEndpoint,
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

/// What a link asks for.
pub struct Requests {
    wire: Wire,
}

/// One request: where its answer goes, and what it says.
struct Asked<'a> {
    wire: Wire,
    tx: &'a Sender<Wire>,
    sequence: VarSeq,
    body: &'a [u8],
}

impl Asked<'_> {
    /// The request's body; a host that says something in a known type is there, so the link is alive.
    fn read<'b, T: Deserialize<'b>>(&'b self) -> core::result::Result<T, WireError> {
        let read = postcard::from_bytes(self.body).map_err(|_| WireError::DeserFailed)?;
        self.wire.counters().count(|counters| &mut counters.frames);
        with_control(Control::heard);
        Ok(read)
    }

    async fn refuse(&self, error: WireError) -> Result {
        self.wire
            .counters()
            .count(|counters| &mut counters.malformed);
        self.tx.error(self.sequence, error).await
    }

    /// Answers at once.
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

    /// Has the storage answer.
    async fn hand_over<'b, T: Deserialize<'b>>(
        &'b self,
        job: impl FnOnce(T) -> Option<Job>,
    ) -> Result {
        match self.read().map(job) {
            Ok(Some(job)) => {
                if storage::ask(job, self.tx.clone(), self.sequence) {
                    return Ok(());
                }
                self.tx.error(self.sequence, WireError::FailedToSpawn).await
            }
            Ok(None) => self.refuse(WireError::DeserFailed).await,
            Err(error) => self.refuse(error).await,
        }
    }

    /// Takes a message that is not answered.
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

/// `PlayEndpoint`.
#[expect(
    clippy::result_large_err,
    reason = "without allocation the answer is as large as its longest text"
)]
fn play(request: PlayRequest) -> core::result::Result<Playing, PlayError> {
    with_control(|control| control.play(request))
}

impl Dispatch for Requests {
    type Tx = Wire;

    fn min_key_len(&self) -> VarKeyKind {
        KEY_KIND
    }

    async fn handle(&mut self, tx: &Sender<Wire>, header: &VarHeader, body: &[u8]) -> Result {
        let asked = Asked {
            wire: self.wire,
            tx,
            sequence: header.seq_no,
            body,
        };
        let VarKey::Key8(key) = header.key else {
            return asked.refuse(WireError::KeyTooSmall).await;
        };
        match key {
            PingEndpoint::REQ_KEY => asked.answer::<PingEndpoint>(|number| number).await,
            InfoEndpoint::REQ_KEY => {
                asked
                    .answer::<InfoEndpoint>(|()| with_control(|control| control.info()))
                    .await
            }
            StatusEndpoint::REQ_KEY => {
                asked
                    .answer::<StatusEndpoint>(|()| with_control(|control| control.status()))
                    .await
            }
            UploadProgressEndpoint::REQ_KEY => {
                asked
                    .answer::<UploadProgressEndpoint>(|()| with_control(|control| control.upload()))
                    .await
            }
            PlayEndpoint::REQ_KEY => asked.answer::<PlayEndpoint>(play).await,
            StopEndpoint::REQ_KEY => {
                asked
                    .answer::<StopEndpoint>(|()| with_control(Control::stop))
                    .await
            }
            MotionEndpoint::REQ_KEY => {
                asked
                    .answer::<MotionEndpoint>(|motion| {
                        with_control(|control| control.motion(motion))
                    })
                    .await
            }
            RecordStartEndpoint::REQ_KEY => {
                asked
                    .answer::<RecordStartEndpoint>(|()| recording::start(self.wire))
                    .await
            }
            RecordStopEndpoint::REQ_KEY => {
                asked
                    .answer::<RecordStopEndpoint>(|()| with_control(Control::record_stop))
                    .await
            }
            SettingsGetEndpoint::REQ_KEY => {
                asked
                    .answer::<SettingsGetEndpoint>(|()| {
                        Ok(with_control(|control| control.settings()))
                    })
                    .await
            }
            _ => self.handle_storage_or_topic(&asked, key).await,
        }
    }
}

impl Requests {
    /// For the host on `wire`.
    pub const fn new(wire: Wire) -> Self {
        Self { wire }
    }

    async fn handle_storage_or_topic(&self, asked: &Asked<'_>, key: postcard_rpc::Key) -> Result {
        match key {
            UploadBeginEndpoint::REQ_KEY => {
                asked.hand_over(|begin| Some(Job::UploadBegin(begin))).await
            }
            UploadChunkEndpoint::REQ_KEY => {
                asked
                    .hand_over(|UploadChunk { offset, data }| Job::chunk(offset, data))
                    .await
            }
            UploadCommitEndpoint::REQ_KEY => asked.hand_over(|()| Some(Job::UploadCommit)).await,
            UploadAbortEndpoint::REQ_KEY => asked.hand_over(|()| Some(Job::UploadAbort)).await,
            SlotsEndpoint::REQ_KEY => asked.hand_over(|()| Some(Job::Slots)).await,
            ListEndpoint::REQ_KEY => asked.hand_over(|request| Some(Job::List(request))).await,
            ListSceneEndpoint::REQ_KEY => {
                asked
                    .hand_over(|request| Some(Job::ListScene(request)))
                    .await
            }
            ActivateEndpoint::REQ_KEY => asked.hand_over(|slot| Some(Job::Activate(slot))).await,
            SettingsSetEndpoint::REQ_KEY => {
                asked
                    .hand_over(|change| Some(Job::SettingsSet(change)))
                    .await
            }
            SettingsResetEndpoint::REQ_KEY => asked.hand_over(|()| Some(Job::SettingsReset)).await,
            MotionTopic::TOPIC_KEY => {
                // One that is not finite is dropped; by the endpoint of the same name it would be told.
                asked.take::<MotionTopic>(|motion| {
                    let _ = with_control(|control| control.motion(motion));
                });
                Ok(())
            }
            KeepAliveTopic::TOPIC_KEY => {
                asked.take::<KeepAliveTopic>(|()| ());
                Ok(())
            }
            #[cfg(feature = "fault-injection")]
            crate::injection::KEY => {
                if let Ok(fault) = asked.read() {
                    crate::injection::inject(fault);
                }
                Ok(())
            }
            _ => asked.refuse(WireError::UnknownKey).await,
        }
    }
}

/// Serves the host on `wire` for ever; frames come from `inlet` and are put into `buffer`.
pub async fn serve<R: WireRx>(wire: Wire, inlet: R, buffer: &'static mut [u8]) -> ! {
    let mut server = Server::new(wire, inlet, buffer, Requests::new(wire), KEY_KIND);
    loop {
        // A wire that was lost comes back: what waits for it is in the wire itself.
        server.run().await;
        Timer::after_millis(10).await;
    }
}
