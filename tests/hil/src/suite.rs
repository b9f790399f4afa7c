//! Order of the tests, and the end that leaves the stylus silent and as it was.

use std::path::PathBuf;

use crate::bench::Bench;
use crate::checks::{
    cycles, endurance, faults, identity, output, playing, record, settings, upload,
};
use crate::error::{Error, Result};
use crate::keep::Kept;
use crate::library::{Played, played};

/// Extent of a run, besides its lengths.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// Leaves out what the image's tests on the emulator hold: recording, endurance, cycles, the pin and faults.
    pub is_brief: bool,
    /// File for the measured cycles.
    pub cycles: Option<PathBuf>,
    /// Library to upload and activate at the end.
    pub library: Option<PathBuf>,
}

/// Runs all tests. The report is in the bench.
///
/// # Errors
/// The device could not be left as it was; everything else is in the report.
pub fn run(bench: &mut Bench, plan: &Plan) -> Result<()> {
    let kept = Kept::save(bench, plan.library.clone())?;
    let played = played();
    let ended = kept
        .make_playable(bench)
        .and_then(|()| subjects(bench, plan, &played));
    bench.report.interrupted = matches!(ended, Err(Error::Interrupted));
    bench.begin("end");
    if let Err(error) = &ended
        && !bench.report.interrupted
    {
        bench.judge("the coil's settings are set", error, "set", false);
    }
    let restored = kept.restore(bench);
    if let Err(error) = &restored {
        bench.judge(
            "silent, settings and library restored",
            error,
            "done",
            false,
        );
    }
    restored
}

/// Runs one subject after the other; a failure is a line of the report. Only an interrupt ends the run.
fn subjects(bench: &mut Bench, plan: &Plan, played: &Played) -> Result<()> {
    let Played { bytes, selections } = played;
    let (_, scene) = selections.last().expect("there are scenes");
    subject(bench, "identity", identity::check)?;
    subject(bench, "settings", settings::check)?;
    subject(bench, "upload", |bench| upload::check(bench, bytes))?;
    subject(bench, "play", |bench| playing::check(bench, scene))?;
    if plan.is_brief {
        return Ok(());
    }
    subject(bench, "record", record::check)?;
    subject(bench, "endurance", |bench| endurance::check(bench, bytes))?;
    subject(bench, "cycles", |bench| {
        let measured = cycles::check(bench, selections)?;
        if let Some(path) = &plan.cycles {
            cycles::write(&measured, path)?;
        }
        Ok(())
    })?;
    subject(bench, "output", output::check)?;
    subject(bench, "faults", faults::check)
}

fn subject(
    bench: &mut Bench,
    name: &'static str,
    check: impl FnOnce(&mut Bench) -> Result<()>,
) -> Result<()> {
    bench.begin(name);
    match check(bench) {
        Ok(()) => Ok(()),
        Err(_) if bench.interrupt.is_raised() => Err(Error::Interrupted),
        Err(error) => {
            bench.judge(
                "goes to its end",
                &error,
                "no failure of link or device",
                false,
            );
            // The next subject may find the link whole again; if not, it says so itself.
            if bench.device.status().is_err() {
                let _ = bench.device.reconnect();
            }
            let _ = bench.device.stop();
            Ok(())
        }
    }
}
