//! Bound on what trials give to nodes that are not theirs: a track is of all of a texture, a codebook of a region. None
//! makes a node's output louder, in its loudest windows of 1, 5 and 50 ms, than the recordings of the node are.
//!
//! First by construction: the residuals that a track or a codebook is made of are limited ([`Ringing::limit`]) to what
//! the recordings of the calmest nodes reach. Then by listening: [`excess`] plays the parts by the device's own feed
//! through the filters of a few nodes, because levels and pieces that are drawn apart may meet. Last, the
//! [`remaining_excess`] is taken off the level of each node that is still too loud.

use std::borrow::Cow;
use std::collections::BTreeMap;

use model_format::{PartsSpec, limits};
use rayon::prelude::*;

use super::choice::{played, source};
use super::loudness::{Loudest, Ringing, product};
use super::trace::Trace;
use crate::dsp::linear_prediction::error_share;
use crate::dsp::sums::mean_square;

/// The loudest windows of a few seconds of steady white noise; nothing that has a noise is calmer.
const STEADY: Loudest = Loudest([2.1, 1.5, 1.15]);

/// Samples that are played for a check: 26 s of a codebook alone, whose pieces repeat, and 105 s where noise or pieces
/// meet the levels of a track.
const PLAYED: usize = 1 << 17;
const PLAYED_AT_LEVELS: usize = 1 << 19;

/// Loudness over the recordings' that no node may have.
const BOUND: f64 = 1.5;

/// Loudness over the recordings' that parts are made for, because another seed may be louder.
const AIM: f64 = 1.25;

/// Calmest nodes of a source that are listened to.
const CALMEST: usize = 2;

/// Expected loudness that parts are made with, in units of the loudest of the calmest nodes' recordings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reach {
    /// Of the track.
    pub track: f64,
    /// Of each region's codebook.
    pub codebooks: [f64; limits::MAX_CODEBOOKS],
}

impl Reach {
    /// The reach that parts are first made with. More is not heard at any node; less may be needed.
    pub const FIRST: Self = Self {
        track: 1.5,
        codebooks: [1.5; limits::MAX_CODEBOOKS],
    };

    /// Makes it less by the `excess` of each source, 0 for Gaussian noise: each codebook by its own, and the track by
    /// what all have in common, or noise alone.
    pub fn lower(&mut self, excess: &BTreeMap<u8, f64>) {
        let common = excess.values().copied().fold(f64::INFINITY, f64::min);
        let noise = excess.get(&0).copied().unwrap_or(0.0);
        // What all sources have too much of is the track, which all of them play at; noise has nothing else that could
        // be less.
        self.track /= common.max(noise).max(1.0);
        for (reach, number) in self.codebooks.iter_mut().zip(1..) {
            *reach /= excess.get(&number).copied().unwrap_or(0.0).max(1.0);
        }
    }

    /// Difference of the least from the first, dB; none if there is none.
    pub fn lowered_db(&self) -> Option<f64> {
        let pairs = self.codebooks.into_iter().zip(Self::FIRST.codebooks);
        let pairs = pairs.chain([(self.track, Self::FIRST.track)]);
        let least = pairs.map(|(own, first)| own / first).fold(1.0, f64::min);
        (least < 1.0).then(|| 20.0 * least.log10())
    }
}

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

/// Nodes that a source of parts plays at.
struct SourceNodes<'t> {
    /// Excitation that the source plays, standard deviations.
    played: Vec<f64>,
    /// Nodes with the loudest windows of their recordings, the calmest first.
    nodes: Vec<(Loudest, &'t Trace)>,
    /// Loudest windows that the recordings of most of the nodes reach.
    least: Loudest,
}

impl SourceNodes<'_> {
    /// Loudness of the source at a node, in units of its recordings'.
    fn over(&self, (own, trace): &(Loudest, &Trace)) -> f64 {
        let heard = Loudest::behind(&self.played, &trace.reflection);
        heard.over(own.with(self.least, f64::max))
    }
}

/// The nodes of each source of `parts`, 0 for Gaussian noise, of a grid with so many `forces`. None where noise of
/// steady level plays.
fn sources<'t>(
    traces: &'t [Trace],
    forces: usize,
    parts: &PartsSpec,
) -> BTreeMap<u8, SourceNodes<'t>> {
    let samples = match parts.modulation {
        Some(_) => PLAYED_AT_LEVELS,
        None => PLAYED,
    };
    let mut sources: BTreeMap<u8, Vec<(Loudest, &Trace)>> = BTreeMap::new();
    for node in nodes(traces) {
        let number = source(node.1, forces, parts);
        if number > 0 || parts.modulation.is_some() {
            sources.entry(number).or_default().push(node);
        }
    }
    let of_source = |(number, mut nodes): (u8, Vec<(Loudest, &'t Trace)>)| {
        nodes.sort_by(|a, b| a.0.over(STEADY).total_cmp(&b.0.over(STEADY)));
        let source = SourceNodes {
            played: played(number, parts, samples).expect("parts that were made can be played"),
            least: most(nodes.iter().map(|(_, trace)| *trace), 1.0),
            nodes,
        };
        (number, source)
    };
    sources.into_par_iter().map(of_source).collect()
}

/// Loudness of each source of `parts`, 0 for Gaussian noise, over the loudness that it may have, for a grid of `forces`
/// forces. It is the largest at three nodes: the two with the calmest recordings and the one that rings longest. Empty
/// where noise of steady level plays.
pub(super) fn excess(traces: &[Trace], forces: usize, parts: &PartsSpec) -> BTreeMap<u8, f64> {
    let of_source = |(number, source): (u8, SourceNodes<'_>)| {
        let ringing = |(_, trace): &&(Loudest, &Trace)| error_share(&trace.reflection);
        let nodes = &source.nodes;
        let longest = nodes
            .iter()
            .min_by(|a, b| ringing(a).total_cmp(&ringing(b)));
        let heard = nodes.iter().take(CALMEST).chain(longest);
        let most = heard.map(|node| source.over(node)).fold(0.0, f64::max);
        (number, most / AIM)
    };
    let sources = sources(traces, forces, parts);
    sources.into_par_iter().map(of_source).collect()
}

/// Excess that is left once `parts` are made: each node that they play louder than [`BOUND`] times its recordings, with
/// the factor of the excess.
pub(super) fn remaining_excess(
    traces: &[Trace],
    forces: usize,
    parts: &PartsSpec,
) -> Vec<((usize, usize), f64)> {
    let sources = sources(traces, forces, parts);
    let of_source = |source: &SourceNodes<'_>| {
        let nodes = source.nodes.par_iter();
        let ratios = nodes.map(|node| (node.1.at, source.over(node) / BOUND));
        ratios
            .filter(|(_, excess)| *excess > 1.0)
            .collect::<Vec<_>>()
    };
    sources.values().flat_map(of_source).collect()
}
