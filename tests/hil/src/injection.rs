//! Faults on request, which the fault image alone takes, by their numbers in `firmware/realtime/src/injection.rs`.

use postcard_rpc::{TopicDirection, topics};

use crate::bench::Bench;
use crate::error::Result;

topics! {
    list = INJECTION;
    direction = TopicDirection::ToServer;
    | TopicTy    | MessageTy | Path                     |
    | -------    | --------- | ----                     |
    | FaultTopic | u8        | "stylus/fault-injection" |
}

/// Requests the fault `number`. The product's image counts the request as malformed.
///
/// # Errors
/// The link fails.
pub fn inject(bench: &Bench, number: u8) -> Result<()> {
    Ok(bench.device.publish::<FaultTopic>(&number)?)
}
