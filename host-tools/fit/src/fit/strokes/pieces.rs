//! Trials at a grid's nodes from strokes, with the level's dependence on the motion removed.

use std::ops::Range;

use model_format::{Provenance, SAMPLE_RATE_HZ};
use stylus_signals::recording::freehand::{LEAST_FORCE_N, LEAST_SPEED_MM_S};
use stylus_signals::recording::triage::{LEAST_KEPT, kept};
use stylus_signals::recording::{HeldSamples, Trial};
use stylus_support::Result;

use super::levels::NodeLevels;
use super::stroke::Stroke;

/// Least number of samples of a stretch at a node that is used: 40 ms, four times the length of a joint.
const LEAST_STRETCH: usize = 200;

/// Stretches of strokes at one node, scaled to the node's level.
#[derive(Clone, Default)]
struct AtNode {
    /// The stretches, one after the other, m/s².
    samples: Vec<f64>,
    /// Their positions in `samples`.
    stretches: Vec<Range<usize>>,
}

/// Returns the trials of texture `name` at the nodes of `levels`. A trial joins all stretches of the `strokes` in which
/// its node has the largest weight, scaled to the node's level. A node with less than 0.4 s of them has no trial.
pub(super) fn trials(name: &str, strokes: &[Stroke], levels: &NodeLevels) -> Result<Vec<Trial>> {
    let mut at_nodes = vec![AtNode::default(); levels.levels_db.len()];
    for stroke in strokes {
        for run in &stroke.moving {
            add(stroke, run, levels, &mut at_nodes);
        }
    }
    let provenance = Provenance::of_all(strokes.iter().map(|stroke| stroke.provenance));
    // Above what the slowest stroke carries, not every stretch has a signal.
    let recorded_hz = strokes
        .iter()
        .map(|stroke| stroke.recorded_hz)
        .fold(f64::from(SAMPLE_RATE_HZ), f64::min);
    let enough = levels
        .axes
        .nodes()
        .zip(at_nodes)
        .filter(|(_, own)| own.samples.len() >= LEAST_KEPT);
    let trial = |((speed, force), own): ((f64, f64), AtNode)| {
        // Stretches fade into each other as the parts of a cut trial do, so that no joint clicks.
        let joined = kept(vec![own.samples], &own.stretches);
        let held = HeldSamples::new(f64::from(SAMPLE_RATE_HZ), joined, false)?.recorded_at(recorded_hz);
        let file = format!("{name} at {speed} mm/s, {force} N");
        Ok(Trial {
            held: Some(held.into()),
            provenance,
            ..Trial::of(file, name, speed, force)
        })
    };
    enough.map(trial).collect()
}

/// Adds the stretches of a `run` of `stroke` to their nodes, each sample scaled to its node's level.
fn add(stroke: &Stroke, run: &Range<usize>, levels: &NodeLevels, at_nodes: &mut [AtNode]) {
    // The motion is averaged over 20 ms, which reaches beyond the run into rest and into the air.
    let motion: Vec<(f64, f64)> = stroke.motion[run.clone()]
        .iter()
        .map(|&(speed, force)| (speed.max(LEAST_SPEED_MM_S), force.max(LEAST_FORCE_N)))
        .collect();
    let nearest = |&(speed, force): &(f64, f64)| {
        levels
            .axes
            .around(speed, force)
            .iter()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0, |(node, _)| *node)
    };
    let nodes: Vec<usize> = motion.iter().map(nearest).collect();
    let mut end = run.start;
    for stretch in nodes.chunk_by(|a, b| a == b) {
        let begin = end;
        end += stretch.len();
        if stretch.len() < LEAST_STRETCH {
            continue;
        }
        let node = stretch[0];
        let own = &mut at_nodes[node];
        let first = own.samples.len();
        own.samples.extend((begin..end).map(|at| {
            let (speed, force) = motion[at - run.start];
            let over_db = levels.levels_db[node] - levels.level_db(speed, force);
            stroke.signal[at] * 10f64.powf(over_db / 20.0)
        }));
        own.stretches.push(first..own.samples.len());
    }
}
