//! The connection to a device: how it is opened, identified and reopened after a loss, and the requests that every
//! subject needs.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use model_format::link::{
    ANSWER_TIMEOUT_MS, DeviceInfo, FLASH_TIMEOUT_MS, InfoEndpoint, MotionEndpoint, MotionSample, MotionSource, Status,
    StatusEndpoint,
};
use postcard_rpc::host_client::HostErr;
use postcard_rpc::standard_icd::WireError;
use postcard_rpc::{Endpoint, Topic};
use postcard_schema::Schema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::runtime::{Handle, Runtime};

use crate::link::address::LinkAddress;
use crate::link::error::Mismatch;
use crate::link::error::{LinkError, Result};
use crate::link::limit::Limit;
use crate::link::links::{Client, explained, open};
use crate::link::wire::Health;

/// Time for which a link may still be another program's when this one opens it. A program that ends frees its link
/// within this time.
const PATIENCE: Duration = Duration::from_millis(300);

/// Interval between attempts to open a link that is another program's.
const RETRY_INTERVAL: Duration = Duration::from_millis(30);

/// Interval between attempts to open a broken link.
const RECONNECT_INTERVAL: Duration = Duration::from_millis(250);

/// Interval between requests to a device whose flash is busy.
pub(super) const BUSY_INTERVAL: Duration = Duration::from_millis(50);

/// Interval between readings of the status while this program waits for the device.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// A request to the device, whose types can be sent and received.
pub(super) trait Ask: Endpoint<Request: Serialize + Schema, Response: DeserializeOwned + Schema> {}

impl<E: Endpoint<Request: Serialize + Schema, Response: DeserializeOwned + Schema>> Ask for E {}

/// A stylus at the other end of a link.
///
/// Every request blocks the calling thread until the answer has arrived or its [timeout](Timeouts) has passed.
pub struct Device {
    // This field is dropped first, so that the tasks that use the runtime end.
    pub(super) requester: Requester,
    address: LinkAddress,
    info: DeviceInfo,
    /// True if a device that speaks another protocol is accepted too.
    is_any: bool,
    runtime: Option<Runtime>,
}

impl Device {
    /// Opens the link and reads the device's identity.
    ///
    /// # Errors
    /// A link that cannot be opened or that another program has, a device that does not answer, or one that speaks
    /// another protocol.
    pub fn connect(address: &LinkAddress, timeouts: Timeouts) -> Result<Self> {
        Self::connect_as(address, timeouts, false)
    }

    /// Opens the link, also to a device that speaks another protocol. Only requests that both sides know then work;
    /// those of an update do not change.
    pub fn connect_to_any(address: &LinkAddress, timeouts: Timeouts) -> Result<Self> {
        Self::connect_as(address, timeouts, true)
    }

