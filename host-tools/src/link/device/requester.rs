//! Requests and messages over one open link, without a thread that blocks.

use std::sync::Arc;
use std::time::Duration;

use model_format::link::{MotionEndpoint, MotionSample, MotionSource, Status, StatusEndpoint};
use postcard_rpc::host_client::HostErr;
use postcard_rpc::{Endpoint, Topic};
use postcard_schema::Schema;
use serde::{Serialize, de::DeserializeOwned};

use super::timeouts::Timeouts;
use crate::link::error::{LinkError, Result};
use crate::link::health::Health;
use crate::link::open::Client;

/// Sends requests to one device; a clone serves tasks other than the owner of the [`Device`](super::Device).
#[derive(Clone)]
pub(in crate::link) struct Requester {
    pub(super) client: Client,
    pub(super) health: Arc<Health>,
    pub(super) link: Arc<str>,
    pub(super) timeouts: Timeouts,
}

impl Requester {
    /// Sends `request` and waits for its answer. `name` stands for the request in errors.
    pub(super) async fn request<E>(
        &self,
        name: &'static str,
        timeout: Duration,
        request: &E::Request,
    ) -> Result<E::Response>
    where
        E: Endpoint,
        E::Request: Serialize + Schema,
        E::Response: DeserializeOwned + Schema,
    {
        let link = || self.link.to_string();
        let answer = tokio::time::timeout(timeout, self.client.send_resp::<E>(request)).await;
        match answer {
            Ok(Ok(response)) => Ok(response),
            Ok(Err(HostErr::Closed)) => Err(self.lost()),
            Ok(Err(HostErr::Wire(error))) => Err(match self.health.take_refusal(E::REQ_KEY) {
                Some(what) => LinkError::Held { link: link(), what },
                None => LinkError::Frame {
                    link: link(),
                    request: name,
                    error,
                },
            }),
            Ok(Err(HostErr::BadResponse | HostErr::Postcard(_))) => Err(LinkError::Answer {
                link: link(),
                request: name,
            }),
            Err(_) => Err(LinkError::NoAnswer {
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
        match tokio::time::timeout(self.timeouts.answer, sent).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) => Err(self.lost()),
            Err(_) => Err(LinkError::Stalled {
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
        let answer = self.request::<MotionEndpoint>("motion", self.timeouts.answer, &sample);
        Ok(answer.await??)
    }
}
