//! What `stylus record` records: trials, each until the operator is satisfied, or strokes of a free hand, which
//! `fit --strokes` reads.

use std::io::BufRead;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use model_format::link::RecordSample;
use serde::Serialize;
use stylus_fit::fit;
use stylus_fit::fit::blocks::Part;
use stylus_link::link::Device;
use stylus_link::link::capture::{Calibration, Capture, Level, Loss, capture};
use stylus_link::procedures::set::{Folder, PlannedTrial};
use stylus_link::procedures::strokes;
use stylus_signals::recording::TRIAL_DURATION_S;
use stylus_support::{Error, Result, progress};

use super::Arguments;
use super::report::Row;
use crate::cli::device::record::{LIVE_SAMPLES, live};
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, print_json, tell};

/// How a trial ended.
pub enum Outcome {
    /// Recorded and kept.
    Recorded(Row),
    /// Recorded and kept, and the session ends.
    Last(Row),
    /// Not recorded.
    Skipped,
    /// Not recorded, and the session ends.
    End,
}

/// A connected device, and the operator who moves it.
pub struct Session<'a> {
    arguments: &'a Arguments,
    device: Device,
    calibration: Calibration,
    operator: Operator,
}

impl<'a> Session<'a> {
    /// Connects to the device and begins to listen to the operator.
    pub fn open(arguments: &'a Arguments) -> Result<Self> {
        let device = arguments.link.connect()?;
        let calibration = arguments.sensing.calibration(&device)?;
        Ok(Self {
            arguments,
            device,
            calibration,
            operator: Operator::new(!arguments.yes)?,
        })
    }

    /// Records trial `number` of `of`, as often as the operator wants.
    pub fn trial(&self, folder: &mut Folder, point: &PlannedTrial, (number, of): (usize, usize)) -> Result<Outcome> {
        tell(&format!("[{number}/{of}] {point}"));
        // An earlier recording stays in the folder until another one replaces it.
        let mut earlier = None;
        loop {
            let question = match earlier {
                None => "Enter records, s skips, q ends",
                Some(_) => "Enter records, s keeps the earlier one, q keeps it and ends",
            };
            let captured = match self.operator.ask(question) {
                Answer::Skip => return Ok(earlier.map_or(Outcome::Skipped, Outcome::Recorded)),
                Answer::End => None,
                Answer::Go | Answer::Again => self.capture()?,
            };
            let Some(capture) = captured else {
                return Ok(earlier.map_or(Outcome::End, Outcome::Last));
            };
            let row = self.keep(folder, point, &capture)?;
            tell(&format!("    {}", row.line()));
            // A good trial is kept without a question, so that a session needs one key per trial.
            if row.verdicts.is_empty() {
                return Ok(Outcome::Recorded(row));
            }
            let question = "Enter keeps it, r records it again, q keeps it and ends";
            match self.operator.ask(question) {
                Answer::Again => earlier = Some(row),
                Answer::Go | Answer::Skip => return Ok(Outcome::Recorded(row)),
                Answer::End => return Ok(Outcome::Last(row)),
            }
        }
    }

    /// Captures one trial while the level is shown; `None` if the operator interrupted it.
    fn capture(&self) -> Result<Option<Capture>> {
        let seconds = self.arguments.seconds.unwrap_or(TRIAL_DURATION_S);
        let settle = self.arguments.settle;
        let bar = progress::bar(100, "recording");
        let heard = |samples: &[RecordSample], wanted: usize, rate_hz: u32| {
            let recent = &samples[samples.len().saturating_sub(LIVE_SAMPLES)..];
            let level = Level::of(recent, &self.calibration, f64::from(rate_hz));
            bar.set_message(live(&level));
            bar.set_position((samples.len() * 100 / wanted.max(1)) as u64);
        };
        let goes_on = || !self.operator.has_interrupted();
        let captured = capture(&self.device, seconds, settle, goes_on, heard)?;
        bar.finish_and_clear();
        Ok(captured)
    }

    /// Adds a capture to the folder, and judges it like `fit` would.
    fn keep(&self, folder: &mut Folder, point: &PlannedTrial, capture: &Capture) -> Result<Row> {
        let provenance = self.arguments.sensing.provenance(&self.device);
        let trial = folder.add(point, capture, &self.calibration, provenance)?;
        let (analysis, _) = fit::analyse(&trial, &fit::Options::default(), Part::Whole)?;
        Ok(Row::new(point, capture, &self.calibration, &analysis))
    }
}

/// Interval at which Ctrl-C is checked while waiting for an answer.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// An answer of the operator.
pub enum Answer {
    /// Continue.
    Go,
    /// Skip this trial.
    Skip,
    /// Record this trial again.
    Again,
    /// End the session.
    End,
}

/// The operator at the keyboard.
pub struct Operator {
    interrupt: Interrupt,
    /// Lines of standard input; `None` if no questions are asked.
    lines: Option<Receiver<String>>,
}

impl Operator {
    /// Listens for Ctrl-C, and for answers if `is_asked`.
    pub fn new(is_asked: bool) -> Result<Self> {
        Ok(Self {
            interrupt: Interrupt::listen()?,
            lines: is_asked.then(read_lines),
        })
    }

    /// Returns true once Ctrl-C was pressed.
    pub fn has_interrupted(&self) -> bool {
        self.interrupt.is_raised()
    }

    /// Asks `question` and waits for the answer. Without questions the answer is to continue, until Ctrl-C.
    pub fn ask(&self, question: &str) -> Answer {
        let Some(lines) = &self.lines else {
            return if self.has_interrupted() {
                Answer::End
            } else {
                Answer::Go
            };
        };
        tell(&format!("    {question}"));
        loop {
            if self.has_interrupted() {
                return Answer::End;
            }
            match lines.recv_timeout(POLL_INTERVAL) {
                Ok(line) => match line.trim() {
                    "" | "k" => return Answer::Go,
                    "s" => return Answer::Skip,
                    "r" => return Answer::Again,
                    "q" => return Answer::End,
                    other => tell(&format!("    '{other}'? {question}")),
                },
                Err(RecvTimeoutError::Timeout) => {}
                // The input has ended, so no answer will come.
                Err(RecvTimeoutError::Disconnected) => return Answer::End,
            }
        }
    }
}

/// Reads the lines of standard input in a thread. The channel closes when the input ends.
fn read_lines() -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            let Ok(line) = line else { return };
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

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
pub fn record_strokes(arguments: &Arguments) -> Result<()> {
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
