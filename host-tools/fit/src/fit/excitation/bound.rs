//! Bound on the loudness that trials pass on to the nodes of other trials: a track comes from all trials of a texture,
//! and a codebook from those of a region. Neither may make a node's output louder, in its loudest windows of 1, 5 and
//! 50 ms, than the recordings of the node by more than the bound.
//!
//! The bound is held in three steps. First by construction: the residuals from which a track or a codebook is made are
//! limited ([`Ringing::limit`]) to what the recordings of the calmest nodes reach. Then by a check: [`excess`] plays
//! the parts with the device's own feed through the filters of a few nodes, because independently drawn levels and
//! pieces may coincide. Last, the level of each node that is still too loud is lowered by the [`remaining_excess`].

use std::borrow::Cow;
use std::collections::BTreeMap;

use model_format::{PartsSpec, limits};
use rayon::prelude::*;

use super::choice::{played, source};
use super::loudness::{Loudest, Ringing, product};
use super::trace::Trace;
use crate::dsp::linear_prediction::error_share;
use crate::dsp::sums::mean_square;

/// The loudest windows of a few seconds of steady white noise. No noise-like signal has calmer ones.
const STEADY: Loudest = Loudest([2.1, 1.5, 1.15]);

/// Numbers of samples that are played for a check: 26 s of a codebook at a steady level, whose pieces repeat, and 105 s
/// if noise or pieces are combined with the levels of a track.
const PLAYED: usize = 1 << 17;
const PLAYED_AT_LEVELS: usize = 1 << 19;

/// Ratio of a node's loudness to that of its recordings that no node may exceed.
const BOUND: f64 = 1.5;

/// Ratio of the loudness to that of the recordings for which parts are made. It is smaller, because another seed may be
/// louder.
const AIM: f64 = 1.25;

/// Number of the calmest nodes of a source that are checked.
const CALMEST: usize = 2;

/// Expected loudness with which parts are made, relative to the recordings of the calmest nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reach {
    /// Expected loudness of the track.
    pub track: f64,
    /// Expected loudness of each region's codebook.
    pub codebooks: [f64; limits::MAX_CODEBOOKS],
}

impl Reach {
    /// The reach with which parts are first made. A larger one makes no audible difference at any node; a smaller one
    /// may be needed.
    pub const FIRST: Self = Self {
        track: 1.5,
        codebooks: [1.5; limits::MAX_CODEBOOKS],
    };

    /// Reduces the reach by the `excess` of each source, where number 0 is Gaussian noise: each codebook by its own
    /// excess, and the track by the excess that all sources share, or by that of noise.
    pub fn lower(&mut self, excess: &BTreeMap<u8, f64>) {
        let common = excess.values().copied().fold(f64::INFINITY, f64::min);
        let noise = excess.get(&0).copied().unwrap_or(0.0);
        // An excess that all sources share is the track's, because they are all played at its level. For noise, nothing
        // but the track could be reduced.
        self.track /= common.max(noise).max(1.0);
        for (reach, number) in self.codebooks.iter_mut().zip(1..) {
            *reach /= excess.get(&number).copied().unwrap_or(0.0).max(1.0);
        }
    }

    /// Returns the largest reduction from the first reach, dB, as a negative number; `None` if nothing was reduced.
    pub fn lowered_db(&self) -> Option<f64> {
        let pairs = self.codebooks.into_iter().zip(Self::FIRST.codebooks);
        let pairs = pairs.chain([(self.track, Self::FIRST.track)]);
        let least = pairs.map(|(own, first)| own / first).fold(1.0, f64::min);
        (least < 1.0).then(|| 20.0 * least.log10())
    }
}

/// Returns the loudest windows of each node's recordings, with one of the node's traces.
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

/// Returns the loudest windows that `traces` may have at all of their nodes: `reach` times what the recordings of all
/// nodes but the calmest eighth reach, and at least those of steady noise.
pub(super) fn most<'t>(traces: impl IntoIterator<Item = &'t Trace>, reach: f64) -> Loudest {
    let of_nodes: Vec<Loudest> = nodes(traces).into_iter().map(|(loudest, _)| loudest).collect();
    let least = Loudest::of_least(&of_nodes).unwrap_or_default();
    least.times(reach).with(STEADY, f64::max)
}

/// Returns the `samples` of a residual of `trace`, limited so that nothing is louder than `most` behind the filter of
/// the trace's node, and then scaled to a mean square of 1.
pub(super) fn limited<'t>(trace: &'t Trace, samples: Cow<'t, [f64]>, most: Loudest) -> Cow<'t, [f64]> {
    let Some(gains) = Ringing::of(&trace.reflection).limit(&samples, &trace.flaws, most) else {
        return samples;
    };
    let mut limited = product(&samples, &gains);
    let scale = 1.0 / mean_square(&limited).sqrt();
    limited.iter_mut().for_each(|x| *x *= scale);
    limited.into()
}

/// The nodes at which a source of parts is played.
struct SourceNodes<'t> {
    /// Excitation that the source plays, standard deviations.
    played: Vec<f64>,
    /// Nodes, the calmest first, each with the loudest windows of its recordings.
    nodes: Vec<(Loudest, &'t Trace)>,
    /// Loudest windows that the recordings of all these nodes but the calmest eighth reach.
    least: Loudest,
}

impl SourceNodes<'_> {
    /// Returns the loudness of the source at a node, relative to that of the node's recordings or, for calmer ones, to
    /// `least`.
    fn over(&self, (own, trace): &(Loudest, &Trace)) -> f64 {
        let heard = Loudest::behind(&self.played, &trace.reflection);
        heard.over(own.with(self.least, f64::max))
    }
}

/// Returns the nodes of each source of `parts`, where number 0 is Gaussian noise, for a grid with `forces` forces.
/// Nodes with noise of steady level are left out.
fn sources<'t>(traces: &'t [Trace], forces: usize, parts: &PartsSpec) -> BTreeMap<u8, SourceNodes<'t>> {
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

/// Returns the loudness of each source of `parts`, where number 0 is Gaussian noise, relative to the one that it is
/// made for, for a grid of `forces` forces. It is the largest at up to three nodes: the two with the calmest recordings
/// and the one that rings longest. Noise of steady level has no entry.
pub(super) fn excess(traces: &[Trace], forces: usize, parts: &PartsSpec) -> BTreeMap<u8, f64> {
    let of_source = |(number, source): (u8, SourceNodes<'_>)| {
        let ringing = |(_, trace): &&(Loudest, &Trace)| error_share(&trace.reflection);
        let nodes = &source.nodes;
        let longest = nodes.iter().min_by(|a, b| ringing(a).total_cmp(&ringing(b)));
        let heard = nodes.iter().take(CALMEST).chain(longest);
        let most = heard.map(|node| source.over(node)).fold(0.0, f64::max);
        (number, most / AIM)
    };
    let sources = sources(traces, forces, parts);
    sources.into_par_iter().map(of_source).collect()
}

/// Returns the excess that is left once `parts` are made: each node at which they are louder than [`BOUND`] times its
/// recordings, with the factor of the excess.
pub(super) fn remaining_excess(traces: &[Trace], forces: usize, parts: &PartsSpec) -> Vec<((usize, usize), f64)> {
    let sources = sources(traces, forces, parts);
    let of_source = |source: &SourceNodes<'_>| {
        let nodes = source.nodes.par_iter();
        let ratios = nodes.map(|node| (node.1.at, source.over(node) / BOUND));
        ratios.filter(|(_, excess)| *excess > 1.0).collect::<Vec<_>>()
    };
    sources.values().flat_map(of_source).collect()
}
