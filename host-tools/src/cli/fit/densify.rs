//! `stylus fit --densify`

use host_tools::evaluation::leave_one_out;
use host_tools::evaluation::leave_one_out::{LeaveOneOut, Prepared, Row, summarise};
use host_tools::fit::densify::{AddedLine, Densified, Densifier, Direction, LeftOut};
use host_tools::fit::{self, Fit};
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;
use host_tools::support::progress;
use host_tools::texture::domain::Method;

use crate::cli::evaluate::removed_node_test;
use crate::cli::table::{folded_table, table};

/// A denser library, with the added lines and the removed-node test before and after.
pub struct Denser {
    /// Added lines and denser textures.
    pub densified: Densified,
    /// The test; none if no node can be removed.
    pub test: Option<LeaveOneOut>,
    /// Recorded nodes beside which nothing was filled in.
    pub left_out: Vec<LeftOut>,
}

/// Difference of C that rounding makes, and no more.
const ROUNDING: f64 = 1e-4;

/// Rows of the test: nodes interpolated as on the device, and so in the denser grid.
const BEFORE: Row = Row::Interpolated(Method::DEVICE);
const AFTER: Row = Row::Denser;

/// Densifies the grids of `fit` with progress bars, and runs the test before and after.
///
/// Where the test of the denser grid finds a node worse, the grid is made anew with nothing filled in beside it, and
/// tested again, until no node is worse.
pub fn densify(set: &RecordingSet, fit: &Fit, options: &fit::Options) -> Result<Denser> {
    let bar = progress::bar(set.trials.len() as u64, "reading again");
    let used: Vec<bool> = fit.trials.iter().map(|report| report.used).collect();
    let signals = fit::signals_without_lines(set, &used, options, || bar.inc(1))?;
    bar.finish_and_clear();
    let test_options = leave_one_out::Options {
        order: options.order,
        reduction: options.reduction,
        ..leave_one_out::Options::default()
    };
    // A grid without a node to remove still gives a library, only without the test.
    let mut prepared = Prepared::new(set, &test_options).ok();
    let mut test: Option<LeaveOneOut> = None;
    let mut left_out = Vec::new();
    let densifier = Densifier::new(&fit.textures, set, &signals, options);
    loop {
        let bar = progress::bar(0, "densifying");
        let densified = densifier.fill(&left_out, || bar.inc_length(1))?;
        bar.finish_and_clear();
        if let Some(prepared) = &mut prepared {
            let changed = prepared.set_denser(&densified.fillings);
            if let Some(test) = &mut test {
                let bar = progress::bar(changed.len() as u64, "removing nodes again");
                let again = prepared.run_some(&changed, &[AFTER], &test_options, || bar.inc(1))?;
                bar.finish_and_clear();
                for (node, again) in changed.into_iter().zip(again) {
                    // What is before stays the same.
                    let outcomes = &mut test.removed[node].outcomes;
                    outcomes.truncate(1);
                    outcomes.extend(again.outcomes);
                }
            } else {
                test = removed_node_test(prepared, &[BEFORE, AFTER], &test_options).ok();
            }
        }
        let worse = test
            .as_ref()
            .map_or_else(Vec::new, |test| made_worse(test, &left_out));
        if worse.is_empty() {
            return Ok(Denser {
                densified,
                test,
                left_out,
            });
        }
        left_out.extend(worse);
    }
}

/// The nodes that are worse in the denser grid, those of `left_out` aside.
fn made_worse(test: &LeaveOneOut, left_out: &[LeftOut]) -> Vec<LeftOut> {
    let mut worse: Vec<LeftOut> = Vec::new();
    for node in &test.removed {
        let costs = [0, 1].map(|row| node.outcomes[row].judged.cost);
        // A node of several recordings is removed as often.
        let known = left_out.iter().chain(&worse).any(|known| {
            known.texture == node.texture
                && known.speed_mm_s == node.speed_mm_s
                && known.force_n == node.force_n
        });
        if costs[1] > costs[0] + ROUNDING && !known {
            worse.push(LeftOut {
                texture: node.texture.clone(),
                speed_mm_s: node.speed_mm_s,
                force_n: node.force_n,
                costs,
            });
        }
    }
    worse
}

/// The bounds that the denser grid keeps, and what was left out for them.
fn kept(denser: &Denser) -> String {
    let orders = denser.densified.fillings.iter();
    let orders: Vec<String> = orders
        .map(|(name, filling)| format!("{name} {}", filling.highest_order))
        .collect();
    let mut text = format!(
        "Orders of what is filled in are at most the highest recorded: {}.",
        orders.join(", ")
    );
    if denser.left_out.is_empty() {
        return text;
    }
    text.push_str(
        "\nLeft out: nothing is filled in beside these nodes, because C would rise there; the device's interpolation \
         stays.",
    );
    for node in &denser.left_out {
        let [before, after] = node.costs;
        text.push_str(&format!(
            "\n  {}, {} mm/s, {} N: C {before:.4}, filled in {after:.4}",
            node.texture, node.speed_mm_s, node.force_n
        ));
    }
    text
}

/// Table of added lines, and the error of every removed node before and after.
pub fn summary(denser: &Denser) -> String {
    let lines = format!(
        "{}\n\n{}",
        lines_added(&denser.densified.lines),
        kept(denser)
    );
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
         C of every removed node, interpolated as on the device in the fitted grid -> in the denser grid, filled \
         without it; all textures: {}.{origin}\n\n{}",
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
    folded_table(&header, &rows, 1)
}
