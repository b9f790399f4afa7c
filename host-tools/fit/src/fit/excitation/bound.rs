//! Bound on the loudness that trials pass on to the nodes of other trials, because a codebook comes from all trials of
//! nearby speeds. It may not make a node's output louder, in its loudest windows of 1, 5 and 50 ms, than the recordings
//! of the node by more than the bound.
//!
//! The bound is held in three steps. First by construction: the residuals from which a codebook is made are limited
//! ([`Ringing::limit`]) to what the recordings of the calmest nodes reach. Then by a check: [`excess`] plays the parts
//! with the device's own feed through the filters of a few nodes. Last, the level of each node that is still too loud
//! is lowered by the [`remaining_excess`].

use std::borrow::Cow;
use std::collections::BTreeMap;

use model_format::{
    CodeSpec, CodebookSpec, ExcitationSpec, Library, MillimetresPerSecond, Newton, NodeSpec, PartsSpec, TextureSpec,
    encode, limits,
};
use rayon::prelude::*;
use stylus_dsp::fourier::{self, Complex};
use stylus_dsp::linear_prediction::error_share;
use stylus_dsp::sums::mean_square;
use stylus_kernel::Motion;
use stylus_kernel::feed::{FED_FRACTION_BITS, Feed, Material};
use stylus_kernel::grid::GridPoint;

use super::loudness::{Loudest, Ringing, product};
use super::trace::Trace;

/// The loudest windows of a few seconds of steady white noise. No noise-like signal has calmer ones.
const STEADY: Loudest = Loudest([2.1, 1.5, 1.15]);

/// Number of samples that are played for a check: 26 s, in which each codebook is played several times.
const PLAYED: usize = 1 << 17;

/// Ratio of a node's loudness to that of its recordings that no node may exceed.
const BOUND: f64 = 1.5;

/// Ratio of the loudness to that of the recordings for which parts are made. It is smaller, because another seed may be
/// louder.
const AIM: f64 = 1.25;

/// Ratio of a node's RMS to its recordings' above which its level is corrected: 1 dB. A minute of bursts scatters by
/// less.
const HIGHER: f64 = 1.12;

/// Number of the calmest nodes of a source that are checked.
const CALMEST: usize = 2;

/// Expected loudness with which each codebook is made, relative to the recordings of the calmest nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reach(pub [f64; limits::MAX_CODEBOOKS]);

impl Reach {
    /// The reach with which parts are first made. A larger one makes no audible difference at any node; a smaller one
    /// may be needed.
    pub const FIRST: Self = Self([1.5; limits::MAX_CODEBOOKS]);

    /// Reduces the reach of each codebook by its `excess`.
    pub fn lower(&mut self, excess: &BTreeMap<u8, f64>) {
        for (reach, number) in self.0.iter_mut().zip(1..) {
            *reach /= excess.get(&number).copied().unwrap_or(0.0).max(1.0);
        }
    }

    /// Returns the largest reduction from the first reach, dB, as a negative number; `None` if nothing was reduced.
    pub fn lowered_db(&self) -> Option<f64> {
        let least = self
            .0
            .into_iter()
            .zip(Self::FIRST.0)
            .map(|(own, first)| own / first)
            .fold(1.0, f64::min);
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
    Loudest::of_least(&of_nodes)
        .unwrap_or_default()
        .times(reach)
        .with(STEADY, f64::max)
}

/// Returns the residual of `trace`, limited so that nothing is louder than `most` behind the filter of the trace's
/// node, and then scaled to a mean square of 1.
pub(super) fn limited(trace: &Trace, most: Loudest) -> Cow<'_, [f64]> {
    let Some(gains) = Ringing::of(&trace.reflection).limit(&trace.residual, &trace.flaws, most) else {
        return trace.residual.as_slice().into();
    };
    let mut limited = product(&trace.residual, &gains);
    let scale = 1.0 / mean_square(&limited).sqrt();
    limited.iter_mut().for_each(|x| *x *= scale);
    limited.into()
}

/// Returns the number of the codebook of `parts` at the node of `trace`; 0 is Gaussian noise.
fn source(trace: &Trace, forces: usize, parts: &PartsSpec) -> u8 {
    let node = trace.at.0 * forces + trace.at.1;
    (parts.excitation.as_ref()).map_or(0, |spec| spec.of_nodes[node])
}

