//! A recording without losses.

use host_tools::link::capture::Stream;
use model_format::link::BLOCK_SAMPLES;

use crate::bench::Bench;
use crate::error::{Error, Result};

/// Records for the bench's length.
///
/// # Errors
/// The link fails, or no block arrives.
pub fn check(bench: &mut Bench) -> Result<()> {
    let (blocks, holes, loss) = {
        let mut stream = Stream::start(&bench.device)?;
        let wanted =
            bench.lengths.record_ms * u64::from(stream.rate_hz()) / 1_000 / BLOCK_SAMPLES as u64
                + 1;
        let mut holes = 0;
        for _ in 0..wanted {
            if bench.interrupt.is_raised() {
                return Err(Error::Interrupted);
            }
            holes += u32::from(!stream.wait()?.is_continuous);
        }
        (wanted, holes, stream.stop()?)
    };
    bench.judge(
        "a recording loses nothing",
        format!("{blocks} blocks, {holes} holes; {loss}"),
        "0 lost in the device and on the link, 0 holes",
        loss.is_none() && holes == 0,
    );
    Ok(())
}
