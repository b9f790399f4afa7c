//! The state of a playback while it lasts: one line that is updated on a terminal, and lines at intervals elsewhere.

use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use model_format::link::{Activity, MuteReason, RecordSample, Status};
use stylus_link::link::Device;
use stylus_link::link::capture::{Calibration, Level, Stream};
use stylus_link::link::play::{Driven, PlayCounts, vibration_m_s2};
use stylus_signals::playing::motion::MotionPath;
use stylus_support::number::counted;
use stylus_support::progress;
use stylus_support::visible::visible_line;

use crate::cli::device::record::LIVE_SAMPLES;
use crate::cli::output::note;

/// Interval between lines if standard error is not a terminal.
const PLAIN_INTERVAL: Duration = Duration::from_secs(2);

/// Number of blocks that are read at once, limited so that motions are not delayed.
const BLOCKS_AT_A_TIME: usize = 16;

/// Display of a playback while it lasts.
pub struct Live<'a> {
    line: ProgressBar,
    shown: Instant,
    motion: Option<&'a MotionPath>,
    sensors: Option<Sensors<'a>>,
}

/// The motion by the sensors, which the status does not contain.
struct Sensors<'a> {
    stream: Stream<'a>,
    calibration: Calibration,
    recent: Vec<RecordSample>,
    /// Largest speed so far, mm/s; `None` before the first samples.
    fastest_mm_s: Option<f64>,
}

impl<'a> Live<'a> {
    /// Begins to show a playback along `motion`, or without one along the motion of the sensors of `device`. The
    /// sensors' speed is not shown if they cannot be read, such as while another link is recording.
    pub fn begin(device: &'a Device, motion: Option<&'a MotionPath>) -> Self {
        let sensors = || {
            let settings = device.settings().ok()?;
            Some(Sensors {
                stream: Stream::start(device).ok()?,
                calibration: Calibration::new(&settings, None),
                recent: Vec::new(),
                fastest_mm_s: None,
            })
        };
        Self {
            line: progress::line("playing; Ctrl-C stops"),
            shown: Instant::now(),
            // Along a given motion, speed and force are known without a recording, which other programs may want.
            sensors: if motion.is_none() { sensors() } else { None },
            motion,
        }
    }

    /// Reads the samples that the sensors have sent, without waiting for more.
    pub fn listen(&mut self) {
        let Some(sensors) = &mut self.sensors else {
            return;
        };
        for _ in 0..BLOCKS_AT_A_TIME {
            match sensors.stream.next(Duration::ZERO) {
                Ok(Some(arrival)) => {
                    let level = sensors.level(&arrival.samples);
                    let fastest_mm_s = sensors.fastest_mm_s.unwrap_or(0.0).max(level.speed_mm_s);
                    sensors.fastest_mm_s = Some(fastest_mm_s);
                    sensors.recent.extend(arrival.samples);
                }
                Ok(None) => break,
                // The next request will report the error.
                Err(_) => return,
            }
        }
        let old = sensors.recent.len().saturating_sub(LIVE_SAMPLES);
        sensors.recent.drain(..old);
    }

    /// Shows the state of the playback.
    pub fn show(&mut self, driven: &Driven, status: &Status, heard: &PlayCounts) {
        let text = format!(
            "{:.1} s: {}{}; {}; {}, {}",
            driven.seconds,
            self.motion_at(driven.seconds, status),
            level(status),
            state(status),
            counted(heard.mutes, "mute"),
            counted(heard.missed_ticks, "missed tick")
        );
        if !self.line.is_hidden() {
            self.line.set_message(visible_line(&text).into_owned());
        } else if self.shown.elapsed() >= PLAIN_INTERVAL {
            self.shown = Instant::now();
            note(&visible_line(&text));
        }
    }

    /// Returns speed and force at `seconds`, in words.
    fn motion_at(&self, seconds: f64, status: &Status) -> String {
        if let Some(motion) = self.motion {
            let (speed, force) = motion.values_at(seconds);
            return format!("{:.1} mm/s, {:.2} N", speed.0, force.0);
        }
        match &self.sensors {
            Some(sensors) if !sensors.recent.is_empty() => {
                let level = sensors.level(&sensors.recent);
                format!("{:.1} mm/s, {:.2} N", level.speed_mm_s, level.force_n)
            }
            _ => format!("{:.2} N", status.levels.force_newton),
        }
    }

    /// Ends the line, and stops reading the sensors. Returns the largest speed that the sensors measured, mm/s.
    pub fn end(self) -> Option<f64> {
        self.line.finish_and_clear();
        self.sensors?.fastest_mm_s
    }
}

impl Sensors<'_> {
    fn level(&self, samples: &[RecordSample]) -> Level {
        Level::of(samples, &self.calibration, f64::from(self.stream.rate_hz()))
    }
}

/// Returns the level at the accelerometer, in words.
fn level(status: &Status) -> String {
    let rms = vibration_m_s2(status);
    if rms == 0.0 {
        return String::new();
    }
    format!(", accelerometer {rms:.3} m/s² RMS")
}

fn state(status: &Status) -> String {
    let output = &status.output;
    match output.activity {
        Activity::Playing { .. } if output.mute.is_empty() => "playing".to_owned(),
        Activity::Playing { .. } => format!("muted: {}", output.mute),
        Activity::Probing => "probing".to_owned(),
        Activity::FadingOut => "fading out".to_owned(),
        Activity::Activating => MuteReason::Changing.to_string(),
        Activity::Idle => "stopped".to_owned(),
    }
}
