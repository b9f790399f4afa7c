//! Bound on what trials give to nodes that are not theirs: a track is of all of a texture, a codebook of a region. None
//! makes a node's output louder, in its loudest windows of 1, 5 and 50 ms, than the recordings of the node are.
//!
//! First by construction: the residuals that a track or a codebook is made of are limited ([`Ringing::limit`]) to what
//! the recordings of the calmest nodes reach. Then by listening: [`excess`] plays the parts by the device's own feed
//! through the filters of a few nodes, because levels and pieces that are drawn apart may meet.

use std::borrow::Cow;
use std::collections::BTreeMap;

use model_format::PartsSpec;
use rayon::prelude::*;

use super::choice::played;
use super::evidence::mean_square;
use super::loudness::{Loudest, Ringing, product};
use super::trace::Trace;
use crate::dsp::linear_prediction::error_share;

/// The loudest windows of a few seconds of steady white noise; nothing that has a noise is calmer.
const STEADY: Loudest = Loudest([2.1, 1.5, 1.15]);

/// Samples that are played for a check: 26 s.
const PLAYED: usize = 1 << 17;

/// Loudness over the recordings' that a check of this length may find: two minutes reach 1.5 then.
const AIM: f64 = 1.3;

/// Calmest nodes of a source that are listened to.
const CALMEST: usize = 2;

/// The loudest windows of each node's recordings, with one of its traces.
fn nodes<'t>(traces: impl IntoIterator<Item = &'t Trace>) -> Vec<(Loudest, &'t Trace)> {
    let mut nodes: BTreeMap<(usize, usize), Vec<&Trace>> = BTreeMap::new();
    for trace in traces {
        nodes.entry(trace.at).or_default().push(trace);
    }
    let of_node = |own: Vec<&'t Trace>| {
        let loudness: Vec<Loudest> = own.iter().map(|trace| trace.loudest).collect();
        Loudest::of_most(&loudness).map(|loudest| (loudest, own[0]))
    };
    nodes.into_values().filter_map(of_node).collect()
}

/// The loudest windows that `traces` may give to all of their nodes: `reach` times what the recordings of most nodes
/// reach.
pub(super) fn most<'t>(traces: impl IntoIterator<Item = &'t Trace>, reach: f64) -> Loudest {
    let of_nodes: Vec<Loudest> = nodes(traces)
        .into_iter()
        .map(|(loudest, _)| loudest)
        .collect();
    let least = Loudest::of_least(&of_nodes).unwrap_or_default();
    least.times(reach).with(STEADY, f64::max)
}

/// The residual of `trace`, divided by `level` where there is one, with a mean square of 1, of which nothing is heard
/// louder than `most` at the trace's node.
pub(super) fn limited<'t>(
    trace: &'t Trace,
    samples: Cow<'t, [f64]>,
    most: Loudest,
) -> Cow<'t, [f64]> {
    let Some(gains) = Ringing::of(&trace.reflection).limit(&samples, &trace.flaws, most) else {
        return samples;
    };
    let mut limited = product(&samples, &gains);
    let scale = 1.0 / mean_square(&limited).sqrt();
    limited.iter_mut().for_each(|x| *x *= scale);
    limited.into()
}

/// Loudness of what `parts` make of the models of a grid with so many `forces`, in units of what it may be: the largest
/// of the nodes that are listened to, of each source those whose recordings are calmest and the one that rings longest.
pub(super) fn excess(traces: &[Trace], forces: usize, parts: &PartsSpec) -> f64 {
    if parts.excitation.is_none() && parts.modulation.is_none() {
        return 0.0;
    }
    let number = |trace: &Trace| {
        let node = trace.at.0 * forces + trace.at.1;
        parts
            .excitation
            .as_ref()
            .map_or(0, |spec| spec.of_nodes[node])
    };
    let mut sources: BTreeMap<u8, Vec<(Loudest, &Trace)>> = BTreeMap::new();
    for node in nodes(traces) {
        sources.entry(number(node.1)).or_default().push(node);
    }
    let of_source = |(number, mut own): (u8, Vec<(Loudest, &Trace)>)| {
        let Some(played) = played(number, parts, PLAYED) else {
            return 0.0;
        };
        let least = most(own.iter().map(|(_, trace)| *trace), 1.0);
        let over = |(own, trace): &(Loudest, &Trace)| {
            let heard = Loudest::behind(&played, &trace.reflection);
            heard.over(own.with(least, f64::max))
        };
        own.sort_by(|a, b| a.0.over(STEADY).total_cmp(&b.0.over(STEADY)));
        let ringing = |(_, trace): &&(Loudest, &Trace)| error_share(&trace.reflection);
        let longest = own.iter().min_by(|a, b| ringing(a).total_cmp(&ringing(b)));
        let heard = own.iter().take(CALMEST).chain(longest);
        heard.map(over).fold(0.0, f64::max)
    };
    let all: Vec<f64> = sources.into_par_iter().map(of_source).collect();
    all.into_iter().fold(0.0, f64::max) / AIM
}
