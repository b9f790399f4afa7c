//! `stylus record --strokes`: strokes of a free hand, which `fit --strokes` reads.

use model_format::link::RecordSample;
use serde::Serialize;
use stylus_link::link::capture::{Level, Loss};
use stylus_link::procedures::strokes;
use stylus_support::progress;
use stylus_support::{Error, Result};

use super::Arguments;
use crate::cli::device::record::{LIVE_SAMPLES, live};
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, print_json};

/// Duration of a recording, unless Ctrl-C ends it earlier, s.
const DURATION_S: f64 = 60.0;

#[derive(Serialize)]
struct StrokesReport {
    file: String,
    seconds: f64,
    level: Level,
    loss: Loss,
    /// Number of lost samples, which are gaps in the file.
    lost_samples: usize,
}

/// Records until Ctrl-C or until the duration has elapsed, and keeps the recording.
pub fn run(arguments: &Arguments) -> Result<()> {
    let file = &arguments.out;
    arguments.overwrite.file(file)?;
    let device = arguments.link.connect()?;
    let calibration = arguments.sensing.calibration(&device)?;
    let interrupt = Interrupt::listen()?;
    let bar = progress::bar(100, "recording; Ctrl-C ends it");
    let heard = |samples: &[Option<RecordSample>], wanted: usize, rate_hz: u32| {
        // The newest ones, in their order. Those that were lost count as time.
        let recent: Vec<RecordSample> = samples
            .iter()
            .rev()
            .take(LIVE_SAMPLES)
            .rev()
            .flatten()
            .copied()
            .collect();
        let level = Level::of(&recent, &calibration, f64::from(rate_hz));
        bar.set_message(live(&level));
        bar.set_position((samples.len() * 100 / wanted) as u64);
    };
    let seconds = arguments.seconds.unwrap_or(DURATION_S);
    let goes_on = || !interrupt.is_raised();
    let strokes = strokes::record(&device, seconds, goes_on, heard)?;
    bar.finish_and_clear();
    if strokes.samples.is_empty() {
        return Err(Error::Request("nothing was recorded".to_owned()));
    }
    let provenance = arguments.sensing.provenance(&device);
    strokes.write(file, &calibration, provenance)?;
    let there: Vec<RecordSample> = strokes.samples.iter().flatten().copied().collect();
    let rate_hz = f64::from(strokes.rate_hz);
    let report = StrokesReport {
        file: file.display().to_string(),
        seconds: strokes.samples.len() as f64 / rate_hz,
        level: Level::of(&there, &calibration, rate_hz),
        lost_samples: strokes.samples.len() - there.len(),
        loss: strokes.loss,
    };
    if arguments.json {
        return print_json(&report);
    }
    print(&format!(
        "{:.1} s of {:.3} m/s² RMS -> {}; {}",
        report.seconds, report.level.rms_m_s2, report.file, report.loss
    ))
}
