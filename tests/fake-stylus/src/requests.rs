//! Frames and their answers: the protocol of `firmware/src/link`, over the application on fake hardware.
//!
//! As there, requests for flash are handed to a task of their own, one after the other, and everything else is answered
//! at once; so a request that comes while a job waits for the flash is served in the middle of that job.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::pin::Pin;
use std::rc::Rc;

use embassy_futures::yield_now;
use model_format::link::{
    ActivateEndpoint, CyclesEndpoint, ENDPOINTS, InfoEndpoint, KeepAliveTopic, LinkId,
    ListEndpoint, ListSceneEndpoint, MAX_CHUNK_BYTES, MAX_HOST_FRAME_BYTES, MotionEndpoint,
    MotionTopic, PlayEndpoint, RecordStartEndpoint, RecordStopEndpoint, SelfTestEndpoint,
    SettingsApplyEndpoint, SettingsGetEndpoint, SettingsProposeEndpoint, SlotsEndpoint,
    StatusEndpoint, StopEndpoint, TOPICS_IN, UPLOAD_WINDOW, UploadAbortEndpoint,
    UploadBeginEndpoint, UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint,
    UploadProgressEndpoint,
};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::{ERROR_KEY, PingEndpoint, WireError};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::device::{SharedControl, Stores};
use crate::self_test::BoardOf;

/// Jobs that may wait for the storage, as in the image.
const QUEUED_JOBS: usize = UPLOAD_WINDOW + 1;

/// A frame of `body` under `key`, which is sent whole.
pub fn frame(key: Key, mut header: VarHeader, body: &impl Serialize) -> Vec<u8> {
    header.key = VarKey::Key8(key);
    let mut bytes = header.write_to_vec();
    bytes.extend(postcard::to_allocvec(body).expect("it fits in memory"));
    bytes
}

/// The path of the endpoint or topic that a frame is for.
pub fn path_of(header: &VarHeader) -> Option<&'static str> {
    let endpoints = ENDPOINTS.endpoints.iter().map(|e| (e.0, e.1));
    let topics = TOPICS_IN.topics.iter().map(|t| (t.0, t.1));
    endpoints
        .chain(topics)
        .find(|(_, key)| VarKey::Key8(*key) == header.key)
        .map(|(path, _)| path)
}

/// The future of a job, whose result is the frame of its answer.
type Work<'a> = Pin<Box<dyn Future<Output = Vec<u8>> + 'a>>;

/// A request for flash that waits.
type Job = Box<dyn for<'a> FnOnce(&'a mut Stores, &'a mut SharedControl) -> Work<'a>>;

/// Jobs on their way to the storage's task, and its answers.
#[derive(Default)]
struct Desk {
    waiting: VecDeque<Job>,
    is_at_work: bool,
    answers: Vec<Vec<u8>>,
}

/// The device's end of the protocol.
#[derive(Clone)]
pub struct Requests {
    control: SharedControl,
    desk: Rc<RefCell<Desk>>,
}

impl Requests {
    /// Requests to the device of `control`.
    pub fn new(control: SharedControl) -> Self {
        Self {
            control,
            desk: Rc::default(),
        }
    }

    /// Does one job after the other, for ever.
    pub async fn serve_storage(&self, storage: &mut Stores) {
        let mut stage = self.control.clone();
        loop {
            let job = self.desk.borrow_mut().waiting.pop_front();
            self.desk.borrow_mut().is_at_work = job.is_some();
            match job {
                Some(job) => {
                    let answer = job(storage, &mut stage).await;
                    self.desk.borrow_mut().answers.push(answer);
                    // The image's task waits here until the answer is sent.
                    yield_now().await;
                }
                None => yield_now().await,
            }
        }
    }

    /// True while a job waits or is under way.
    pub fn is_storage_busy(&self) -> bool {
        let desk = self.desk.borrow();
        desk.is_at_work || !desk.waiting.is_empty()
    }

