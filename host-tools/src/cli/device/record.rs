//! `stylus record`

use std::io::BufRead;
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use host_tools::fit::{self, Analysis};
use host_tools::link::Device;
use host_tools::link::capture::{Calibration, Capture, Level, Loss, capture};
use host_tools::link::set::{Folder, PlannedTrial};
use host_tools::recording::TRIAL_DURATION_S;
use host_tools::support::error::Result;
use host_tools::support::progress;
use model_format::limits::MAX_ORDER;
use model_format::link::RecordSample;
use serde::Serialize;

use super::connection::Link;
use super::interrupt::Interrupt;
use super::sensing::Sensing;
use crate::cli::input::{not_negative, positive};
use crate::cli::output::{print, print_json};
use crate::cli::table::table;

/// How often the wish to end is looked for.
const PATIENCE: Duration = Duration::from_millis(50);

/// Samples that the live level is of: a tenth of a second.
pub(super) const LIVE_SAMPLES: usize = 500;

/// By how much the measured speed or force may differ from the wanted one.
const TOLERANCE: f64 = 0.1;

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder of the recording set; trials that are in it already are not recorded again
    folder: PathBuf,
    /// What is recorded
    #[arg(long, value_name = "NAME", required_unless_present = "trials")]
    texture: Option<String>,
    /// Tangential speeds, in mm/s
    #[arg(long, value_name = "MM_S", value_delimiter = ',', value_parser = not_negative, requires = "forces", required_unless_present = "trials")]
    speeds: Vec<f64>,
    /// Normal forces, in newtons; each speed is recorded with each force
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = not_negative, requires = "speeds")]
    forces: Vec<f64>,
    /// A list instead: CSV with speed_mm_s, force_n, and texture if there are several
    #[arg(long, value_name = "CSV", conflicts_with_all = ["speeds", "forces"])]
    trials: Option<PathBuf>,
    /// Length of a trial, in seconds
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = TRIAL_DURATION_S)]
    seconds: f64,
    /// Leave out so much at a trial's beginning, in seconds
    #[arg(long, value_name = "S", value_parser = not_negative, default_value_t = 0.5)]
    settle: f64,
    /// Record again what is in the folder already
    #[arg(long)]
    again: bool,
    /// Begin each trial without asking, and keep whatever comes
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    sensing: Sensing,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

/// What became of a trial.
#[derive(Serialize)]
struct Row {
    texture: String,
    speed_mm_s: f64,
    force_n: f64,
    /// Of the whole trial.
    level: Level,
    verdicts: Vec<String>,
    loss: Loss,
    /// How often a hole made it begin anew.
    holes: u32,
}

#[derive(Serialize)]
struct Report {
    folder: String,
    recorded: Vec<Row>,
    already_there: usize,
    left_out: usize,
    lost_blocks: u64,
}

/// What the person at the keyboard wants.
enum Answer {
    Go,
    Skip,
    Again,
    End,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let points = points(arguments)?;
    let mut folder = Folder::open(&arguments.folder)?;
    let (there, todo): (Vec<PlannedTrial>, Vec<PlannedTrial>) = points
        .into_iter()
        .partition(|point| !arguments.again && folder.has(point));
    let session = Session::open(arguments)?;
    say(&format!(
        "{} trial(s) to record, {} already in {}",
        todo.len(),
        there.len(),
        arguments.folder.display()
    ));
    let mut rows = Vec::new();
    for (index, point) in todo.iter().enumerate() {
        match session.trial(&mut folder, point, (index + 1, todo.len()))? {
            Outcome::Recorded(row) => rows.push(row),
            Outcome::Last(row) => {
                rows.push(row);
                break;
            }
            Outcome::Skipped => {}
            Outcome::End => break,
        }
    }
    let left_out = todo.len() - rows.len();
    let report = Report {
        folder: arguments.folder.display().to_string(),
        lost_blocks: rows
            .iter()
            .map(|row| u64::from(row.loss.in_device) + u64::from(row.loss.on_link))
            .sum(),
        recorded: rows,
        already_there: there.len(),
        left_out,
    };
    if arguments.json {
        return print_json(&report);
    }
    print(&text(&report))
}

