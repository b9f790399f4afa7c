//! The choice of a texture's excitation, from the traces of its trials.

use std::ops::Range;

use model_format::{BLOCK_BYTES, BLOCK_SAMPLES, ExcitationSpec, PartsSpec, SAMPLE_RATE_HZ, limits};
use serde::{Deserialize, Serialize};
use stylus_support::Warning;
use stylus_support::number::counted;

use super::bound::{self, Excess, Reach};
use super::codebook::{Coded, coded};
use super::evidence::Evidence;
use super::material::{LEAST_STRETCHES, MOST_STRETCHES, STRETCH_SAMPLES, choose};
use super::regions::by_speed;
use super::trace::Trace;
use crate::fit::options::{ExcitationChoice, Options};

/// Upper bound of the bytes of the part in addition to its codes and nodes, and of a codebook in addition to its codes.
const HEADER_BYTES: usize = 16;

/// Excitation of a texture, and the report on it.
#[derive(Clone, Debug)]
pub(in crate::fit) struct Chosen {
    /// Only the excitation is set.
    pub parts: PartsSpec,
    pub report: ExcitationReport,
    /// Notes for the user.
    pub notes: Vec<Warning>,
    /// Nodes that are still too loud.
    pub excess: Vec<Excess>,
}

/// Grid of a texture.
#[derive(Clone, Copy, Debug)]
pub(in crate::fit) struct Axes<'a> {
    pub speeds_mm_s: &'a [f32],
    pub forces_n: &'a [f32],
}

/// The texture for which an excitation is chosen, and the bytes that the excitation may take.
#[derive(Clone, Copy, Debug)]
pub(in crate::fit) struct Choice<'a> {
    /// Name of the texture.
    pub name: &'a str,
    pub axes: Axes<'a>,
    pub options: &'a Options,
    /// Bytes of the library that the excitation may take.
    pub room: usize,
}

/// The codebook of a range of speeds.
struct OfSpeeds {
    speeds: Range<usize>,
    coded: Coded,
    trials: usize,
    seconds: f64,
}

impl Choice<'_> {
    /// Chooses the excitation by `traces`: at the speeds at which it is not known to be Gaussian noise, recorded
    /// snippets.
    pub(super) fn made(&self, traces: &[Trace]) -> Chosen {
        /// Largest number of times that the reach is lowered.
        const ROUNDS: usize = 4;
        let mut reach = Reach::FIRST;
        let mut chosen = self.limited(traces, &reach);
        // What is still too loud after these rounds is taken off the nodes' levels by `remaining_excess`.
        for _ in 0..ROUNDS {
            let excess = bound::excess(traces, self.axes.forces_n.len(), &chosen.parts);
            if excess.values().all(|&excess| excess <= 1.0) {
                break;
            }
            reach.lower(&excess);
            chosen = self.limited(traces, &reach);
        }
        chosen.report.lowered_db = reach.lowered_db();
        chosen.excess = bound::remaining_excess(traces, self.axes.forces_n.len(), &chosen.parts);
        chosen
    }

    /// Returns the excitation whose codebooks are limited to `reach`.
    fn limited(&self, traces: &[Trace], reach: &Reach) -> Chosen {
        let evidence = Evidence::of_all(traces.iter().map(|trace| trace.evidence));
        let codebooks = self.codebooks(traces, reach);
        let report = ExcitationReport {
            texture: self.name.to_owned(),
            codebooks: codebooks
                .iter()
                .map(|own| codebook_report(own, self.axes.speeds_mm_s))
                .collect(),
            lowered_db: None,
            source: self.reason(&codebooks, evidence),
            evidence,
        };
        let parts = PartsSpec {
            excitation: excitation(codebooks, self.axes),
            ..PartsSpec::default()
        };
        Chosen {
            parts,
            report,
            notes: Vec::new(),
            excess: Vec::new(),
        }
    }

    /// Returns the codebooks of the ranges of speeds that need one. There are as many ranges as [`by_speed`] makes, or
    /// fewer, until some need one, and these have enough material and room.
    fn codebooks(&self, traces: &[Trace], reach: &Reach) -> Vec<OfSpeeds> {
        let made = |most: usize| {
            let ranges = by_speed(self.axes.speeds_mm_s, most);
            let wanting: Vec<(Range<usize>, Vec<&Trace>)> = (ranges.into_iter())
                .map(|speeds| {
                    let own = traces.iter().filter(|trace| speeds.contains(&trace.at.0));
                    (speeds.clone(), own.collect::<Vec<_>>())
                })
                .filter(|(_, own)| self.is_wanting(own))
                .collect();
            // Ranges with Gaussian noise leave their bytes to the others.
            let stretches = self.stretches(wanting.len());
            let of_range = |((speeds, own), reach): ((Range<usize>, Vec<&Trace>), f64)| {
                let material = choose(&own, stretches, bound::most(own.iter().copied(), reach))?;
                Some(OfSpeeds {
                    speeds,
                    coded: coded(&material.samples, own.iter().all(|trace| trace.at == own[0].at))?,
                    trials: material.trials,
                    seconds: material.samples.len() as f64 / f64::from(SAMPLE_RATE_HZ),
                })
            };
            let made: Option<Vec<OfSpeeds>> = wanting.into_iter().zip(reach.0).map(of_range).collect();
            made.filter(|own| !own.is_empty())
        };
        (1..=limits::MAX_CODEBOOKS).rev().find_map(made).unwrap_or_default()
    }

    /// Returns whether a range of speeds with these traces needs recorded snippets.
    fn is_wanting(&self, own: &[&Trace]) -> bool {
        match self.options.excitation {
            ExcitationChoice::Gaussian => false,
            ExcitationChoice::Snippets => true,
            ExcitationChoice::Auto => !Evidence::of_all(own.iter().map(|trace| trace.evidence)).is_gaussian(),
        }
    }

    /// Returns the number of stretches that each of `count` codebooks may have.
    fn stretches(&self, count: usize) -> usize {
        let nodes = self.axes.speeds_mm_s.len() * self.axes.forces_n.len();
        let bytes = self.room.min(limits::MAX_EXCITATION_BYTES);
        let codes = bytes.saturating_sub(HEADER_BYTES + nodes) / count.max(1);
        let samples = codes.saturating_sub(HEADER_BYTES) / BLOCK_BYTES * BLOCK_SAMPLES;
        (samples / STRETCH_SAMPLES).min(MOST_STRETCHES)
    }

    /// Returns the reason for these codebooks, or for none.
    fn reason(&self, codebooks: &[OfSpeeds], evidence: Evidence) -> String {
        let why = match self.options.excitation {
            ExcitationChoice::Auto => evidence.to_string(),
            _ => "as asked for".to_owned(),
        };
        if !codebooks.is_empty() {
            return format!("{} of recorded snippets: {why}", counted(codebooks.len(), "codebook"));
        }
        let is_wanted = match self.options.excitation {
            ExcitationChoice::Gaussian => false,
            ExcitationChoice::Snippets => true,
            ExcitationChoice::Auto => !evidence.is_gaussian(),
        };
        let why = if !is_wanted {
            why
        } else if self.stretches(1) < LEAST_STRETCHES {
            "the library has no room for a codebook".to_owned()
        } else {
            let least_s = (LEAST_STRETCHES * STRETCH_SAMPLES) as f64 / f64::from(SAMPLE_RATE_HZ);
            format!("too short for a codebook, which takes {least_s} s that are sound: record for longer")
        };
        format!("Gaussian noise: {why}")
    }
}

