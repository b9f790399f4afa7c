//! The device's end of the link: the application's dispatcher and the storage's task.
//!
//! The storage's task does the requests that need the flash, one after the other; all other requests are answered at
//! once. A request that arrives while a job waits for the flash is therefore served in the middle of that job.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use embassy_futures::yield_now;
use model_format::link::{ENDPOINTS, LinkCounters, LinkId, MAX_DEVICE_FRAME_BYTES, MAX_HOST_FRAME_BYTES, TOPICS_IN};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use stylus_app::requests::{self, Link, QUEUED_JOBS, QueuedJob, work};

use crate::device::BoardOf;
use crate::device::{SharedControl, Stores};

/// Encodes `body` under `key`, with this sequence number, as one whole frame.
pub fn frame(key: Key, number: u32, body: &impl Serialize) -> Vec<u8> {
    let header = VarHeader {
        key: VarKey::Key8(key),
        seq_no: VarSeq::Seq4(number),
    };
    let mut bytes = header.write_to_vec();
    bytes.extend(postcard::to_allocvec(body).expect("it fits in memory"));
    bytes
}

/// Returns the path of the frame's endpoint or topic; `None` if it has neither.
pub fn path_of(header: &VarHeader) -> Option<&'static str> {
    let endpoints = ENDPOINTS.endpoints.iter().map(|e| (e.0, e.1));
    let topics = TOPICS_IN.topics.iter().map(|t| (t.0, t.1));
    endpoints
        .chain(topics)
        .find(|(_, key)| VarKey::Key8(*key) == header.key)
        .map(|(path, _)| path)
}

/// Jobs that wait for the storage's task, and its answers.
#[derive(Default)]
struct Desk {
    waiting: VecDeque<QueuedJob>,
    is_at_work: bool,
    wants_restart: bool,
    answers: Vec<(LinkId, Vec<u8>)>,
}

/// The device's end of the protocol.
#[derive(Clone)]
pub struct Requests {
    control: SharedControl,
    desk: Rc<RefCell<Desk>>,
}

/// One link of the device.
struct LinkOf<'a> {
    requests: &'a Requests,
    id: LinkId,
    refuses_jobs: bool,
}

impl Link for LinkOf<'_> {
    fn id(&self) -> LinkId {
        self.id
    }

    fn count(&self, which: fn(&mut LinkCounters) -> &mut u32) {
        *which(&mut self.requests.control.borrow_mut().device().link) += 1;
    }

    fn queue(&self, job: QueuedJob) -> bool {
        let mut desk = self.requests.desk.borrow_mut();
        let is_free = !self.refuses_jobs && desk.waiting.len() < QUEUED_JOBS;
        if is_free {
            desk.waiting.push_back(job);
        }
        is_free
    }
}

impl Requests {
    /// Creates the end of the link of the device that `control` controls.
    pub fn new(control: SharedControl) -> Self {
        Self {
            control,
            desk: Rc::default(),
        }
    }

    /// Does one job after the other, forever.
    pub async fn serve_storage(&self, storage: &mut Stores) {
        let mut stage = self.control.clone();
        let mut board = BoardOf::new(stage.clone());
        let mut answer = [0; MAX_DEVICE_FRAME_BYTES];
        loop {
            let job = self.desk.borrow_mut().waiting.pop_front();
            self.desk.borrow_mut().is_at_work = job.is_some();
            if let Some(job) = job {
                let from = job.from;
                let length = work(storage, &mut stage, &mut board, job, &mut answer)
                    .await
                    .expect("every job is answered");
                let mut desk = self.desk.borrow_mut();
                desk.answers.push((from, answer[..length].into()));
                desk.wants_restart = storage.wants_restart();
            }
            // The image's task waits here until its answer is sent.
            yield_now().await;
        }
    }

    /// True while a job waits or is under way.
    pub fn is_storage_busy(&self) -> bool {
        let desk = self.desk.borrow();
        desk.is_at_work || !desk.waiting.is_empty()
    }

    /// True once the device is to restart, after its answers have been sent.
    pub fn wants_restart(&self) -> bool {
        self.desk.borrow().wants_restart
    }

    /// Returns the answers of jobs that are done, each with the link that it goes to, and forgets them.
    pub fn take_answers(&self) -> Vec<(LinkId, Vec<u8>)> {
        std::mem::take(&mut self.desk.borrow_mut().answers)
    }

    /// Serves one frame that came over `link`. Returns the answer, or `None` if there is none or the storage answers
    /// later. With `refuses_jobs` the storage accepts no job.
    pub fn serve(&self, link: LinkId, bytes: &[u8], refuses_jobs: bool) -> Option<Vec<u8>> {
        if bytes.len() > MAX_HOST_FRAME_BYTES {
            self.control.borrow_mut().device().link.oversized += 1;
            return None;
        }
        let link = LinkOf {
            requests: self,
            id: link,
            refuses_jobs,
        };
        let mut answer = [0; MAX_DEVICE_FRAME_BYTES];
        let length = requests::serve(&self.control, &link, bytes, &mut answer)?;
        Some(answer[..length].into())
    }

    /// Sends over `link` a request that is answered at once. Returns the answer.
    pub fn ask<E>(&self, link: LinkId, body: &E::Request) -> E::Response
    where
        E: Endpoint,
        E::Request: Serialize,
        E::Response: DeserializeOwned,
    {
        let answer = self.send(link, E::REQ_KEY, body).expect("it is answered at once");
        let (_, body) = VarHeader::take_from_slice(&answer).expect("a frame has a header");
        postcard::from_bytes(body).expect("the answer is the endpoint's")
    }

    /// Sends over `link` a message that has no answer.
    pub fn publish<T>(&self, link: LinkId, message: &T::Message)
    where
        T: Topic,
        T::Message: Serialize + Sized,
    {
        assert_eq!(self.send(link, T::TOPIC_KEY, message), None);
    }

    fn send(&self, link: LinkId, key: Key, body: &impl Serialize) -> Option<Vec<u8>> {
        self.serve(link, &frame(key, 1, body), false)
    }
}
