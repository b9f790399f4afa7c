//! Times after which the host gives up waiting.

use std::time::Duration;

use model_format::link::{ANSWER_TIMEOUT_MS, FLASH_TIMEOUT_MS};

/// Longest waits for the device, each from the start of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeouts {
    /// Timeout of a request that does not touch the flash.
    pub answer: Duration,
    /// Timeout of a request that may erase or write flash.
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
    /// Timeouts in the proportion of the default ones, with `answer` for a request that does not touch the flash.
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
