//! Arguments of `stylus record`.

use std::path::PathBuf;

use host_tools::link::set::PlannedTrial;
use host_tools::recording::TRIAL_DURATION_S;
use host_tools::support::error::Result;

use crate::cli::destination::{self, Destination};
use crate::cli::device::connection::Link;
use crate::cli::device::sensing::Sensing;
use crate::cli::input::{not_negative, positive, trial_force, trial_speed};

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder of the recording set; trials that are in it already are not recorded again
    #[arg(value_parser = destination::growing_set())]
    pub folder: Destination,
    /// Name of the texture
    #[arg(long, value_name = "NAME", required_unless_present = "trials")]
    texture: Option<String>,
    /// Tangential speeds, in mm/s
    #[arg(
        long,
        value_name = "MM_S",
        value_delimiter = ',',
        value_parser = trial_speed,
        requires = "forces",
        required_unless_present = "trials"
    )]
    speeds: Vec<f64>,
    /// Normal forces, in newtons; each speed is recorded with each force
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = trial_force, requires = "speeds")]
    forces: Vec<f64>,
    /// List of trials instead: CSV with speed_mm_s, force_n, and texture if there are several
    #[arg(long, value_name = "CSV", conflicts_with_all = ["speeds", "forces"])]
    trials: Option<PathBuf>,
    /// Length of a trial, in seconds
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = TRIAL_DURATION_S)]
    pub seconds: f64,
    /// Time to leave out at the beginning of each trial, in seconds
    #[arg(long, value_name = "S", value_parser = not_negative, default_value_t = 0.5)]
    pub settle: f64,
    /// Record again the trials that are in the folder already
    #[arg(long)]
    pub again: bool,
    /// Begin each trial without asking, and keep every one
    #[arg(long)]
    pub yes: bool,
    #[command(flatten)]
    pub sensing: Sensing,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub link: Link,
}

impl Arguments {
    /// Reads the trials that are asked for, checked.
    pub fn points(&self) -> Result<Vec<PlannedTrial>> {
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
