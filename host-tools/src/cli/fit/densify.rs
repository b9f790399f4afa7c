//! `stylus fit --densify`

use host_tools::fit::densify::{AddedLine, Densified, Direction, densify as fill};
use host_tools::fit::{self, Fit};
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;
use host_tools::support::progress;

use crate::cli::table::table;

/// Densifies the grids of `fit` with a line of progress.
pub fn densify(set: &RecordingSet, fit: &Fit, options: &fit::Options) -> Result<Densified> {
    // No bar, because how many lines will be tried is not known before.
    let line = progress::line("densifying");
    let densified = fill(fit, set, options, || line.inc(1))?;
    line.finish_and_clear();
    Ok(densified)
}

/// Returns the table of added lines.
pub fn lines_added(lines: &[AddedLine]) -> String {
    let mut textures: Vec<&str> = Vec::new();
    for line in lines {
        if !textures.contains(&line.texture.as_str()) {
            textures.push(&line.texture);
        }
    }
    if textures.is_empty() {
        return "No line of nodes lowers the error: the grid stays the same.".into();
    }
    let rows: Vec<Vec<String>> = textures
        .into_iter()
        .map(|name| {
            let of = |direction| {
                let mut values: Vec<f32> = lines
                    .iter()
                    .filter(|line| line.texture == name && line.direction == direction)
                    .map(|line| line.value)
                    .collect();
                values.sort_by(f32::total_cmp);
                let values: Vec<String> = values.iter().map(ToString::to_string).collect();
                values.join(" ")
            };
            vec![name.to_owned(), of(Direction::Speed), of(Direction::Force)]
        })
        .collect();
    table(
        &["texture", "speeds added (mm/s)", "forces added (N)"],
        &rows,
    )
}
