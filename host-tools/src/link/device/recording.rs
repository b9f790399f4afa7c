//! Requests of a recording, and its blocks in the order of their arrival.

use std::time::Duration;

use model_format::link::{
    RecordBlock, RecordBlockTopic, RecordStartEndpoint, RecordStarted, RecordStopEndpoint,
    RecordStopped,
};
use postcard_rpc::host_client::{MultiSubRxError, MultiSubscription};

use super::connection::Device;
use crate::link::error::Result;

/// Capacity of the queue of received blocks: half a minute.
const WAITING_BLOCKS: usize = 4096;

impl Device {
    /// Starts a recording, whose blocks are then queued in [`Blocks`].
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub(in crate::link) fn record_start(&self) -> Result<(RecordStarted, Blocks)> {
        self.requester.health.begin();
        let client = &self.requester.client;
        let subscription = self
            .runtime()
            .block_on(client.subscribe_multi::<RecordBlockTopic>(WAITING_BLOCKS))
            .map_err(|_| self.requester.lost())?;
        let mut blocks = Blocks { subscription };
        // Blocks of an earlier recording may still be on the way.
        while blocks.next(self, Duration::ZERO)?.is_some() {}
        let started = self.request::<RecordStartEndpoint>("record start", &())??;
        Ok((started, blocks))
    }

    /// Stops a recording.
    ///
    /// # Errors
    /// No recording under way, a lost link or a missing answer.
    pub fn record_stop(&self) -> Result<RecordStopped> {
        Ok(self.request::<RecordStopEndpoint>("record stop", &())??)
    }
}

/// Queue of the blocks of a recording, in the order of their arrival.
pub(in crate::link) struct Blocks {
    subscription: MultiSubscription<RecordBlock>,
}

impl Blocks {
    /// Returns the next block, or `None` if none arrives within `within`.
    pub(in crate::link) fn next(
        &mut self,
        device: &Device,
        within: Duration,
    ) -> Result<Option<RecordBlock>> {
        let next = async {
            loop {
                match self.subscription.recv().await {
                    Ok(block) => return Ok(block),
                    // The sequence numbers of later blocks show which ones the queue had no room for.
                    Err(MultiSubRxError::Lagged(_)) => {}
                    Err(MultiSubRxError::IoClosed) => return Err(device.requester.lost()),
                }
            }
        };
        let next = async { tokio::time::timeout(within, next).await };
        device.runtime().block_on(next).ok().transpose()
    }
}
