//! Faults of a device and its link, injected on purpose.

use std::time::Duration;

use model_format::link::DeviceInfo;

/// Faults that hold from the moment when they are set.
#[derive(Clone, Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a fault of its own, and any may come together"
)]
pub struct Faults {
    /// Change of what the device says about itself.
    pub disguise: Option<fn(&mut DeviceInfo)>,
    /// Number of frames after which the connection is closed, before the answer to the last; counted anew per
    /// connection.
    pub close_every: Option<usize>,
    /// No answer at all.
    pub silent: bool,
    /// Delay of every answer.
    pub late: Duration,
    /// Number of answers of which the last one is damaged on its way.
    pub corrupt_every: Option<usize>,
    /// Number of blocks of a recording of which the last one is lost on its way.
    pub lose_block_every: Option<usize>,
    /// Refusal of every request that needs the flash, as of a device that is busy with others.
    pub busy: bool,
    /// No loss of the link is ever noticed, so that the output goes on without a host.
    pub ignores_lost_link: bool,
    /// One tick of each millisecond counts as missed.
    pub misses_ticks: bool,
    /// The codes of one tick of each millisecond count as too late at the output.
    pub puts_out_late: bool,
    /// Cycles that every tick takes besides its own.
    pub slower_by: u32,
    /// Bytes that are no frame, before every answer.
    pub noise: bool,
}
