//! Dispatch of requests: each is served at once, or becomes a [`Job`] of the storage.
//!
//! Every request gets the answer of its endpoint, or an error of postcard-rpc with its sequence number: for an unknown
//! or shortened key, a body that is not of the key's type, or a storage that takes no more jobs. A topic is not
//! answered, and neither is a frame without a header.
//!
//! An answer is written as a frame into a buffer of the caller, which sends it. So nothing here waits for a link, and
//! the code for each endpoint is no more than its work and the encoding of its answer.

use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use model_format::link::{
    ActivateEndpoint, CyclesEndpoint, InfoEndpoint, KeepAliveTopic, LinkCounters, LinkId, ListEndpoint, ListRequest,
    ListSceneEndpoint, MAX_CHUNK_BYTES, MAX_DEVICE_FRAME_BYTES, MotionEndpoint, MotionTopic, PlayEndpoint,
    ProbeLoadEndpoint, ProbeStartEndpoint, ProposalToken, RecordBlock, RecordBlockTopic, RecordStartEndpoint,
    RecordStopEndpoint, ResponseChange, ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint,
    SelfTestEndpoint, SelfTestRequest, SettingsApplyEndpoint, SettingsGetEndpoint, SettingsProposeEndpoint, SlotId,
    SlotsEndpoint, StatusEndpoint, StopEndpoint, UPLOAD_WINDOW, UpdateBegin, UpdateBeginEndpoint, UpdateCommitEndpoint,
    UpdateConfirmEndpoint, UpdateStateEndpoint, UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint, UploadChunk,
    UploadChunkEndpoint, UploadCommitEndpoint, UploadProgressEndpoint,
};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::{ERROR_KEY, PingEndpoint, WireError};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::{Deserialize, Serialize};

use crate::control::Control;
use crate::self_test::Bench;
use crate::slots::MappedFlash;
use crate::storage::{Stage, Storage};

/// Buffer of a frame to the host.
pub type Frame = [u8; MAX_DEVICE_FRAME_BYTES];

/// Largest number of jobs that can wait: the chunks of an upload's window except the one that is being written, and two
/// jobs of the other link.
pub const QUEUED_JOBS: usize = UPLOAD_WINDOW + 1;

/// The link that a request came by.
pub trait Link {
    /// The protocol's identifier of this link.
    fn id(&self) -> LinkId;

    /// Adds one to the counter that `which` selects.
    fn count(&self, which: fn(&mut LinkCounters) -> &mut u32);

    /// Queues `job` for [`work`]. Returns false if [`QUEUED_JOBS`] wait.
    fn queue(&self, job: QueuedJob) -> bool;
}

/// A request for the storage, because it needs the flash, takes long, or asks for the state of an update.
#[derive(Clone, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "the queue reserves a few, each for the largest"
)]
pub enum Job {
    /// `UploadBeginEndpoint`.
    UploadBegin(UploadBegin),
    /// `UploadChunkEndpoint`: offset and bytes, which are copied, because the request's frame is gone when they are
    /// written.
    UploadChunk(u32, Vec<u8, MAX_CHUNK_BYTES>),
    /// `UploadCommitEndpoint`.
    UploadCommit,
    /// `UploadAbortEndpoint`.
    UploadAbort,
    /// `SlotsEndpoint`.
    Slots,
    /// `ListEndpoint`.
    List(ListRequest),
    /// `ListSceneEndpoint`.
    ListScene(ListRequest),
    /// `ActivateEndpoint`.
    Activate(SlotId),
    /// `SettingsApplyEndpoint`.
    SettingsApply(ProposalToken),
    /// `ResponseSetEndpoint`.
    ResponseSet(ResponseChange),
    /// `SelfTestEndpoint`.
    SelfTest(SelfTestRequest),
    /// `UpdateBeginEndpoint`.
    UpdateBegin(UpdateBegin),
    /// `UpdateCommitEndpoint`.
    UpdateCommit,
    /// `UpdateConfirmEndpoint`.
    UpdateConfirm,
    /// `UpdateStateEndpoint`.
    UpdateState,
}

