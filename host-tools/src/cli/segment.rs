//! `stylus segment`

use std::path::PathBuf;

use host_tools::recording::freehand;
use host_tools::recording::freehand::{GridAxis, Options};
use host_tools::recording::scale;
use host_tools::support::error::Result;
use host_tools::support::number::counted;

use super::files::Overwrite;
use super::input::{positive, texture_name};
use crate::cli::output::{note, print, warn};

#[derive(clap::Args)]
pub struct Arguments {
    /// Free-hand recordings: CSV with speed_mm_s, force_n, one to three accelerations, and time_s
    #[arg(required = true, value_name = "CSV")]
    files: Vec<PathBuf>,
    /// Name of the texture
    #[arg(long, value_name = "NAME", value_parser = texture_name)]
    texture: String,
    /// Folder for the pieces and their list, as fit reads it
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Speeds of the grid, in mm/s [default: from the recordings]
    #[arg(long, value_name = "LOW:HIGH:STEP")]
    speeds: Option<GridAxis>,
    /// Forces of the grid, in newtons [default: from the recordings]
    #[arg(long, value_name = "LOW:HIGH:STEP")]
    forces: Option<GridAxis>,
    /// Largest deviation of speed and force from the middle of a piece, as a share
    #[arg(long, value_parser = positive, default_value_t = 0.25)]
    tolerance: f64,
    /// Least duration of a piece, in seconds; below 0.4 s, fit gives it the verdict too-short
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 0.4)]
    least: f64,
    /// Least total duration of a node's pieces, in seconds
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 0.5)]
    enough: f64,
    /// Sample rate of the files, in hertz [default: by their column time_s]
    #[arg(long, value_name = "HZ", value_parser = positive)]
    sample_rate: Option<f64>,
    /// Acceleration of a sample of 1, in m/s², or as a unit such as g or g/256 [default: by the header, or 1]
    #[arg(long, visible_alias = "unit", value_name = "M_S2", value_parser = scale)]
    scale: Option<f64>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.overwrite.folder(&arguments.out)?;
    let recordings = arguments
        .files
        .iter()
        .map(|path| freehand::read(path, arguments.sample_rate, arguments.scale))
        .collect::<Result<Vec<_>>>()?;
    let pairs = arguments.files.iter().zip(&recordings);
    for text in pairs.flat_map(|(path, recording)| recording.notes(path)) {
        warn(&text);
    }
    let given = (arguments.speeds, arguments.forces);
    let shortest_s = (arguments.least, arguments.enough);
    let options = Options::of(&recordings, given, arguments.tolerance, shortest_s)?;
    if given.0.is_none() || given.1.is_none() {
        let Options { speeds, forces, .. } = options;
        note(&format!("grid: --speeds {speeds} --forces {forces}"));
    }
    let cut = freehand::segment(&recordings, &options);
    // Before the check, so that what was left out explains a cut without pieces.
    for text in cut.left_out() {
        warn(&text);
    }
    cut.check()?;
    let overwrite = arguments.overwrite.is_asked();
    freehand::write(&arguments.out, &arguments.texture, &recordings, &cut, overwrite)?;
    let mut nodes: Vec<(f64, f64)> = cut.placed.iter().map(|p| (p.speed_mm_s, p.force_n)).collect();
    // The pieces of a node stand together.
    nodes.dedup();
    let origin = if recordings.iter().any(|recording| recording.is_simulated) {
        "; SIMULATED"
    } else {
        ""
    };
    print(&format!(
        "{:.0} % of the motion in contact is steady: {} at {} -> {}{origin}",
        100.0 * cut.steady_share,
        counted(cut.placed.len(), "piece"),
        counted(nodes.len(), "node"),
        arguments.out.display()
    ))
}
