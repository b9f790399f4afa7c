//! `stylus record`

mod report;
mod session;
mod strokes;

use std::path::PathBuf;

use host_tools::link::set::{Folder, PlannedTrial};
use host_tools::support::error::Result;

use report::RecordReport;
use session::{Outcome, Session, say};

use crate::cli::device::connection::Link;
use crate::cli::device::sensing::Sensing;
use crate::cli::input::{not_negative, positive, trial_force, trial_speed};
use crate::cli::output::{print, print_json};
use crate::cli::overwrite::Overwrite;

#[derive(clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command"
)]
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
    /// Reads the trials that are asked for, checked.
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
        return strokes::run(arguments);
    }
    let points = arguments.points()?;
    let mut folder = Folder::open(&arguments.out)?;
    folder.check_names(&points)?;
    let (there, todo): (Vec<PlannedTrial>, Vec<PlannedTrial>) = points
        .into_iter()
        .partition(|point| !arguments.again && folder.has(point));
    let session = Session::open(arguments)?;
    say(&format!(
        "{} trial(s) to record, {} already in {}",
        todo.len(),
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
