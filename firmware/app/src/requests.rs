//! Dispatch of requests: each is served at once, or waits for the storage as a job.
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
    ActivateEndpoint, CyclesEndpoint, InfoEndpoint, KeepAliveTopic, LinkCounters, LinkId, ListEndpoint,
    ListSceneEndpoint, MAX_CHUNK_BYTES, MAX_DEVICE_FRAME_BYTES, MotionEndpoint, MotionTopic, PlayEndpoint,
    ProbeLoadEndpoint, ProbeStartEndpoint, RecordBlock, RecordBlockTopic, RecordStartEndpoint, RecordStopEndpoint,
    ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint, SelfTestEndpoint, SettingsApplyEndpoint,
    SettingsGetEndpoint, SettingsProposeEndpoint, SlotsEndpoint, StatusEndpoint, StopEndpoint, UPLOAD_WINDOW,
    UpdateBeginEndpoint, UpdateCommitEndpoint, UpdateConfirmEndpoint, UpdateStateEndpoint, UploadAbortEndpoint,
    UploadBeginEndpoint, UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint, UploadProgressEndpoint,
};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::{ERROR_KEY, PingEndpoint, WireError};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::{Deserialize, Serialize};

use crate::control::Control;
use crate::self_test::SelfTestHardware;
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

/// The chunk of an upload as it waits: with its bytes, because the request's frame is gone when they are written.
#[derive(Clone, Debug, Deserialize)]
struct WaitingChunk {
    offset: u32,
    data: Vec<u8, MAX_CHUNK_BYTES>,
}

impl WaitingChunk {
    fn as_sent(&self) -> UploadChunk<'_> {
        UploadChunk {
            offset: self.offset,
            data: &self.data,
        }
    }
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
        let read = postcard::from_bytes(self.body).map_err(|_| WireError::DeserFailed)?;
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
    fn queue<T: Deserialize<'a>>(self, job: fn(T) -> Job) -> Result<Answered, WireError> {
        let job = job(self.read()?);
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

/// Writes, from one line per request, the match that serves it or queues it, the [`Job`] in which it waits, and the
/// match that does the job. A line is an endpoint, a pattern for its request and the expression of its answer. A
/// request that borrows from its frame names the type in which it waits.
macro_rules! requests {
    (
        at once, |$control:ident, $link:ident| { $($quick:ident($quick_request:pat) => $quick_answer:expr,)* }
        by the storage, |$storage:ident, $stage:ident, $bench:ident, $from:ident| {
            $($slow:ident($slow_request:pat $(, $waiting:ty)?) => $slow_answer:expr,)*
        }
    ) => {
        /// A request that waits for the storage, because it needs the flash, takes long, or asks for the state of an
        /// update.
        #[derive(Clone, Debug)]
        #[expect(
            clippy::large_enum_variant,
            clippy::enum_variant_names,
            reason = "the queue reserves a few, each for the largest; their names are their endpoints'"
        )]
        enum Job {
            $($slow(requests!(@type $slow $($waiting)?)),)*
        }

        /// Serves a request at once, or leaves it to the storage.
        fn dispatch<S: Stage, L: Link>(key: Key, request: Request<'_, S, L>) -> Result<Answered, WireError> {
            let $link = request.link.id();
            match key {
                PingEndpoint::REQ_KEY => request.answer::<PingEndpoint>(|_, number| number),
                MotionTopic::TOPIC_KEY => Ok(request.take::<MotionTopic>(|control, motion| {
                    // A motion that is refused is dropped. The endpoint of the same name would report the refusal.
                    let _ = control.motion($link, motion);
                })),
                KeepAliveTopic::TOPIC_KEY => {
                    Ok(request.take::<KeepAliveTopic>(|control, ()| control.keep_alive($link)))
                }
                $($quick::REQ_KEY => request.answer::<$quick>(|$control, $quick_request| $quick_answer),)*
                _ => queue_job(key, request),
            }
        }

        /// Queues the job of a request for the storage. Not inlined, because the image is larger with this code in
        /// [`dispatch`].
        #[inline(never)]
        fn queue_job<S: Stage, L: Link>(key: Key, request: Request<'_, S, L>) -> Result<Answered, WireError> {
            match key {
                $($slow::REQ_KEY => request.queue(Job::$slow),)*
                _ => Err(WireError::UnknownKey),
            }
        }

        /// Does a job and writes its answer into `answer`. Returns the answer's length.
        pub async fn work<F: MappedFlash, N: NorFlash, S: Stage>(
            $storage: &mut Storage<F, N>,
            $stage: &mut S,
            $bench: &mut impl SelfTestHardware,
            queued: QueuedJob,
            answer: &mut Frame,
        ) -> Option<usize> {
            let $from = queued.from;
            let sequence = queued.sequence;
            let to = Reply { sequence, answer };
            match queued.job {
                $(Job::$slow($slow_request) => to.of::<$slow>(&$slow_answer),)*
            }
        }
    };
    (@type $endpoint:ident) => { <$endpoint as Endpoint>::Request };
    (@type $endpoint:ident $waiting:ty) => { $waiting };
}

requests! {
    at once, |control, from| {
        InfoEndpoint(()) => control.info(),
        StatusEndpoint(()) => control.status(),
        CyclesEndpoint(()) => control.take_cycles(),
        PlayEndpoint(play) => control.play(from, play),
        StopEndpoint(()) => control.stop(),
        MotionEndpoint(motion) => control.motion(from, motion),
        RecordStartEndpoint(()) => control.record_start(from),
        RecordStopEndpoint(()) => control.record_stop(),
        SettingsGetEndpoint(()) => Ok(control.settings()),
        SettingsProposeEndpoint(change) => control.propose(from, change),
        ProbeLoadEndpoint(load) => control.load_probe(from, &load),
        ProbeStartEndpoint(start) => control.start_probe(from, &start),
        ResponseGetEndpoint(()) => control.response(),
        ResponseProposeEndpoint(response) => control.propose_response(from, response),
        UploadProgressEndpoint(()) => control.upload(),
    }
    by the storage, |storage, stage, bench, from| {
        SettingsApplyEndpoint(token) => storage.settings_apply(stage, from, token).await,
        ResponseSetEndpoint(change) => storage.response_set(stage, from, change).await,
        UploadBeginEndpoint(begin) => storage.upload_begin(stage, begin).await,
        UploadChunkEndpoint(chunk, WaitingChunk) => storage.upload_chunk(stage, chunk.as_sent()).await,
        UploadCommitEndpoint(()) => storage.upload_commit(stage).await,
        UploadAbortEndpoint(()) => storage.upload_abort(stage),
        SlotsEndpoint(()) => storage.read_slots().await,
        ListEndpoint(request) => storage.list(request).await,
        ListSceneEndpoint(request) => storage.list_scene(request).await,
        ActivateEndpoint(slot) => storage.activate(stage, slot).await,
        SelfTestEndpoint(request) => storage.self_test(stage, bench, request).await,
        UpdateBeginEndpoint(begin) => storage.update_begin(stage, &begin).await,
        UpdateCommitEndpoint(()) => storage.update_commit(stage).await,
        UpdateConfirmEndpoint(()) => storage.update_confirm(stage).await,
        UpdateStateEndpoint(()) => storage.update_state(stage),
    }
}
