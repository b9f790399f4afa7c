//! `stylus record`

mod report;
mod session;

use std::path::PathBuf;

use model_format::Provenance;
use report::RecordReport;
use session::{Outcome, Session};
use stylus_link::link::Device;
use stylus_link::link::capture::{Calibration, Level};
use stylus_link::procedures::set::{Folder, PlannedTrial};
use stylus_signals::recording::TRIALS_FILE;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use crate::cli::device::Link;
use crate::cli::files::{Overwrite, check_in_growing_folder};
use crate::cli::input::{not_negative, of_axes, positive, trial_force, trial_speed};
use crate::cli::output::{print, print_json, tell};

#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command")]
pub struct Arguments {
    /// Folder of the recording set; trials that are in it already are not recorded again. With --strokes a CSV file
    out: PathBuf,
    /// Record a free hand's strokes instead, with speed and force per sample; Ctrl-C ends and keeps the recording
    #[arg(long, conflicts_with_all = ["texture", "speeds", "forces", "trials", "settle", "again", "yes"])]
    strokes: bool,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Name of the texture
    #[arg(long, value_name = "NAME", required_unless_present_any = ["trials", "strokes"])]
    texture: Option<String>,
    /// Tangential speeds, in mm/s
    #[arg(
        long,
        value_name = "MM_S",
        value_delimiter = ',',
        value_parser = trial_speed,
        requires = "forces",
        required_unless_present_any = ["trials", "strokes"]
    )]
    speeds: Vec<f64>,
    /// Normal forces, in newtons; each speed is recorded with each force
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = trial_force, requires = "speeds")]
    forces: Vec<f64>,
    /// List of trials instead: CSV with speed_mm_s, force_n, and texture if there are several
    #[arg(long, value_name = "CSV", conflicts_with_all = ["speeds", "forces"])]
    trials: Option<PathBuf>,
    /// Length of a trial, in seconds [default: 10; of strokes: 60]
    #[arg(long, value_name = "S", value_parser = positive)]
    seconds: Option<f64>,
    /// Time to leave out at the beginning of each trial, in seconds
    #[arg(long, value_name = "S", value_parser = not_negative, default_value_t = 0.5)]
    settle: f64,
    /// Record again the trials that are in the folder already
    #[arg(long)]
    again: bool,
    /// Begin each trial without asking, and keep every one
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

impl Arguments {
    /// Reads and checks the trials that were requested.
    fn points(&self) -> Result<Vec<PlannedTrial>> {
        let texture = self.texture.as_deref();
        let points = match (&self.trials, texture) {
            (Some(list), texture) => PlannedTrial::from_csv(list, texture)?,
            (None, Some(texture)) => PlannedTrial::grid(texture, &self.speeds, &self.forces),
            (None, None) => Vec::new(),
        };
        points.iter().try_for_each(PlannedTrial::check)?;
        Ok(points)
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.strokes {
        return session::record_strokes(arguments);
    }
    let points = arguments.points()?;
    // `Folder::open` makes a folder that is not there yet. It has no list that could be lost.
    if arguments.out.is_dir() {
        check_in_growing_folder(&arguments.out.join(TRIALS_FILE))?;
    }
    let mut folder = Folder::open(&arguments.out)?;
    folder.check_names(&points)?;
    let (there, todo): (Vec<PlannedTrial>, Vec<PlannedTrial>) = points
        .into_iter()
        .partition(|point| !arguments.again && folder.has(point));
    let session = Session::open(arguments)?;
    tell(&format!(
        "{} to record, {} already in {}",
        counted(todo.len(), "trial"),
        there.len(),
        arguments.out.display()
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
    let report = RecordReport::new(&arguments.out, rows, there.len(), left_out);
    if arguments.json {
        return print_json(&report);
    }
    print(&report.text())
}

/// Number of samples over which a live level is averaged: 0.1 s at 5 kHz.
pub const LIVE_SAMPLES: usize = 500;

/// Formats a level in a few words.
pub fn live(level: &Level) -> String {
    format!("{:7.3} m/s² {:5.1} mm/s", level.rms_m_s2, level.speed_mm_s)
}

/// Calibration and provenance of the stylus's sensors.
#[derive(clap::Args)]
pub struct Sensing {
    /// Scale of the accelerometer in place of the setting, in m/s² per volt: one for all axes, or X,Y,Z
    #[arg(
        long,
        value_name = "M_S2_PER_V",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    scale: Vec<f64>,
    /// Mark the recording as simulated, as is done for a virtual stylus on this computer
    #[arg(long)]
    simulated: bool,
}

impl Sensing {
    /// Returns the calibration by the device's settings, except for scales that were given.
    ///
    /// # Errors
    /// The link failed, the number of scales is neither one nor three, or all scales are zero.
    pub fn calibration(&self, device: &Device) -> Result<Calibration> {
        let calibration = Calibration::new(&device.settings()?, of_axes("--scale", &self.scale)?);
        let mut scales = calibration.m_s2_per_code.iter();
        if scales.all(|scale| scale.abs() <= 0.0) {
            return Err(Error::Request(
                "the accelerometer's scale is zero; set acceleration-per-volt-x, -y, -z, or give --scale".to_owned(),
            ));
        }
        Ok(calibration)
    }

    /// Returns the provenance of a recording by `device`.
    pub fn provenance(&self, device: &Device) -> Provenance {
        if self.simulated || device.address().is_of_an_emulator() {
            Provenance::Simulated
        } else {
            Provenance::Recorded
        }
    }
}