    fn connect_as(address: &LinkAddress, timeouts: Timeouts, is_any: bool) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            // The link has two tasks that mostly wait, so one thread serves both.
            .worker_threads(1)
            .thread_name("stylus-link")
            .enable_all()
            .build()
            .map_err(LinkError::Host)?;
        let begin = Instant::now();
        let (requester, info) = loop {
            match runtime.block_on(Self::identify(address, timeouts, is_any)) {
                Ok(identified) => break identified,
                Err(LinkError::Busy { .. } | LinkError::Lost { .. }) if begin.elapsed() < PATIENCE => {
                    thread::sleep(RETRY_INTERVAL);
                }
                Err(failure) => return Err(runtime.block_on(explained(failure, address))),
            }
        };
        Ok(Self {
            requester,
            address: address.clone(),
            info,
            is_any,
            runtime: Some(runtime),
        })
    }

    async fn identify(address: &LinkAddress, timeouts: Timeouts, is_any: bool) -> Result<(Requester, DeviceInfo)> {
        let health = Arc::new(Health::default());
        let requester = Requester {
            client: open(address, &health).await?,
            health,
            link: address.clone().into(),
            timeouts,
        };
        let info = requester
            .request::<InfoEndpoint>("identity", timeouts.answer, &())
            .await
            .inspect_err(|_| requester.close())?;
        match Mismatch::of_protocol(&info).filter(|_| !is_any) {
            None => Ok((requester, info)),
            Some(mismatch) => {
                requester.close();
                Err(LinkError::Version {
                    link: address.to_string(),
                    mismatch,
                })
            }
        }
    }

    /// Reopens the link, in repeated attempts until [`Timeouts::reconnect`] has passed.
    ///
    /// # Errors
    /// The failure of the last attempt, another protocol, or another device that answers.
    pub fn reconnect(&mut self) -> Result<()> {
        self.requester.close();
        let timeouts = self.requester.timeouts;
        let mut limit = self.limit(timeouts.reconnect);
        loop {
            // Asked before the attempt, so that there is one after a pause of this computer.
            let is_last = limit.has_passed();
            match self
                .runtime()
                .block_on(Self::identify(&self.address, timeouts, self.is_any))
            {
                Ok((requester, info)) if info.serial == self.info.serial => {
                    (self.requester, self.info) = (requester, info);
                    return Ok(());
                }
                Ok((requester, info)) => {
                    requester.close();
                    return Err(self.not_verified(format!(
                        "another device answers (serial number {} instead of {}): plug the first \
                         one in and start again",
                        info.serial, self.info.serial
                    )));
                }
                // Another protocol stays another one, however long the wait.
                Err(failure @ LinkError::Version { .. }) => return Err(failure),
                Err(failure) if is_last => {
                    let explained = explained(failure, &self.address);
                    return Err(self.runtime().block_on(explained));
                }
                Err(_) => thread::sleep(RECONNECT_INTERVAL),
            }
        }
    }

    pub(super) fn runtime(&self) -> &Runtime {
        self.runtime.as_ref().expect("it lives until the drop")
    }

    fn request_within<E: Ask>(
        &self,
        name: &'static str,
        timeout: Duration,
        request: &E::Request,
    ) -> Result<E::Response> {
        self.runtime()
            .block_on(self.requester.request::<E>(name, timeout, request))
    }

    /// Sends a message that is not answered, such as one that only the test image knows.
    pub fn publish<T>(&self, message: &T::Message) -> Result<()>
    where
        T: Topic,
        T::Message: Serialize,
    {
        self.runtime().block_on(self.requester.publish::<T>(message))
    }

    /// Makes a request that does not touch the flash. `name` names the request in errors.
    pub(super) fn request<E: Ask>(&self, name: &'static str, request: &E::Request) -> Result<E::Response> {
        self.request_within::<E>(name, self.requester.timeouts.answer, request)
    }

    /// Makes a request that may read, erase or write flash, and repeats it while the flash is busy with an earlier one.
    pub(super) fn request_flash<E: Ask>(&self, name: &'static str, request: &E::Request) -> Result<E::Response> {
        let timeout = self.requester.timeouts.flash;
        let mut limit = self.limit(timeout);
        loop {
            let is_last = limit.has_passed();
            match self.request_within::<E>(name, timeout, request) {
                // The device's queue of jobs for the flash is full.
                Err(LinkError::Frame {
                    error: WireError::FailedToSpawn,
                    ..
                }) if !is_last => thread::sleep(BUSY_INTERVAL),
                answer => return answer,
            }
        }
    }

    /// Begins a wait of at most this duration for the device.
    pub(in crate::link) fn limit(&self, longest: Duration) -> Limit {
        Limit::new(&self.address, longest)
    }

    /// An error for a device that reports another state than the requested one.
    pub(crate) fn not_verified(&self, what: String) -> LinkError {
        LinkError::NotVerified {
            link: self.address.to_string(),
            what,
        }
    }

    /// Returns a requester that does not block this device's owner, and the runtime that the requester needs.
    pub(in crate::link) fn requester(&self) -> (Requester, Handle) {
        (self.requester.clone(), self.runtime().handle().clone())
    }

    /// The address that the link was opened with.
    pub fn address(&self) -> &LinkAddress {
        &self.address
    }

    /// The device's identity, as it was when the link was opened.
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// The timeouts of this device's requests.
    pub fn timeouts(&self) -> Timeouts {
        self.requester.timeouts
    }

    /// Number of frames since the link was opened that arrived and could not be decoded.
    pub fn broken_frames(&self) -> u64 {
        self.requester.broken_frames()
    }

    /// Checks that the device plays the library format that this program writes.
    ///
    /// # Errors
    /// Different formats; the error names the older side.
    pub fn check_library_format(&self) -> Result<()> {
        match Mismatch::of_library_format(&self.info) {
            None => Ok(()),
            Some(mismatch) => Err(LinkError::Version {
                link: self.address.to_string(),
                mismatch,
            }),
        }
    }

    /// Reads the status, with all of the device's counters.
    pub fn status(&self) -> Result<Status> {
        self.runtime().block_on(self.requester.status())
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        self.requester.close();
        if let Some(runtime) = self.runtime.take() {
            // This does not wait for calls of the operating system that still block.
            runtime.shutdown_background();
        }
    }
}