/// Returns what the device's feed plays of a codebook, standard deviations.
fn played(codebook: CodebookSpec) -> Vec<f64> {
    // Alone in a texture of one node, the codebook is all that the feed draws from.
    let node = NodeSpec::new(1.0, CodeSpec::lattice(Vec::new()));
    let spec = TextureSpec {
        parts: PartsSpec {
            excitation: Some(ExcitationSpec {
                codebooks: vec![codebook],
                of_nodes: vec![1],
            }),
            ..PartsSpec::default()
        },
        ..TextureSpec::new("excitation", &[1.0], &[1.0], vec![node])
    };
    let bytes = encode(&[spec]).expect("codebooks that were made are valid");
    let library = Library::decode(&bytes).expect("it was just encoded");
    let texture = library.textures().next().expect("it has one");
    let motion = Motion::new(MillimetresPerSecond(1.0), Newton(1.0)).expect("both are finite");
    let (material, point) = (Material::of(&texture), GridPoint::locate(&texture, motion));
    let mut feed = Feed::new(1);
    let unit = f64::from(1u32 << FED_FRACTION_BITS);
    let sample = || f64::from(feed.next_sample(&material, &point)) / unit;
    std::iter::repeat_with(sample).take(PLAYED).collect()
}

/// The nodes at which a source of parts is played.
struct SourceNodes<'t> {
    /// Spectrum of the excitation that the source plays, in standard deviations.
    played: Vec<Complex<f64>>,
    /// Nodes, the calmest first, each with the loudest windows of its recordings.
    nodes: Vec<(Loudest, &'t Trace)>,
    /// Loudest windows that the recordings of all these nodes but the calmest eighth reach.
    least: Loudest,
}

impl SourceNodes<'_> {
    /// Returns the loudness of the source at a node, relative to that of the node's recordings or, for calmer ones, to
    /// `least`; and its RMS, relative to the node's.
    fn over(&self, (own, trace): &(Loudest, &Trace)) -> (f64, f64) {
        let (heard, rms) = Loudest::behind(&self.played, &trace.reflection);
        (heard.over(own.with(self.least, f64::max)), rms)
    }
}

/// Returns the nodes of each codebook of `parts`, by its number, for a grid with `forces` forces.
fn sources<'t>(traces: &'t [Trace], forces: usize, parts: &PartsSpec) -> BTreeMap<u8, SourceNodes<'t>> {
    let Some(excitation) = &parts.excitation else {
        return BTreeMap::new();
    };
    let mut sources: BTreeMap<u8, Vec<(Loudest, &Trace)>> = BTreeMap::new();
    for node in nodes(traces) {
        let number = source(node.1, forces, parts);
        if number > 0 {
            sources.entry(number).or_default().push(node);
        }
    }
    let of_source = |(number, mut nodes): (u8, Vec<(Loudest, &'t Trace)>)| {
        nodes.sort_by(|a, b| a.0.over(STEADY).total_cmp(&b.0.over(STEADY)));
        let source = SourceNodes {
            played: fourier::forward(&mut played(excitation.codebooks[usize::from(number) - 1].clone())),
            least: most(nodes.iter().map(|(_, trace)| *trace), 1.0),
            nodes,
        };
        (number, source)
    };
    sources.into_par_iter().map(of_source).collect()
}

/// Returns the loudness of each codebook of `parts`, by its number, relative to the one that it is made for, for a grid
/// of `forces` forces. It is the largest at up to three nodes: the two with the calmest recordings and the one that
/// rings longest.
pub(super) fn excess(traces: &[Trace], forces: usize, parts: &PartsSpec) -> BTreeMap<u8, f64> {
    let of_source = |(number, source): (u8, SourceNodes<'_>)| {
        let ringing = |(_, trace): &&(Loudest, &Trace)| error_share(&trace.reflection);
        let nodes = &source.nodes;
        let longest = nodes.iter().min_by(|a, b| ringing(a).total_cmp(&ringing(b)));
        let most = nodes
            .iter()
            .take(CALMEST)
            .chain(longest)
            .map(|node| source.over(node).0)
            .fold(0.0, f64::max);
        (number, most / AIM)
    };
    sources(traces, forces, parts).into_par_iter().map(of_source).collect()
}

/// What is too loud at a node, as ratios of amplitudes.
#[derive(Clone, Copy, Debug)]
pub struct Excess {
    /// Indices of the node's speed and force.
    pub at: (usize, usize),
    /// Ratio of the RMS to the recordings', where a tone of the codebook meets a resonance; otherwise 1.
    pub level: f64,
    /// Ratio of the loudest moments to the bound, at the recordings' level, at least 1.
    pub moments: f64,
}

/// Returns the excess that is left once `parts` are made: each node at which they are louder than [`BOUND`] times its
/// recordings, or at which a tone on a resonance raises the level by [`HIGHER`].
pub(super) fn remaining_excess(traces: &[Trace], forces: usize, parts: &PartsSpec) -> Vec<Excess> {
    let sources = sources(traces, forces, parts);
    let of_source = |source: &SourceNodes<'_>| {
        source
            .nodes
            .par_iter()
            .map(|node| {
                let (loudness, rms) = source.over(node);
                let level = if rms > HIGHER { rms } else { 1.0 };
                Excess {
                    at: node.1.at,
                    level,
                    moments: (loudness / level / BOUND).max(1.0),
                }
            })
            .filter(|node| node.level * node.moments > 1.0)
            .collect::<Vec<_>>()
    };
    sources.values().flat_map(of_source).collect()
}
