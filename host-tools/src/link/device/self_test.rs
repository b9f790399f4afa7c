//! Requests of the self test.

use std::time::{Duration, Instant};

use model_format::link::{SelfTestEndpoint, SelfTestRequest, SelfTestValues};

use super::connection::Device;
use crate::link::error::Result;

impl Device {
    /// Has the device make one measurement, which takes up to some seconds.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub fn self_test(&self, request: SelfTestRequest) -> Result<SelfTestValues> {
        Ok(self.request_flash::<SelfTestEndpoint>("self test", &request)??)
    }

    /// Duration of a request and its answer.
    ///
    /// # Errors
    /// A lost link or a missing answer.
    pub fn round_trip(&self) -> Result<Duration> {
        let begin = Instant::now();
        self.status()?;
        Ok(begin.elapsed())
    }
}