    /// The answers of jobs that are done.
    pub fn take_answers(&self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.desk.borrow_mut().answers)
    }

    /// Serves one frame that came over `link`; its answer, unless it has none or the storage will give it. If
    /// `refuses_jobs`, the storage takes none.
    pub fn serve(&self, link: LinkId, bytes: &[u8], refuses_jobs: bool) -> Option<Vec<u8>> {
        if bytes.len() > MAX_HOST_FRAME_BYTES {
            self.control.borrow_mut().device().link.oversized += 1;
            return None;
        }
        let Some((header, body)) = VarHeader::take_from_slice(bytes) else {
            self.count_malformed();
            return None;
        };
        let VarKey::Key8(key) = header.key else {
            return Some(self.refuse(header, &WireError::KeyTooSmall));
        };
        let asked = Asked {
            requests: self,
            link,
            header,
            body,
            refuses_jobs,
        };
        asked.dispatch(key)
    }

    /// Asks over `link` what is answered at once; the answer.
    pub fn ask<E>(&self, link: LinkId, body: &E::Request) -> E::Response
    where
        E: Endpoint,
        E::Request: Serialize,
        E::Response: DeserializeOwned,
    {
        let answer = self.send(link, E::REQ_KEY, body);
        let answer = answer.expect("it is answered at once");
        let (_, body) = VarHeader::take_from_slice(&answer).expect("a frame has a header");
        postcard::from_bytes(body).expect("the answer is the endpoint's")
    }

    /// Sends a message over `link`, which is not answered.
    pub fn publish<T>(&self, link: LinkId, message: &T::Message)
    where
        T: Topic,
        T::Message: Serialize + Sized,
    {
        assert_eq!(self.send(link, T::TOPIC_KEY, message), None);
    }

    fn send(&self, link: LinkId, key: Key, body: &impl Serialize) -> Option<Vec<u8>> {
        let header = VarHeader {
            key: VarKey::Key8(key),
            seq_no: VarSeq::Seq4(1),
        };
        self.serve(link, &frame(key, header, body), false)
    }

    fn count_malformed(&self) {
        self.control.borrow_mut().device().link.malformed += 1;
    }

    fn refuse(&self, header: VarHeader, error: &WireError) -> Vec<u8> {
        self.count_malformed();
        frame(ERROR_KEY, header, error)
    }
}

/// One request.
struct Asked<'a> {
    requests: &'a Requests,
    link: LinkId,
    header: VarHeader,
    body: &'a [u8],
    refuses_jobs: bool,
}