/// A job, with the link and the sequence number of its answer.
#[derive(Clone, Debug)]
pub struct QueuedJob {
    /// The link that the answer goes to.
    pub from: LinkId,
    sequence: VarSeq,
    job: Job,
}

/// Length of the answer in its buffer; none if there is no answer, or not yet.
type Answered = Option<usize>;

/// Serves a frame that came over `link`. Returns the length of the answer in `answer`; none if the frame is not
/// answered, or the storage will answer it.
pub fn serve<S: Stage>(stage: &S, link: &impl Link, frame: &[u8], answer: &mut Frame) -> Option<usize> {
    let Some((header, body)) = VarHeader::take_from_slice(frame) else {
        link.count(|counters| &mut counters.malformed);
        return None;
    };
    let sequence = header.seq_no;
    let served = match header.key {
        VarKey::Key8(key) => {
            // Borrowed again, because an error is written into the same buffer below.
            let answer = &mut *answer;
            let to = Reply { sequence, answer };
            dispatch(key, Request { stage, link, body, to })
        }
        _ => Err(WireError::KeyTooSmall),
    };
    served.unwrap_or_else(|error| {
        // A full queue is no fault of the frame.
        if !matches!(error, WireError::FailedToSpawn) {
            link.count(|counters| &mut counters.malformed);
        }
        encode(ERROR_KEY, sequence, &error, answer)
    })
}

/// Writes the frame of a recording's block into `frame`, and returns its length.
pub fn encode_block(block: &RecordBlock, frame: &mut Frame) -> Option<usize> {
    let sequence = VarSeq::Seq4(block.sequence);
    encode(RecordBlockTopic::TOPIC_KEY, sequence, block, frame)
}

/// Does a job and writes its answer into `answer`. Returns the answer's length.
pub async fn work<F: MappedFlash, N: NorFlash, S: Stage>(
    storage: &mut Storage<F, N>,
    stage: &mut S,
    bench: &mut impl Bench,
    queued: QueuedJob,
    answer: &mut Frame,
) -> Option<usize> {
    let from = queued.from;
    let to = Reply {
        sequence: queued.sequence,
        answer,
    };
    match queued.job {
        Job::UploadBegin(begin) => to.of::<UploadBeginEndpoint>(&storage.upload_begin(stage, begin).await),
        Job::UploadChunk(offset, data) => {
            let data = &data;
            let chunk = UploadChunk { offset, data };
            to.of::<UploadChunkEndpoint>(&storage.upload_chunk(stage, chunk).await)
        }
        Job::UploadCommit => to.of::<UploadCommitEndpoint>(&storage.upload_commit(stage).await),
        Job::UploadAbort => to.of::<UploadAbortEndpoint>(&storage.upload_abort(stage)),
        Job::Slots => to.of::<SlotsEndpoint>(&storage.read_slots().await),
        Job::List(request) => to.of::<ListEndpoint>(&storage.list(request).await),
        Job::ListScene(request) => to.of::<ListSceneEndpoint>(&storage.list_scene(request).await),
        Job::Activate(slot) => to.of::<ActivateEndpoint>(&storage.activate(stage, slot).await),
        Job::SettingsApply(token) => to.of::<SettingsApplyEndpoint>(&storage.settings_apply(stage, from, token).await),
        Job::ResponseSet(change) => to.of::<ResponseSetEndpoint>(&storage.response_set(stage, from, change).await),
        Job::SelfTest(request) => to.of::<SelfTestEndpoint>(&storage.self_test(stage, bench, request).await),
        Job::UpdateBegin(begin) => to.of::<UpdateBeginEndpoint>(&storage.update_begin(stage, &begin).await),
        Job::UpdateCommit => to.of::<UpdateCommitEndpoint>(&storage.update_commit(stage).await),
        Job::UpdateConfirm => to.of::<UpdateConfirmEndpoint>(&storage.update_confirm(stage).await),
        Job::UpdateState => to.of::<UpdateStateEndpoint>(&storage.update_state(stage)),
    }
}

