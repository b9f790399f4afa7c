//! The excitation of a texture's models: recorded snippets of the prediction residual, unless what would be played of
//! them is Gaussian noise, which takes no bytes.
//!
//! A trial's residual is computed with the coefficients that are played at the trial's own node (`trace`), and tested
//! by what a hand would feel of it behind the node's filter (`evidence`).
//!
//! **A codebook** (`codebook`) is up to 5 s of the residual with its level, whitened, and coded in 3 bits whose noise
//! is moved above the felt band. Whitening keeps the spectrum of the chosen material from being added to the model's.
//! The material is taken at equal ranks of the power, so that the codebook has the distribution of the whole
//! (`material`). Each range of speeds has its own codebook if there is enough material (`regions`).
//!
//! Waves are neither turned nor cut into pieces: those of a real surface are not symmetric in time or sign, and
//! listeners and classifiers tell both. Where several axes were projected on one, all trials point to the same side.
//!
//! **The bound** (`loudness`, `bound`): at the output, no residual is louder than its signal, and no part of a texture
//! is louder than the recordings of the nodes at which it is played, up to stated factors. A trial with far louder
//! moments than the others is not used for the excitation.

mod bound;
mod codebook;
mod evidence;
mod known_band;
mod loudness;
#[cfg(test)]
mod loudness_tests;
mod material;
#[cfg(test)]
mod picture_tests;
mod power;
mod regions;
#[cfg(test)]
pub(super) mod tests;
mod texture;
mod trace;

use model_format::NodeSpec;
use rayon::prelude::*;
use stylus_dsp::sums::dot;
use stylus_support::Warning;

use super::blocks::Part;
use super::grid::place;
use super::options::{ExcitationChoice, Options};
use super::recordings::Take;
use super::reports::TrialReport;

pub(super) use bound::Excess;
pub use evidence::Evidence;
use loudness::Loudest;
pub(super) use texture::{Axes, Choice, Chosen};
pub use texture::{CodebookReport, ExcitationReport};
use trace::Trace;

/// Ratio of a trial's loudness to the limit that most trials of its texture keep above which the trial is not used for
/// the excitation.
const LOUDER: f64 = 1.5;

/// Returns whether `options` ask for anything to be added. Gaussian noise needs nothing.
pub(super) fn is_wanted(options: &Options) -> bool {
    options.excitation != ExcitationChoice::Gaussian
}

/// Makes the excitation of a texture with the stored `nodes` from those of its `takes` that the fit used. `reports` are
/// of all trials of the set. Calls `progress` for each take that is done.
pub(super) fn of(
    choice: Choice<'_>,
    nodes: &[NodeSpec],
    takes: Vec<Take<'_>>,
    reports: &[TrialReport],
    part: Part,
    progress: &(impl Fn() + Sync),
) -> Chosen {
    let Axes { speeds_mm_s, forces_n } = choice.axes;
    let first = takes
        .first()
        .map_or_else(Vec::new, |take| take.signal.direction.clone());
    let trials = takes.len();
    let trace = |mut take: Take<'_>| {
        // Where the largest component of the axis changes, so does the sign of the signal: waves of neighbouring nodes
        // would point to opposite sides.
        if dot(&take.signal.direction, &first) < 0.0 {
            take.signal.samples.iter_mut().for_each(|x| *x = -*x);
        }
        let report = &reports[take.number];
        let (speed, force) = (take.trial.speed_mm_s, take.trial.force_n);
        let at = (place(speeds_mm_s, speed), place(forces_n, force));
        let node = report.used.then(|| nodes.get(at.0 * forces_n.len() + at.1));
        // Nothing excites a silent node.
        let node = node.flatten().filter(|node| node.output_power > 0.0);
        let trace = node.and_then(|node| Trace::of(&take.signal, at, &node.codes, &report.verdicts, trials));
        progress();
        trace.map(|trace| (take.number, trace))
    };
    let traces: Vec<Option<(usize, Trace)>> = takes.into_par_iter().map(trace).collect();
    let (mut notes, mut alike) = (Vec::new(), Vec::new());
    let traces: Vec<(usize, Trace)> = traces.into_iter().flatten().collect();
    let loudness: Vec<Loudest> = traces.iter().map(|(_, trace)| trace.loudest).collect();
    let others = Loudest::of_most(&loudness);
    for (number, trace) in traces {
        let note = |kind, size, text| Warning::of(kind, ("recording", &reports[number].file), size, text);
        let over = others.map_or(0.0, |others| trace.loudest.over(others));
        // The trial's spectrum and level stay at its own node, but its moments would sound at others, too.
        if over > LOUDER {
            notes.push(note("loud", over, loud(over)));
            continue;
        }
        let limited = trace.event.as_ref();
        notes.extend(limited.map(|event| note("event", event.limited_db(), event.to_string())));
        alike.push(trace);
    }
    let chosen = match part {
        Part::Whole => choice.made(&alike),
        Part::Blocks => choice.made(&alike.iter().filter_map(Trace::fitted).collect::<Vec<_>>()),
    };
    Chosen { notes, ..chosen }
}

/// Returns the text of a note on a trial whose loudest moments are `over` times as loud as the others'.
fn loud(over: f64) -> String {
    format!(
        "its loudest moments, in units of its RMS, are {over:.1} times as loud as those of the texture's other trials: \
         its own node has its spectrum and level, and no other has its moments; listen to it, and record it again if \
         they are none of the surface's"
    )
}