fn points(arguments: &Arguments) -> Result<Vec<PlannedTrial>> {
    let texture = arguments.texture.as_deref();
    let points = match (&arguments.trials, texture) {
        (Some(list), texture) => PlannedTrial::from_csv(list, texture)?,
        (None, Some(texture)) => PlannedTrial::grid(texture, &arguments.speeds, &arguments.forces),
        (None, None) => Vec::new(),
    };
    points.iter().try_for_each(PlannedTrial::check)?;
    Ok(points)
}

enum Outcome {
    Recorded(Row),
    /// Recorded, and enough for now.
    Last(Row),
    Skipped,
    End,
}

struct Session<'a> {
    arguments: &'a Arguments,
    device: Device,
    calibration: Calibration,
    interrupt: Interrupt,
    answers: Option<Receiver<String>>,
}

impl<'a> Session<'a> {
    fn open(arguments: &'a Arguments) -> Result<Self> {
        let device = arguments.link.connect()?;
        let calibration = arguments.sensing.calibration(&device)?;
        Ok(Self {
            arguments,
            device,
            calibration,
            interrupt: Interrupt::listen()?,
            answers: (!arguments.yes).then(read_lines),
        })
    }

    /// One trial, as often as the person wants.
    fn trial(
        &self,
        folder: &mut Folder,
        point: &PlannedTrial,
        (number, of): (usize, usize),
    ) -> Result<Outcome> {
        say(&format!("[{number}/{of}] {point}"));
        loop {
            match self.ask("Enter records, s skips, q ends") {
                Answer::Skip => return Ok(Outcome::Skipped),
                Answer::End => return Ok(Outcome::End),
                Answer::Go | Answer::Again => {}
            }
            let Some(capture) = self.capture()? else {
                return Ok(Outcome::End);
            };
            let row = self.keep(folder, point, &capture)?;
            say(&format!("    {}", line(&row)));
            if row.verdicts.is_empty() {
                return Ok(Outcome::Recorded(row));
            }
            match self.ask("Enter keeps it, r records it again, q keeps it and ends") {
                Answer::Again => {}
                Answer::Go | Answer::Skip => return Ok(Outcome::Recorded(row)),
                Answer::End => return Ok(Outcome::Last(row)),
            }
        }
    }

    /// What the person answers; to go on, if nobody is to be asked.
    fn ask(&self, question: &str) -> Answer {
        let Some(answers) = &self.answers else {
            return if self.interrupt.is_raised() {
                Answer::End
            } else {
                Answer::Go
            };
        };
        say(&format!("    {question}"));
        loop {
            if self.interrupt.is_raised() {
                return Answer::End;
            }
            match answers.recv_timeout(PATIENCE) {
                Ok(answer) => match answer.trim() {
                    "" | "k" => return Answer::Go,
                    "s" => return Answer::Skip,
                    "r" => return Answer::Again,
                    "q" => return Answer::End,
                    other => say(&format!("    '{other}'? {question}")),
                },
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Answer::End,
            }
        }
    }

    fn capture(&self) -> Result<Option<Capture>> {
        let (seconds, settle) = (self.arguments.seconds, self.arguments.settle);
        let bar = progress::bar(100, "recording");
        let heard = |samples: &[RecordSample], wanted: usize, rate_hz: u32| {
            let recent = &samples[samples.len().saturating_sub(LIVE_SAMPLES)..];
            let level = Level::of(recent, &self.calibration, f64::from(rate_hz));
            bar.set_message(live(&level));
            bar.set_position((samples.len() * 100 / wanted.max(1)) as u64);
        };
        let goes_on = || !self.interrupt.is_raised();
        let captured = capture(&self.device, seconds, settle, goes_on, heard)?;
        bar.finish_and_clear();
        Ok(captured)
    }