/// The buffer of an answer, and the sequence number of its request.
struct Reply<'a> {
    sequence: VarSeq,
    answer: &'a mut Frame,
}

impl Reply<'_> {
    /// Writes the answer of an endpoint.
    fn of<E: Endpoint<Response: Serialize>>(self, response: &E::Response) -> Answered {
        encode(E::RESP_KEY, self.sequence, response, self.answer)
    }
}

/// Writes header and message into `frame`. Returns their length; none if they do not fit. Every message within the
/// limits of [`model_format::link`] fits.
fn encode<T: Serialize>(key: Key, seq_no: VarSeq, message: &T, frame: &mut Frame) -> Option<usize> {
    let key = VarKey::Key8(key);
    let (head, rest) = VarHeader { key, seq_no }.write_to_slice(frame)?;
    let body = postcard::to_slice(message, rest).ok()?.len();
    Some(head.len() + body)
}

/// One request.
struct Request<'a, S, L> {
    stage: &'a S,
    link: &'a L,
    body: &'a [u8],
    to: Reply<'a>,
}

impl<'a, S: Stage, L: Link> Request<'a, S, L> {
    /// Decodes the body, and counts the frame if the body is of the key's type.
    fn read<T: Deserialize<'a>>(&self) -> Result<T, WireError> {
        self.read_as(Some)
    }

    /// Decodes the body by `convert`, and counts the frame if there is a result.
    fn read_as<T: Deserialize<'a>, U>(&self, convert: impl FnOnce(T) -> Option<U>) -> Result<U, WireError> {
        let read = postcard::from_bytes(self.body).ok().and_then(convert);
        let read = read.ok_or(WireError::DeserFailed)?;
        self.link.count(|counters| &mut counters.frames);
        Ok(read)
    }

    /// Answers with the result of `work`, at once.
    fn answer<E>(
        self,
        work: impl FnOnce(&mut Control<S::Device>, E::Request) -> E::Response,
    ) -> Result<Answered, WireError>
    where
        E: Endpoint<Request: Deserialize<'a>, Response: Serialize>,
    {
        let request = self.read()?;
        let response = self.stage.with_control(|control| work(control, request));
        Ok(self.to.of::<E>(&response))
    }

    /// Queues a job for the storage, which will answer it.
    fn queue<T: Deserialize<'a>>(self, job: impl FnOnce(T) -> Option<Job>) -> Result<Answered, WireError> {
        let job = self.read_as(job)?;
        let queued = QueuedJob {
            from: self.link.id(),
            sequence: self.to.sequence,
            job,
        };
        if !self.link.queue(queued) {
            return Err(WireError::FailedToSpawn);
        }
        Ok(None)
    }

    /// Passes a message, which is not answered, to `work`.
    fn take<T>(self, work: impl FnOnce(&mut Control<S::Device>, T::Message)) -> Answered
    where
        T: Topic<Message: Deserialize<'a> + Sized>,
    {
        match self.read() {
            Ok(message) => self.stage.with_control(|control| work(control, message)),
            Err(_) => self.link.count(|counters| &mut counters.malformed),
        }
        None
    }
}

