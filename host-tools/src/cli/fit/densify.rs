//! `stylus fit --densify`

use host_tools::evaluation::leave_one_out;
use host_tools::evaluation::leave_one_out::{LeaveOneOut, Prepared, Row, summarise};
use host_tools::fit::densify;
use host_tools::fit::densify::{AddedLine, Densified, Direction};
use host_tools::fit::{self, Fit};
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;
use host_tools::support::progress;
use host_tools::texture::domain::Method;

use crate::cli::evaluate::removed_nodes::removed_node_test;
use crate::cli::table::table;

/// A denser library, with the added lines and the removed-node test before and after.
pub struct Denser {
    /// Added lines and denser textures.
    pub densified: Densified,
    /// The test; none if no node can be removed.
    pub test: Option<LeaveOneOut>,
}

/// Rows of the test: nodes interpolated as on the device, and nodes of the denser grid.
const BEFORE: Row = Row::Interpolated(Method::DEVICE);
const AFTER: Row = Row::Densified;

/// Densifies the grids of `fit` with progress bars, and runs the test before and after.
pub fn densify(set: &RecordingSet, fit: &Fit, options: &fit::Options) -> Result<Denser> {
    let bar = progress::bar(set.trials.len() as u64, "reading again");
    let used: Vec<bool> = fit.trials.iter().map(|report| report.used).collect();
    let signals = fit::signals_without_lines(set, &used, options, || bar.inc(1))?;
    bar.finish_and_clear();
    let bar = progress::bar(0, "densifying");
    let densified = densify::densify(&fit.textures, set, &signals, options, || bar.inc_length(1))?;
    bar.finish_and_clear();
    let options = leave_one_out::Options {
        order: options.order,
        reduction: options.reduction,
        ..leave_one_out::Options::default()
    };
    // A grid without a node to remove still gives a library, only without the test.
    let test = Prepared::new(set, &options)
        .and_then(|prepared| removed_node_test(&prepared, &[BEFORE, AFTER], &options))
        .ok();
    Ok(Denser { densified, test })
}

/// Table of added lines, and the error of every removed node before and after.
pub fn summary(denser: &Denser) -> String {
    let lines = lines_added(&denser.densified.lines);
    let Some(test) = &denser.test else {
        return format!("{lines}\nNo node lies between others, so there is no removed-node error.");
    };
    let origin = if test.simulated {
        " The recordings are SIMULATED."
    } else {
        ""
    };
    let textures = test.textures();
    let mean = |name: Option<&str>| {
        let of = |row| summarise(test, row, name).map(|summary| summary.mean_cost);
        match (of(BEFORE), of(AFTER)) {
            (Some(before), Some(after)) => format!("mean {before:.3} -> {after:.3}"),
            _ => String::new(),
        }
    };
    let maps: Vec<String> = textures
        .iter()
        .map(|name| format!("{name}: {}\n{}", mean(Some(name)), map(test, name)))
        .collect();
    format!(
        "{lines}\n\n\
         C of every removed node, interpolated as on the device -> filled in; all textures: {}.{origin}\n\n{}",
        mean(None),
        maps.join("\n\n")
    )
}

fn lines_added(lines: &[AddedLine]) -> String {
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

/// Table of errors with one line per force and one column per speed.
fn map(test: &LeaveOneOut, texture: &str) -> String {
    let nodes: Vec<_> = test
        .removed
        .iter()
        .filter(|node| node.texture == texture)
        .collect();
    let axis = |of: &dyn Fn(usize) -> f64| {
        let mut values: Vec<f64> = (0..nodes.len()).map(of).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    };
    let speeds = axis(&|index| nodes[index].speed_mm_s);
    let forces = axis(&|index| nodes[index].force_n);
    let header: Vec<String> = std::iter::once("N \\ mm/s".to_owned())
        .chain(speeds.iter().map(ToString::to_string))
        .collect();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let rows: Vec<Vec<String>> = forces
        .iter()
        .map(|&force| {
            let cell = |&speed: &f64| {
                let here = nodes
                    .iter()
                    .find(|node| node.speed_mm_s == speed && node.force_n == force);
                here.map_or_else(String::new, |node| {
                    let [before, after] = [0, 1].map(|row| node.outcomes[row].judged.cost);
                    format!("{before:.2}>{after:.2}")
                })
            };
            std::iter::once(force.to_string())
                .chain(speeds.iter().map(cell))
                .collect()
        })
        .collect();
    table(&header, &rows)
}
