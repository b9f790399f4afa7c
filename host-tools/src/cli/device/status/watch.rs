//! `stylus status --watch`

use std::time::{Duration, Instant};

use model_format::link::{RecordError, Status};
use serde::Serialize;
use stylus_link::link::capture::{Calibration, Level, Loss, Stream};
use stylus_link::link::{Device, LinkError};
use stylus_support::number::counted;
use stylus_support::progress;
use stylus_support::visible::{visible_json, visible_line};
use stylus_support::{Error, Result};

use super::{Arguments, output};
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, warn};

/// Interval at which Ctrl-C and the duration are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The state at the end of one interval.
#[derive(Serialize)]
struct Reading {
    seconds: f64,
    activity: String,
    ticks: u64,
    missed: u32,
    late_frames: u32,
    /// Level of the sensors; `None` if another program was recording when this command began.
    level: Option<Level>,
}

/// Shows the state until the duration in the arguments has elapsed, or until Ctrl-C.
pub fn run(device: &Device, arguments: &Arguments) -> Result<()> {
    let interrupt = Interrupt::listen()?;
    let calibration = Calibration::new(&device.settings()?, None);
    let mut stream = match Stream::start(device) {
        Ok(stream) => Some(stream),
        Err(LinkError::Record(RecordError::Recording)) => {
            warn("a recording is under way, so only the status is shown");
            None
        }
        Err(failure) => return Err(failure.into()),
    };
    let line = progress::line("watching; Ctrl-C ends");
    let begin = Instant::now();
    let mut shown = 0;
    let is_over = || {
        let over = |seconds| begin.elapsed().as_secs_f64() >= seconds;
        interrupt.is_raised() || arguments.seconds.is_some_and(over)
    };
    while !is_over() {
        shown += 1;
        // Counted from the begin, so that the delays of readings do not add up.
        let until = f64::from(shown) * arguments.interval;
        let level = if let Some(stream) = &mut stream {
            Some(listen(stream, &calibration, begin, until, &is_over)?)
        } else {
            sleep(begin, until, &is_over);
            None
        };
        let reading = Reading::new(begin, &device.status()?, level);
        show(&reading, arguments.json, &line)?;
    }
    line.finish_and_clear();
    match stream.map(Stream::stop).transpose()? {
        Some(loss) => tell(&loss, arguments.json),
        None => Ok(()),
    }
}

/// Receives samples until `until`, s after `begin`, or until `is_over`, and returns their level.
fn listen(
    stream: &mut Stream<'_>,
    calibration: &Calibration,
    begin: Instant,
    until: f64,
    is_over: &impl Fn() -> bool,
) -> Result<Level> {
    let mut samples = Vec::new();
    loop {
        let left = until - begin.elapsed().as_secs_f64();
        if left <= 0.0 || is_over() {
            break;
        }
        let within = Duration::from_secs_f64(left.min(POLL_INTERVAL.as_secs_f64()));
        if let Some(arrival) = stream.next(within)? {
            samples.extend(arrival.samples);
        }
    }
    Ok(Level::of(&samples, calibration, f64::from(stream.rate_hz())))
}

fn sleep(begin: Instant, until: f64, is_over: &impl Fn() -> bool) {
    while begin.elapsed().as_secs_f64() < until && !is_over() {
        std::thread::sleep(POLL_INTERVAL);
    }
}

impl Reading {
    fn new(begin: Instant, status: &Status, level: Option<Level>) -> Self {
        Self {
            seconds: begin.elapsed().as_secs_f64(),
            activity: output(&status.output),
            ticks: status.tick.ticks,
            missed: status.tick.missed,
            late_frames: status.tick.late_frames,
            level,
        }
    }

    fn text(&self) -> String {
        let level = self.level.map_or(String::new(), |level| {
            format!(
                ", {:7.3} m/s² RMS, peak {:3.0} % of range, {:6.1} mm/s, {:5.2} N",
                level.rms_m_s2,
                level.peak_of_range * 100.0,
                level.speed_mm_s,
                level.force_n
            )
        });
        format!(
            "{:8.1} s{level}; {}; {}",
            self.seconds,
            self.activity,
            counted(self.missed, "missed tick")
        )
    }
}

/// Shows a reading: on a terminal in one line that is updated, otherwise in a new line.
fn show(reading: &Reading, json: bool, line: &indicatif::ProgressBar) -> Result<()> {
    if json {
        // In one line, so that a script can read it as soon as it comes.
        let text = serde_json::to_string(reading).map_err(|failure| Error::Request(failure.to_string()))?;
        print(&visible_json(&text))
    } else if line.is_hidden() {
        print(&reading.text())
    } else {
        line.set_message(visible_line(&reading.text()).into_owned());
        Ok(())
    }
}

fn tell(loss: &Loss, json: bool) -> Result<()> {
    if json || loss.is_none() {
        return Ok(());
    }
    print(&format!("{loss}"))
}