fn excitation(codebooks: Vec<OfSpeeds>, axes: Axes<'_>) -> Option<ExcitationSpec> {
    let number = |speed: usize| {
        let own = codebooks.iter().position(|own| own.speeds.contains(&speed));
        // Number 0 is Gaussian noise.
        own.map_or(0, |index| index as u8 + 1)
    };
    let forces = axes.forces_n.len();
    let of_nodes = (0..axes.speeds_mm_s.len())
        .flat_map(|speed| vec![number(speed); forces])
        .collect();
    let codebooks: Vec<_> = codebooks.into_iter().map(|own| own.coded.spec).collect();
    (!codebooks.is_empty()).then_some(ExcitationSpec { codebooks, of_nodes })
}

fn codebook_report(own: &OfSpeeds, speeds_mm_s: &[f32]) -> CodebookReport {
    CodebookReport {
        speeds_mm_s: [speeds_mm_s[own.speeds.start], speeds_mm_s[own.speeds.end - 1]],
        trials: own.trials,
        seconds: own.seconds,
        peak: own.coded.spec.peak,
        cut_samples: own.coded.cut,
        snr_db: own.coded.snr_db,
    }
}

/// A codebook of a texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CodebookReport {
    /// Lowest and highest speed of its nodes, mm/s.
    pub speeds_mm_s: [f32; 2],
    /// Number of trials that its material comes from.
    pub trials: usize,
    /// Duration, s.
    pub seconds: f64,
    /// Highest peak, standard deviations.
    pub peak: f32,
    /// Number of samples that were clipped, because the excitation's range does not hold their peaks.
    pub cut_samples: usize,
    /// Ratio of its power to that of the error of its codes, at 20 to 1000 Hz, dB.
    pub snr_db: f64,
}

/// The choice of a texture's excitation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExcitationReport {
    /// The texture.
    pub texture: String,
    /// Deviations of all trials together from Gaussian noise.
    pub evidence: Evidence,
    /// The codebooks; empty for Gaussian noise.
    pub codebooks: Vec<CodebookReport>,
    /// Change of the loudness to which the excitation was limited, because it was louder than its recordings, dB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lowered_db: Option<f64>,
    /// Reason for the choice of the source.
    pub source: String,
}
