//! Upload, stream and play at the same time, without a missed or a late tick.

use std::thread;

use host_tools::link::capture::Stream;
use host_tools::link::play::Driven;
use model_format::link::{LIBRARY_CRC, MotionSource, MuteReason, Status, UploadBegin};

use crate::bench::Bench;
use crate::checks::playing::on_time;
use crate::checks::upload;
use crate::error::{Error, Result};
use crate::library;

/// Outcome of playing, streaming and uploading together.
struct Outcome {
    uploads: u32,
    holes: u32,
    blocks: u32,
    loss: host_tools::link::capture::Loss,
    after: Status,
}

/// Plays the dearest texture along the host's motion, streams a recording and uploads `library` again and again, for
/// the bench's length.
///
/// # Errors
/// The link fails, or the device refuses what it should take.
pub fn check(bench: &mut Bench, bytes: &[u8]) -> Result<()> {
    let before = bench.status()?;
    let (outcome, driven) =
        bench.while_playing(&library::dearest(), MotionSource::Host, |bench| {
            let heard = bench.wait_until_heard()?;
            all_at_once(bench, bytes, &heard)
        })?;
    tell(bench, &before, &outcome, driven);
    Ok(())
}

fn all_at_once(bench: &Bench, bytes: &[u8], begin: &Status) -> Result<Outcome> {
    let end_ms = begin.uptime_ms + bench.lengths.endurance_ms;
    thread::scope(|scope| {
        let uploads = scope.spawn(|| uploads(bench, bytes, end_ms));
        let mut stream = Stream::start(&bench.device)?;
        let (mut holes, mut blocks) = (0, 0);
        let mut streamed = Ok(());
        while !uploads.is_finished() {
            if bench.is_interrupted() {
                streamed = Err(Error::Interrupted);
                break;
            }
            match stream.wait() {
                Ok(block) => {
                    holes += u32::from(!block.is_continuous);
                    blocks += 1;
                }
                Err(error) => {
                    streamed = Err(Error::Link(error));
                    break;
                }
            }
        }
        let uploads = uploads.join();
        streamed?;
        let uploads = uploads.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        let loss = stream.stop()?;
        let after = bench.status()?;
        Ok(Outcome {
            uploads,
            holes,
            blocks,
            loss,
            after,
        })
    })
}

/// Uploads until the device's clock shows `end_ms`, the last upload to its end; at least one.
fn uploads(bench: &Bench, bytes: &[u8], end_ms: u64) -> Result<u32> {
    let announced = UploadBegin {
        length: bytes.len() as u32,
        crc32: LIBRARY_CRC.checksum(bytes),
        replaces_last: false,
    };
    let mut uploads = 0;
    loop {
        let begun = bench.status()?.uptime_ms;
        upload::send(bench, bytes, announced)?;
        uploads += 1;
        let now = bench.status()?.uptime_ms;
        if now >= end_ms {
            return Ok(uploads);
        }
        let next = begun + bench.lengths.between_uploads_ms;
        let pause = next.min(end_ms).saturating_sub(now);
        if pause > 0 && bench.wait(pause)?.uptime_ms >= end_ms {
            return Ok(uploads);
        }
    }
}

fn tell(bench: &mut Bench, before: &Status, outcome: &Outcome, driven: Driven) {
    let after = &outcome.after;
    let lasted = after.uptime_ms.saturating_sub(before.uptime_ms);
    bench.judge(
        "uploads while it plays and streams",
        format!(
            "{} in {:.1} s, {} motions",
            outcome.uploads,
            lasted as f64 / 1e3,
            driven.motions
        ),
        "at least 1",
        outcome.uploads > 0,
    );
    on_time(bench, before, after);
    bench.judge(
        "the stream loses nothing meanwhile",
        format!(
            "{} blocks, {} holes; {}",
            outcome.blocks, outcome.holes, outcome.loss
        ),
        "some, 0 holes, 0 lost",
        outcome.loss.is_none() && outcome.holes == 0 && outcome.blocks > 0,
    );
    let mutes = |status: &Status| {
        let counts = MuteReason::ALL.into_iter().zip(status.output.mute_counts);
        let troubled =
            counts.filter(|(reason, _)| matches!(reason, MuteReason::LinkLost | MuteReason::Fault));
        troubled.map(|(_, count)| count).sum::<u32>()
    };
    let muted = mutes(after).saturating_sub(mutes(before));
    if bench.is_emulated() {
        let reason = "this computer and the emulator do not keep the pace of a host";
        bench.leave_out("the link is not lost meanwhile", reason);
    } else {
        bench.judge(
            "the link is not lost meanwhile",
            muted,
            "0 mutes",
            muted == 0,
        );
    }
    let faults = |status: &Status| {
        [status.usb, status.serial]
            .map(|link| link.malformed + link.oversized + link.line_errors + link.unsent)
            .iter()
            .sum::<u32>()
    };
    let faults = faults(after).saturating_sub(faults(before));
    bench.judge("no frame is lost or damaged", faults, "0", faults == 0);
}
