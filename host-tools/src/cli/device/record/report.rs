//! The report of `stylus record`, with one row per trial.

use std::path::Path;
use stylus_support::number::counted;

use serde::Serialize;
use stylus_fit::fit::Analysis;
use stylus_link::link::capture::{Calibration, Capture, Level, Loss};
use stylus_link::procedures::set::PlannedTrial;

use crate::cli::table::{headed, table};

/// Relative amount by which the measured speed or force may differ from the wanted one. A wanted value below 0.1 counts
/// as 0.1, because otherwise any speed or force would differ from a wanted 0.
const TOLERANCE: f64 = 0.1;

/// Fraction of the wanted speed below which a trial counts as without motion.
const STILL: f64 = 0.02;

/// A recorded trial.
#[derive(Serialize)]
pub struct Row {
    texture: String,
    speed_mm_s: f64,
    force_n: f64,
    /// Mean level over the whole trial.
    level: Level,
    /// True if there was no motion although there should have been.
    #[serde(skip)]
    is_still: bool,
    pub verdicts: Vec<String>,
    loss: Loss,
    /// Number of gaps. Each of them restarted the capture.
    holes: u32,
    /// Number of torn samples in this trial. Their codes are interpolated.
    interpolated: u32,
}

impl Row {
    /// Creates the row of the trial `point`, which was recorded as `capture`.
    pub fn new(point: &PlannedTrial, capture: &Capture, calibration: &Calibration, analysis: &Analysis) -> Self {
        let level = Level::of(&capture.samples, calibration, f64::from(capture.rate_hz));
        Self {
            texture: point.texture.clone(),
            speed_mm_s: point.speed_mm_s,
            force_n: point.force_n,
            is_still: is_still(point, &level),
            verdicts: verdicts(analysis, point, &level),
            level,
            loss: capture.loss,
            holes: capture.holes,
            interpolated: capture.interpolated,
        }
    }

    /// Returns the row as one line of text.
    pub fn line(&self) -> String {
        let holes = if self.holes == 0 {
            String::new()
        } else {
            format!(" (restarted {})", counted(self.holes, "time"))
        };
        let torn = if self.interpolated == 0 {
            String::new()
        } else {
            format!(" ({} interpolated)", counted(self.interpolated, "torn sample"))
        };
        format!(
            "{}: {:.3} m/s² RMS, {:.1} mm/s, {:.2} N; {}{holes}{torn}",
            self.verdict_text(),
            self.level.rms_m_s2,
            self.level.speed_mm_s,
            self.level.force_n,
            self.loss
        )
    }

    fn verdict_text(&self) -> String {
        if self.verdicts.is_empty() {
            "ok".to_owned()
        } else {
            self.verdicts.join("; ")
        }
    }

    fn lost_blocks(&self) -> u64 {
        u64::from(self.loss.in_device) + u64::from(self.loss.on_link)
    }
}

/// The report on a whole session.
#[derive(Serialize)]
pub struct RecordReport {
    folder: String,
    recorded: Vec<Row>,
    already_there: usize,
    left_out: usize,
    lost_blocks: u64,
}

impl RecordReport {
    /// Creates the report on a session that recorded `rows` into `folder`.
    pub fn new(folder: &Path, rows: Vec<Row>, already_there: usize, left_out: usize) -> Self {
        Self {
            folder: folder.display().to_string(),
            lost_blocks: rows.iter().map(Row::lost_blocks).sum(),
            recorded: rows,
            already_there,
            left_out,
        }
    }

    /// Returns the report as a table with a summary.
    pub fn text(&self) -> String {
        let (header, rows) = headed(self.recorded.iter().map(|row| {
            [
                ("trial", row.texture.clone()),
                ("mm/s", row.speed_mm_s.to_string()),
                ("N", row.force_n.to_string()),
                ("RMS m/s²", format!("{:.3}", row.level.rms_m_s2)),
                ("triage", row.verdict_text()),
                ("lost blocks", row.lost_blocks().to_string()),
            ]
        }));
        let summary = format!(
            "{} recorded into {}, {} already there, {} left out; {} lost",
            counted(self.recorded.len(), "trial"),
            self.folder,
            self.already_there,
            self.left_out,
            counted(self.lost_blocks, "block")
        );
        let still = self.recorded.iter().filter(|row| row.is_still);
        let summary = match still.count() {
            0 => summary,
            count => format!("{summary}; {count} without motion: --again records all trials again"),
        };
        if rows.is_empty() {
            return summary;
        }
        format!("{}\n\n{summary}", table(&header, &rows))
    }
}

/// Returns true if there was no motion although there should have been.
fn is_still(point: &PlannedTrial, level: &Level) -> bool {
    point.speed_mm_s > 0.0 && level.speed_mm_s < STILL * point.speed_mm_s
}

/// Returns triage's verdicts on the samples, and verdicts on the operator's speed and force compared with the wanted
/// ones. A trial without motion has a single verdict, because its samples are not of the surface.
fn verdicts(analysis: &Analysis, point: &PlannedTrial, level: &Level) -> Vec<String> {
    if is_still(point, level) {
        let Level {
            speed_mm_s, force_n, ..
        } = level;
        return vec![format!(
            "nothing moved: the sensors say {speed_mm_s:.1} mm/s and {force_n:.2} N; rub the surface, or connect the \
             sensors, and record again"
        )];
    }
    let is_rest = point.speed_mm_s <= 0.0 || point.force_n <= 0.0;
    let mut verdicts: Vec<String> = analysis
        .verdicts
        .iter()
        // At rest or without contact a surface is silent, as it should be.
        .filter(|verdict| !(is_rest && verdict.name() == "silent"))
        .map(ToString::to_string)
        .collect();
    if let Some(line) = analysis.mains_lines.first() {
        verdicts.push(format!("a line {line}; if other speeds have it too, it is hum"));
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