    fn keep(&self, folder: &mut Folder, point: &PlannedTrial, capture: &Capture) -> Result<Row> {
        let provenance = self.arguments.sensing.provenance();
        let trial = folder.add(point, capture, &self.calibration, provenance)?;
        let analysis = fit::analyse(&trial, &fit::Options::default(), MAX_ORDER)?;
        let rate_hz = f64::from(capture.rate_hz);
        let level = Level::of(&capture.samples, &self.calibration, rate_hz);
        Ok(Row {
            texture: point.texture.clone(),
            speed_mm_s: point.speed_mm_s,
            force_n: point.force_n,
            verdicts: verdicts(&analysis, point, &level),
            level,
            loss: capture.loss,
            holes: capture.holes,
        })
    }
}

/// For the person, beside the report.
fn say(text: &str) {
    eprintln!("{text}");
}

/// What triage finds, and whether the hand did what it should.
fn verdicts(analysis: &Analysis, point: &PlannedTrial, level: &Level) -> Vec<String> {
    let is_rest = point.speed_mm_s <= 0.0 || point.force_n <= 0.0;
    let triage = analysis.verdicts.iter();
    let mut verdicts: Vec<String> = triage
        .filter(|verdict| !(is_rest && verdict.name() == "silent"))
        .map(ToString::to_string)
        .collect();
    if let Some(frequency_hz) = analysis.mains_line_hz {
        verdicts.push(format!(
            "a line at {frequency_hz:.1} Hz: hum if other speeds have it, too"
        ));
    }
    for (name, wanted, found, unit) in [
        ("speed", point.speed_mm_s, level.speed_mm_s, "mm/s"),
        ("force", point.force_n, level.force_n, "N"),
    ] {
        if (found - wanted).abs() > TOLERANCE * wanted.max(TOLERANCE) {
            verdicts.push(format!("{name} {found:.2} instead of {wanted} {unit}"));
        }
    }
    verdicts
}

/// The lines of standard input; its end ends the channel.
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

pub(super) fn live(level: &Level) -> String {
    format!("{:7.3} m/s² {:5.1} mm/s", level.rms_m_s2, level.speed_mm_s)
}

fn line(row: &Row) -> String {
    let found = if row.verdicts.is_empty() {
        "ok".to_owned()
    } else {
        row.verdicts.join("; ")
    };
    let holes = if row.holes == 0 {
        String::new()
    } else {
        format!(" (begun anew {} time(s))", row.holes)
    };
    format!(
        "{found}: {:.3} m/s² RMS, {:.1} mm/s, {:.2} N; {}{holes}",
        row.level.rms_m_s2, row.level.speed_mm_s, row.level.force_n, row.loss
    )
}

fn text(report: &Report) -> String {
    let header = ["trial", "mm/s", "N", "RMS m/s²", "triage", "lost blocks"];
    let rows: Vec<Vec<String>> = report
        .recorded
        .iter()
        .map(|row| {
            vec![
                row.texture.clone(),
                row.speed_mm_s.to_string(),
                row.force_n.to_string(),
                format!("{:.3}", row.level.rms_m_s2),
                if row.verdicts.is_empty() {
                    "ok".to_owned()
                } else {
                    row.verdicts.join("; ")
                },
                (row.loss.in_device + row.loss.on_link).to_string(),
            ]
        })
        .collect();
    let summary = format!(
        "{} trial(s) recorded into {}, {} were there, {} left; {} block(s) lost",
        report.recorded.len(),
        report.folder,
        report.already_there,
        report.left_out,
        report.lost_blocks
    );
    if rows.is_empty() {
        return summary;
    }
    format!("{}\n\n{summary}", table(&header, &rows))
}