impl<'a> Asked<'a> {
    /// The request's body.
    fn read<T: Deserialize<'a>>(&self) -> Result<T, WireError> {
        let read = postcard::from_bytes(self.body).map_err(|_| WireError::DeserFailed)?;
        let mut control = self.requests.control.borrow_mut();
        control.device().link.frames += 1;
        Ok(read)
    }

    /// Answers at once.
    fn answer<E>(&self, work: impl FnOnce(E::Request) -> E::Response) -> Vec<u8>
    where
        E: Endpoint,
        E::Request: Deserialize<'a>,
        E::Response: Serialize,
    {
        match self.read() {
            Ok(request) => frame(E::RESP_KEY, self.header, &work(request)),
            Err(error) => self.requests.refuse(self.header, &error),
        }
    }

    /// Hands a job to the storage, which answers; else the refusal.
    fn hand_over(&self, job: Job) -> Option<Vec<u8>> {
        let mut desk = self.requests.desk.borrow_mut();
        if self.refuses_jobs || desk.waiting.len() == QUEUED_JOBS {
            return Some(frame(ERROR_KEY, self.header, &WireError::FailedToSpawn));
        }
        desk.waiting.push_back(job);
        None
    }

    /// Takes a message that is not answered.
    fn take<T>(&self, work: impl FnOnce(T::Message))
    where
        T: Topic,
        T::Message: Deserialize<'a>,
    {
        match self.read() {
            Ok(message) => work(message),
            Err(_) => self.requests.count_malformed(),
        }
    }

    #[expect(
        clippy::result_large_err,
        reason = "the device's answers carry their texts, without allocation"
    )]
    fn dispatch(&self, key: Key) -> Option<Vec<u8>> {
        let control = &self.requests.control;
        macro_rules! now {
            ($endpoint:ty, $request:pat => $answer:expr) => {
                if key == <$endpoint>::REQ_KEY {
                    return Some(self.answer::<$endpoint>(|$request| $answer));
                }
            };
        }
        macro_rules! later {
            ($endpoint:ty, |$storage:ident, $stage:ident, $request:ident| $answer:expr) => {
                if key == <$endpoint>::REQ_KEY {
                    return match self.read::<<$endpoint as Endpoint>::Request>() {
                        Ok($request) => {
                            let header = self.header;
                            self.hand_over(Box::new(move |$storage, $stage| {
                                Box::pin(async move {
                                    let answer: <$endpoint as Endpoint>::Response = $answer;
                                    frame(<$endpoint>::RESP_KEY, header, &answer)
                                })
                            }))
                        }
                        Err(error) => Some(self.requests.refuse(self.header, &error)),
                    };
                }
            };
        }
        now!(PingEndpoint, number => number);
        now!(InfoEndpoint, () => control.borrow().info());
        now!(StatusEndpoint, () => control.borrow().status());
        now!(CyclesEndpoint, () => control.borrow_mut().take_cycles());
        now!(UploadProgressEndpoint, () => control.borrow().upload());
        now!(PlayEndpoint, request => control.borrow_mut().play(self.link, request));
        now!(StopEndpoint, () => control.borrow_mut().stop());
        now!(MotionEndpoint, sample => control.borrow_mut().motion(self.link, sample));
        now!(RecordStartEndpoint, () => control.borrow_mut().record_start());
        now!(RecordStopEndpoint, () => control.borrow_mut().record_stop());
        now!(SettingsProposeEndpoint, change => control.borrow_mut().propose(self.link, change));
        now!(SettingsGetEndpoint, () => Ok(control.borrow().settings()));
        later!(UploadBeginEndpoint, |storage, stage, begin| storage
            .upload_begin(stage, begin)
            .await);
        later!(UploadCommitEndpoint, |storage, stage, _nothing| storage
            .upload_commit(stage)
            .await);
        later!(SlotsEndpoint, |storage, _stage, _nothing| storage
            .read_slots()
            .await);
        later!(ListEndpoint, |storage, _stage, request| storage
            .list(request)
            .await);
        later!(ListSceneEndpoint, |storage, _stage, request| storage
            .list_scene(request)
            .await);
        later!(UploadAbortEndpoint, |storage, stage, ()| storage
            .upload_abort(stage));
        later!(ActivateEndpoint, |storage, stage, slot| storage
            .activate(stage, slot)
            .await);
        let link = self.link;
        later!(SettingsApplyEndpoint, |storage, stage, token| storage
            .settings_apply(stage, link, token)
            .await);
        later!(SelfTestEndpoint, |storage, stage, request| {
            let mut board = BoardOf::new(stage.clone());
            storage.self_test(stage, &mut board, request).await
        });
        match key {
            UploadChunkEndpoint::REQ_KEY => self.hand_over_chunk(),
            MotionTopic::TOPIC_KEY => {
                // One that is not finite is dropped; the endpoint of the same name would tell.
                self.take::<MotionTopic>(|sample| {
                    let _ = control.borrow_mut().motion(self.link, sample);
                });
                None
            }
            KeepAliveTopic::TOPIC_KEY => {
                self.take::<KeepAliveTopic>(|()| control.borrow_mut().keep_alive(self.link));
                None
            }
            _ => Some(self.requests.refuse(self.header, &WireError::UnknownKey)),
        }
    }

    /// A chunk is copied, because the request's bytes are gone when its turn comes.
    fn hand_over_chunk(&self) -> Option<Vec<u8>> {
        let header = self.header;
        match self.read() {
            Ok(UploadChunk { offset, data }) if data.len() <= MAX_CHUNK_BYTES => {
                let data = data.to_vec();
                self.hand_over(Box::new(move |storage, stage| {
                    Box::pin(async move {
                        let chunk = UploadChunk {
                            offset,
                            data: &data,
                        };
                        let answer = storage.upload_chunk(stage, chunk).await;
                        frame(UploadChunkEndpoint::RESP_KEY, header, &answer)
                    })
                }))
            }
            Ok(_) => Some(self.requests.refuse(header, &WireError::DeserFailed)),
            Err(error) => Some(self.requests.refuse(header, &error)),
        }
    }
}