/// Serves a request at once, or leaves it to the storage.
fn dispatch<S: Stage, L: Link>(key: Key, request: Request<'_, S, L>) -> Result<Answered, WireError> {
    let from = request.link.id();
    match key {
        PingEndpoint::REQ_KEY => request.answer::<PingEndpoint>(|_, number| number),
        InfoEndpoint::REQ_KEY => request.answer::<InfoEndpoint>(|control, ()| control.info()),
        StatusEndpoint::REQ_KEY => request.answer::<StatusEndpoint>(|control, ()| control.status()),
        CyclesEndpoint::REQ_KEY => request.answer::<CyclesEndpoint>(|control, ()| control.take_cycles()),
        PlayEndpoint::REQ_KEY => request.answer::<PlayEndpoint>(|control, play| control.play(from, play)),
        StopEndpoint::REQ_KEY => request.answer::<StopEndpoint>(|control, ()| control.stop()),
        MotionEndpoint::REQ_KEY => request.answer::<MotionEndpoint>(|control, motion| control.motion(from, motion)),
        MotionTopic::TOPIC_KEY => {
            // A motion that is refused is dropped. The endpoint of the same name would report the refusal.
            Ok(request.take::<MotionTopic>(|control, motion| {
                let _ = control.motion(from, motion);
            }))
        }
        KeepAliveTopic::TOPIC_KEY => Ok(request.take::<KeepAliveTopic>(|control, ()| control.keep_alive(from))),
        RecordStartEndpoint::REQ_KEY => request.answer::<RecordStartEndpoint>(|control, ()| control.record_start(from)),
        RecordStopEndpoint::REQ_KEY => request.answer::<RecordStopEndpoint>(|control, ()| control.record_stop()),
        SettingsGetEndpoint::REQ_KEY => request.answer::<SettingsGetEndpoint>(|control, ()| Ok(control.settings())),
        SettingsProposeEndpoint::REQ_KEY => {
            request.answer::<SettingsProposeEndpoint>(|control, change| control.propose(from, change))
        }
        ProbeLoadEndpoint::REQ_KEY => {
            request.answer::<ProbeLoadEndpoint>(|control, load| control.load_probe(from, &load))
        }
        ProbeStartEndpoint::REQ_KEY => {
            request.answer::<ProbeStartEndpoint>(|control, start| control.start_probe(from, &start))
        }
        ResponseGetEndpoint::REQ_KEY => request.answer::<ResponseGetEndpoint>(|control, ()| control.response()),
        ResponseProposeEndpoint::REQ_KEY => {
            request.answer::<ResponseProposeEndpoint>(|control, response| control.propose_response(from, response))
        }
        UploadProgressEndpoint::REQ_KEY => request.answer::<UploadProgressEndpoint>(|control, ()| control.upload()),
        _ => queue_job(key, request),
    }
}

/// Queues the job of a request for the storage. Not inlined, because the image is larger with this code in
/// [`dispatch`].
#[inline(never)]
fn queue_job<S: Stage, L: Link>(key: Key, request: Request<'_, S, L>) -> Result<Answered, WireError> {
    match key {
        SettingsApplyEndpoint::REQ_KEY => request.queue(|token| Some(Job::SettingsApply(token))),
        ResponseSetEndpoint::REQ_KEY => request.queue(|change| Some(Job::ResponseSet(change))),
        UploadBeginEndpoint::REQ_KEY => request.queue(|begin| Some(Job::UploadBegin(begin))),
        UploadChunkEndpoint::REQ_KEY => request.queue(|UploadChunk { offset, data }| {
            let data = Vec::from_slice(data).ok()?;
            Some(Job::UploadChunk(offset, data))
        }),
        UploadCommitEndpoint::REQ_KEY => request.queue(|()| Some(Job::UploadCommit)),
        UploadAbortEndpoint::REQ_KEY => request.queue(|()| Some(Job::UploadAbort)),
        SlotsEndpoint::REQ_KEY => request.queue(|()| Some(Job::Slots)),
        ListEndpoint::REQ_KEY => request.queue(|list| Some(Job::List(list))),
        ListSceneEndpoint::REQ_KEY => request.queue(|list| Some(Job::ListScene(list))),
        ActivateEndpoint::REQ_KEY => request.queue(|slot| Some(Job::Activate(slot))),
        SelfTestEndpoint::REQ_KEY => request.queue(|request| Some(Job::SelfTest(request))),
        UpdateBeginEndpoint::REQ_KEY => request.queue(|begin| Some(Job::UpdateBegin(begin))),
        UpdateCommitEndpoint::REQ_KEY => request.queue(|()| Some(Job::UpdateCommit)),
        UpdateConfirmEndpoint::REQ_KEY => request.queue(|()| Some(Job::UpdateConfirm)),
        UpdateStateEndpoint::REQ_KEY => request.queue(|()| Some(Job::UpdateState)),
        _ => Err(WireError::UnknownKey),
    }
}
