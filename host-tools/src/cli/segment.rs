//! `stylus segment`

use std::path::PathBuf;

use host_tools::recording::freehand;
use host_tools::recording::freehand::{Freehand, GridAxis, Options, Segmentation, Tolerance};
use host_tools::support::error::{Error, Result};

use super::files::Overwrite;
use super::input::positive;
use crate::cli::output::{note, print, warn};

/// Number of pieces off the grid that are shown one by one.
const SHOWN: usize = 10;

/// Share of the motion below which it is worth a word how little is steady.
const LITTLE: f64 = 0.5;

#[derive(clap::Args)]
pub struct Arguments {
    /// Free-hand recordings: CSV with speed_mm_s, force_n, one to three accelerations, and time_s
    #[arg(required = true, value_name = "CSV")]
    files: Vec<PathBuf>,
    /// Name of the texture
    #[arg(long, value_name = "NAME")]
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
    /// Least duration of a piece, in seconds; a fit finds shorter ones than 0.4 s too short
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 0.4)]
    least: f64,
    /// Least total duration of a node's pieces, in seconds
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 0.5)]
    enough: f64,
    /// Sample rate of files without a column time_s, in hertz
    #[arg(long, value_name = "HZ", value_parser = positive)]
    sample_rate: Option<f64>,
    /// Acceleration of a sample of 1, in m/s²
    #[arg(long, value_name = "M_S2", value_parser = positive, default_value_t = 1.0)]
    scale: f64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    (arguments.overwrite).folder(&arguments.out, &arguments.files)?;
    let recordings = arguments
        .files
        .iter()
        .map(|path| freehand::read(path, arguments.sample_rate, arguments.scale))
        .collect::<Result<Vec<_>>>()?;
    for (path, recording) in arguments.files.iter().zip(&recordings) {
        for outlier in &recording.outliers {
            warn(&format!(
                "{}, line {}: {} is {}, which is out of range; cut out",
                path.display(),
                outlier.line,
                outlier.column,
                outlier.value
            ));
        }
        let more = recording.is_outlier.iter().filter(|bad| **bad).count();
        if more > recording.outliers.len() {
            warn(&format!(
                "{}: {more} samples in total are out of range",
                path.display()
            ));
        }
    }
    let (speeds, forces) = grid(arguments, &recordings)?;
    // At the lowest speeds and forces a share is too strict; a quarter of the grid's step counts as steady there.
    let tolerance = |axis: &GridAxis| Tolerance {
        share: arguments.tolerance,
        least: 0.25 * axis.step,
    };
    let options = Options {
        speed: tolerance(&speeds),
        force: tolerance(&forces),
        least_s: arguments.least,
        enough_s: arguments.enough,
        speeds,
        forces,
    };
    let cut = freehand::segment(&recordings, &options);
    show_what_is_left_out(&cut);
    if cut.placed.is_empty() {
        return Err(Error::Request(
            "no piece is steady for long enough on this grid; record longer strokes, or give a wider --tolerance, \
             a shorter --least or --enough, or another grid"
                .into(),
        ));
    }
    if cut.steady_share < LITTLE {
        note(
            "more than half of the motion is left out: a wider --tolerance keeps more, and evaluate --strokes tells \
             which comes nearer",
        );
    }
    let overwrite = arguments.overwrite.is_asked();
    freehand::write(
        &arguments.out,
        &arguments.texture,
        &recordings,
        &cut,
        overwrite,
    )?;
    let mut nodes: Vec<(f64, f64)> = cut
        .placed
        .iter()
        .map(|p| (p.speed_mm_s, p.force_n))
        .collect();
    nodes.dedup();
    let origin = if recordings.iter().any(|recording| recording.is_simulated) {
        "; SIMULATED"
    } else {
        ""
    };
    print(&format!(
        "{:.0} % of the motion in contact is steady: {} pieces at {} nodes -> {}{origin}",
        100.0 * cut.steady_share,
        cut.placed.len(),
        nodes.len(),
        arguments.out.display()
    ))
}

/// The grid that is given, or proposed from the recordings, which is said.
fn grid(arguments: &Arguments, recordings: &[Freehand]) -> Result<(GridAxis, GridAxis)> {
    if let (Some(speeds), Some(forces)) = (arguments.speeds, arguments.forces) {
        return Ok((speeds, forces));
    }
    let (speeds, forces) = freehand::proposed_grid(recordings).ok_or_else(|| {
        Error::Request(
            "no motion in contact, so that no grid can be proposed and no piece is steady; check the columns \
             speed_mm_s and force_n, or give --speeds and --forces"
                .into(),
        )
    })?;
    let (speeds, forces) = (
        arguments.speeds.unwrap_or(speeds),
        arguments.forces.unwrap_or(forces),
    );
    note(&format!("grid: --speeds {speeds} --forces {forces}"));
    Ok((speeds, forces))
}

fn show_what_is_left_out(cut: &Segmentation) {
    if cut.reversals > 0 {
        warn(&format!(
            "the speed changes its sign {} times; pieces end there, and both directions count alike",
            cut.reversals
        ));
    }
    if let Some((recording, time_s)) = cut.jumps.first() {
        warn(&format!(
            "the speed jumps in {} block(s) of 20 ms, first at {time_s:.2} s of recording {}; cut out (check \
             the encoder)",
            cut.jumps.len(),
            recording + 1
        ));
    }
    for (speed, force, seconds) in &cut.too_little {
        warn(&format!(
            "{speed} mm/s, {force} N: only {seconds:.2} s of data; left out"
        ));
    }
    for segment in cut.off_grid.iter().take(SHOWN) {
        warn(&format!(
            "a steady piece at {:.1} mm/s, {:.2} N is off the grid; left out",
            segment.median_speed_mm_s, segment.median_force_n
        ));
    }
    if cut.off_grid.len() > SHOWN {
        warn(&format!(
            "{} pieces in total are off the grid",
            cut.off_grid.len()
        ));
    }
}
