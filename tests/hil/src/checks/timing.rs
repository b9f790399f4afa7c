//! Subjects on whether the tick is on time: cycles of the tick and of the update for every texture and scene of the
//! suite, by the device's own cycle counter; and upload, stream and playback at the same time, without a missed or late
//! tick.

use std::panic::resume_unwind;
use std::thread;
use std::time::Duration;

use model_format::SAMPLE_RATE_HZ;
use model_format::link::{CycleReport, LIBRARY_CRC, MotionSource, MuteReason, Selection, Status, UploadBegin};
use stylus_link::link::capture::Stream;
use stylus_link::procedures::self_test::judge::{self, Traffic};

use crate::bench::DeviceUnderTest;
use crate::checks::playing::count;
use crate::library;
use crate::report::{Error, Result};

/// Plays the most expensive texture along the host's motion, streams a recording and uploads `library` again and again,
/// for the length that the bench sets.
pub fn check_endurance(bench: &mut DeviceUnderTest, library: &[u8]) -> Result<()> {
    let (traffic, driven) = bench.while_playing(&library::dearest(), MotionSource::Host, |bench| {
        let heard = bench.wait_until_heard()?;
        all_at_once(bench, library, heard)
    })?;
    let uploads = traffic.round_trips.len();
    bench.judge(
        "uploads while it plays and streams",
        format!("{uploads}, {} motions", driven.motions),
        "at least 1",
        uploads > 0,
    );
    let mutes = |status: &Status| count(status, MuteReason::LinkLost) + count(status, MuteReason::Fault);
    let muted = mutes(&traffic.after).saturating_sub(mutes(&traffic.before));
    let name = "the link is not lost meanwhile";
    if bench.is_emulated() {
        let reason = "this computer and the emulator do not keep the pace of a host";
        bench.leave_out(name, reason);
    } else {
        bench.judge(name, muted.to_string(), "0 mutes", muted == 0);
    }
    bench.add_all(judge::traffic("meanwhile", &traffic));
    Ok(())
}

/// Returns the traffic since the status `before`, with one round trip per upload.
fn all_at_once(bench: &DeviceUnderTest, library: &[u8], before: Status) -> Result<Traffic> {
    let end_ms = before.uptime_ms + bench.lengths.endurance_ms;
    thread::scope(|scope| {
        let uploads = scope.spawn(|| uploads(bench, library, end_ms));
        let mut stream = Stream::start(&bench.device)?;
        let mut streamed = Ok(());
        while streamed.is_ok() && !uploads.is_finished() {
            streamed = match stream.wait() {
                _ if bench.is_interrupted() => Err(Error::Interrupted),
                block => block.map(drop).map_err(Error::Link),
            };
        }
        let uploads = uploads.join();
        streamed?;
        Ok(Traffic {
            before,
            round_trips: uploads.unwrap_or_else(|panic| resume_unwind(panic))?,
            loss: stream.stop()?,
            after: bench.status()?,
        })
    })
}

/// Uploads at least once, and again until the device's clock shows `end_ms`; the last upload is completed. Returns one
/// round trip per upload.
fn uploads(bench: &DeviceUnderTest, library: &[u8], end_ms: u64) -> Result<Vec<Duration>> {
    let announced = UploadBegin {
        length: library.len() as u32,
        crc32: LIBRARY_CRC.checksum(library),
        replaces_last: false,
    };
    let mut round_trips = Vec::new();
    loop {
        let begun = bench.status()?.uptime_ms;
        let begin = bench.device.upload_begin(announced)?.next_offset;
        bench.device.upload_chunks(library, begin, |_| ())?;
        bench.device.upload_commit()?;
        round_trips.push(bench.device.round_trip()?);
        let now = bench.status()?.uptime_ms;
        let next = begun + bench.lengths.between_uploads_ms;
        let pause = next.min(end_ms).saturating_sub(now);
        if now >= end_ms || pause > 0 && bench.wait(pause)?.uptime_ms >= end_ms {
            return Ok(round_trips);
        }
    }
}

/// Time for which a selection plays before it is measured, ms of the device.
const RUN_UP_MS: u64 = 200;

/// Ticks from the request for an update to the block that the update decides (`stylus_app::UPDATE_LEAD_TICKS`).
const UPDATE_TICKS: u32 = 3;

/// Measures the idle device, and the device while it plays each of `selections`.
pub fn check_cycles(bench: &mut DeviceUnderTest, selections: &[(String, Selection)]) -> Result<()> {
    bench.device.take_cycles()?;
    bench.wait(bench.lengths.play_ms)?;
    let idle = bench.device.take_cycles()?;
    tell(bench, "idle", &idle);
    for (what, selection) in selections {
        let length = bench.lengths.play_ms;
        let measured = bench.while_playing(selection, MotionSource::Host, |bench| {
            bench.wait_until_heard()?;
            bench.wait(RUN_UP_MS)?;
            bench.device.take_cycles()?;
            bench.wait(length)?;
            Ok(bench.device.take_cycles()?)
        });
        let (report, _) = measured?;
        tell(bench, what, &report);
    }
    Ok(())
}

/// Adds a line: the tick must end within its period, and the update before its block begins.
fn tell(bench: &mut DeviceUnderTest, what: &str, report: &CycleReport) {
    let CycleReport { core_hz, tick, update } = report;
    let tick_cycles = core_hz / SAMPLE_RATE_HZ;
    let update_cycles = tick_cycles * UPDATE_TICKS;
    bench.judge(
        what,
        format!(
            "tick {} to {}, update {} to {} cycles{}",
            tick.shortest,
            tick.longest,
            update.shortest,
            update.longest,
            if bench.is_emulated() { ", emulated" } else { "" }
        ),
        format!("tick {tick_cycles}, update {update_cycles}"),
        tick.runs > 0 && update.runs > 0 && tick.longest < tick_cycles && update.longest < update_cycles,
    );
}