/// Sends requests to one device; a clone serves tasks other than the owner of the [`Device`](super::Device).
#[derive(Clone)]
pub(in crate::link) struct Requester {
    pub(super) client: Client,
    pub(super) health: Arc<Health>,
    pub(super) link: Arc<LinkAddress>,
    pub(super) timeouts: Timeouts,
}

impl Requester {
    /// Sends `request` and waits for its answer. `name` names the request in errors.
    pub(super) async fn request<E: Ask>(
        &self,
        name: &'static str,
        timeout: Duration,
        request: &E::Request,
    ) -> Result<E::Response> {
        let link = || self.link.to_string();
        let limit = Limit::new(&self.link, timeout);
        match limit.wait(self.client.send_resp::<E>(request)).await {
            Some(Ok(response)) => Ok(response),
            Some(Err(HostErr::Closed)) => Err(self.lost()),
            Some(Err(HostErr::Wire(error))) => Err(LinkError::Frame {
                link: link(),
                request: name,
                error,
            }),
            Some(Err(HostErr::BadResponse | HostErr::Postcard(_))) => Err(LinkError::Answer {
                link: link(),
                request: name,
            }),
            None => Err(LinkError::NoAnswer {
                link: link(),
                request: name,
                after: timeout,
                timeout: self.timeouts.answer,
            }),
        }
    }

    /// Sends a message that has no answer.
    pub(super) async fn publish<T>(&self, message: &T::Message) -> Result<()>
    where
        T: Topic,
        T::Message: Serialize,
    {
        // A topic has no answer to match.
        let sent = self.client.publish::<T>(0u16.into(), message);
        let limit = Limit::new(&self.link, self.timeouts.answer);
        match limit.wait(sent).await {
            Some(Ok(())) => Ok(()),
            Some(Err(_)) => Err(self.lost()),
            None => Err(LinkError::Stalled {
                link: self.link.to_string(),
                after: self.timeouts.answer,
            }),
        }
    }

    /// An error that says why the link ended.
    pub(super) fn lost(&self) -> LinkError {
        LinkError::Lost {
            link: self.link.to_string(),
            reason: self.health.why_ended().to_owned(),
        }
    }

    /// Closes the link.
    pub(super) fn close(&self) {
        self.client.close();
    }

    /// Number of frames since the link was opened that arrived and could not be decoded.
    pub(super) fn broken_frames(&self) -> u64 {
        self.health.broken_frames()
    }

    /// Reads the status, with all of the device's counters.
    pub(in crate::link) async fn status(&self) -> Result<Status> {
        self.request::<StatusEndpoint>("status", self.timeouts.answer, &())
            .await
    }

    /// Sends a motion and waits for its acknowledgement.
    pub(in crate::link) async fn motion(&self, sample: MotionSample) -> Result<MotionSource> {
        Ok(self
            .request::<MotionEndpoint>("motion", self.timeouts.answer, &sample)
            .await??)
    }
}

/// Longest waits for the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeouts {
    /// Timeout of a request that does not touch the flash.
    pub answer: Duration,
    /// Timeout of a request that may read, erase or write flash.
    pub flash: Duration,
    /// Time that a broken link may take to come back.
    pub reconnect: Duration,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self {
            answer: Duration::from_millis(ANSWER_TIMEOUT_MS.into()),
            flash: Duration::from_millis(FLASH_TIMEOUT_MS.into()),
            reconnect: Duration::from_secs(10),
        }
    }
}

impl Timeouts {
    /// Scales the default timeouts so that the timeout of a request that does not touch the flash is `answer`.
    pub fn scaled_to(answer: Duration) -> Self {
        let default = Self::default();
        let factor = answer.as_secs_f64() / default.answer.as_secs_f64();
        Self {
            answer,
            flash: default.flash.mul_f64(factor),
            reconnect: default.reconnect.mul_f64(factor),
        }
    }
}
