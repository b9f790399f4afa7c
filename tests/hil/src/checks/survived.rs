//! Faults that the device survives, injected while it plays or records: late ticks and codes, an output that runs out
//! of codes, rows of the converters that are read late, an amplifier that goes off.

use host_tools::link::capture::{Loss, Stream};
use model_format::link::{MotionSource, Status};

use crate::bench::{Bench, is_playing};
use crate::error::{Error, Result};
use crate::injection::{Injected, inject};
use crate::library;

/// Number of times that each fault is injected.
const TIMES: u32 = 3;

/// Time from one fault to the next, ms of the device.
const BETWEEN_MS: u64 = 30;

/// A tick that is late, or whose codes are.
struct Late {
    fault: Injected,
    name: &'static str,
    /// Fewest and most ticks that are missed per fault.
    missed: [u32; 2],
    /// Fewest and most late outputs of all [`TIMES`] faults.
    outputs: [u32; 2],
}

/// Codes are written ahead for more than a tick that takes two periods. A late output is counted where the code before
/// it is not the last one that was written; in a quiet texture they may be the same by chance. With a tick of six
/// periods timer and DMA run into mid-scale without an instruction, which may be the last code, too. So of the outputs
/// that are late one is enough.
const LATE: [Late; 3] = [
    Late {
        fault: Injected::LongTick,
        name: "a tick of two periods",
        missed: [1, 2],
        outputs: [0, 0],
    },
    Late {
        fault: Injected::LateTick,
        name: "a sample that comes 150 µs late",
        missed: [0, 0],
        outputs: [1, TIMES],
    },
    Late {
        fault: Injected::VeryLongTick,
        name: "a tick of six periods, in which the output runs into mid-scale",
        missed: [5, 6],
        outputs: [1, TIMES],
    },
];

/// Number of times that a critical section is injected, and blocks of a recording, of 6.4 ms each, from one to the
/// next.
const SECTIONS: u32 = 5;
const BLOCKS_BETWEEN: u32 = 3;

/// Longest time until the amplifier follows, ms: it is raised after mid-scale has been put out for a while.
const AMPLIFIER_MS: u64 = 1_000;

/// Injects each fault into the fault image.
///
/// # Errors
/// The link fails, or the device does not play or record.
pub fn check(bench: &mut Bench) -> Result<()> {
    late_ticks(bench)?;
    late_rows(bench)?;
    amplifier(bench)
}

fn late_ticks(bench: &mut Bench) -> Result<()> {
    for late in LATE {
        let play = library::cheap();
        let ((before, after), _) = bench.while_playing(&play, MotionSource::Host, |bench| {
            let before = bench.wait_until_heard()?;
            for _ in 0..TIMES {
                inject(bench, late.fault)?;
                bench.wait(BETWEEN_MS)?;
            }
            Ok((before, bench.status()?))
        })?;
        let counted = |count: fn(&Status) -> u32| count(&after).saturating_sub(count(&before));
        let missed = counted(|status| status.tick.missed);
        let outputs = counted(|status| status.tick.late_outputs);
        let resets = counted(|status| status.resets);
        let [fewest, most] = late.missed.map(|missed| missed * TIMES);
        let [first, last] = late.outputs;
        bench.judge(
            &format!("{} is counted, and playing goes on", late.name),
            format!("{missed} missed, {outputs} late outputs, {resets} resets"),
            &format!("{fewest} to {most} missed, {first} to {last} late outputs, 0 resets"),
            (fewest..=most).contains(&missed)
                && (first..=last).contains(&outputs)
                && resets == 0
                && is_playing(&after),
        );
    }
    Ok(())
}

fn late_rows(bench: &mut Bench) -> Result<()> {
    let (late, loss) = with_sections(bench, Injected::ShortSection)?;
    bench.judge(
        "a row that is read 25 µs after its trigger is whole",
        format!(
            "{late} late conversions, {} torn samples",
            loss.torn_samples
        ),
        "0, 0",
        late == 0 && loss.torn_samples == 0,
    );
    let (late, loss) = with_sections(bench, Injected::LongSection)?;
    bench.judge(
        "a row that is read 45 µs after its trigger is marked as torn",
        format!(
            "{late} late conversions, {} torn samples",
            loss.torn_samples
        ),
        &format!("1 to {SECTIONS} torn samples, each counted"),
        (1..=SECTIONS).contains(&loss.torn_samples) && late >= loss.torn_samples,
    );
    Ok(())
}

/// Records while `section` delays ticks. Returns the late conversions that were counted, and the losses.
fn with_sections(bench: &Bench, section: Injected) -> Result<(u32, Loss)> {
    let before = bench.status()?;
    let mut stream = Stream::start(&bench.device)?;
    for block in 0..(SECTIONS + 2) * BLOCKS_BETWEEN {
        if bench.is_interrupted() {
            return Err(Error::Interrupted);
        }
        stream.wait()?;
        if block % BLOCKS_BETWEEN == 0 && block / BLOCKS_BETWEEN < SECTIONS {
            inject(bench, section)?;
        }
    }
    let loss = stream.stop()?;
    let after = bench.status()?;
    let late = after.tick.late_conversions;
    Ok((late.saturating_sub(before.tick.late_conversions), loss))
}

fn amplifier(bench: &mut Bench) -> Result<()> {
    let play = library::cheap();
    let ((off, on), _) = bench.while_playing(&play, MotionSource::Host, |bench| {
        bench.wait_until_heard()?;
        inject(bench, Injected::AmplifierOff)?;
        let off = bench.wait_until("the amplifier stayed on", AMPLIFIER_MS, |status| {
            !status.output.amplifier
        })?;
        inject(bench, Injected::AmplifierOn)?;
        let on = bench.wait_until("the amplifier stayed off", AMPLIFIER_MS, |status| {
            status.output.amplifier
        })?;
        Ok((off, on))
    })?;
    let text = |status: &Status| {
        if is_playing(status) {
            "playing"
        } else {
            "idle"
        }
    };
    bench.judge(
        "the amplifier goes off and on again while it plays",
        format!("{} without it, {} with it", text(&off), text(&on)),
        "playing, playing",
        is_playing(&off) && is_playing(&on),
    );
    Ok(())
}
