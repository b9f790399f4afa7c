//! The recordings of one texture: read, analysed, and without the texture's lines.

use std::ops::Range;

use rayon::prelude::*;
use stylus_dsp::reduction::View;
use stylus_signals::recording::{RecordingSet, Trial};
use stylus_support::Result;
use stylus_support::in_order::in_order;

use super::blocks::Part;
use super::estimate::estimate_of;
use super::floor::{Floor, NoiseTake, named, unknown};
use super::lines::{Findings, Lines, TrialLines, separate};
use super::options::{FloorChoice, Options};
use super::trial::{Analysis, Signal, analyse_axes};

/// The recordings of one texture.
#[derive(Default)]
pub struct Recordings<'s> {
    /// Trials of the texture, in the order of the set.
    pub trials: Vec<Recorded<'s>>,
    /// Lines tied to position, or the reason for finding none.
    pub findings: Findings,
}

/// A trial that was read.
pub struct Recorded<'s> {
    /// Index of the trial in the set.
    pub number: usize,
    /// The trial.
    pub trial: &'s Trial,
    /// Statistics of the trial, without the texture's lines.
    pub analysis: Analysis,
    /// The whole signal without lines; `None` when it is not held in memory.
    pub signal: Option<Signal>,
}

impl<'s> Recordings<'s> {
    /// Reads the trials `members` of `set`, which are of one texture, and analyses the `part` of them that is fitted.
    /// Holds all of their signals. Calls `progress` for each trial done.
    ///
    /// # Errors
    /// The first trial that cannot be used; a recording of the rig's noise that cannot be used; with
    /// [`FloorChoice::Subtract`] noise that is not known.
    pub fn read(
        set: &'s RecordingSet,
        members: &[usize],
        options: &Options,
        part: Part,
        progress: &(impl Fn(usize) + Sync),
    ) -> Result<Self> {
        let read = in_order(members, |&number| -> Result<(Recorded<'s>, Axes)> {
            let trial = &set.trials[number];
            let (analysis, signal, axes) = analyse_axes(trial, options, part)?;
            progress(1);
            // Noise is reduced again in the way of each other trial. Of those, only the way is kept, to save memory.
            let axes = if trial.is_of_the_rig() {
                Axes::Noise(axes)
            } else {
                Axes::Texture(View::of(&axes, options.conditioning.reduction))
            };
            let recorded = Recorded {
                number,
                trial,
                analysis,
                signal: Some(signal),
            };
            Ok((recorded, axes))
        })?;
        let (trials, axes): (Vec<_>, Vec<_>) = read.into_iter().unzip();
        let mut own = Self {
            trials,
            findings: Findings::default(),
        };
        if options.floor != FloorChoice::None {
            own.tell_floor(axes, options, part)?;
        }
        if options.lines != Lines::None {
            own.separate_lines(options, part);
        }
        Ok(own)
    }

    /// Sets the fraction of the rig's noise for each recording of the surface, whose `axes` are given, and subtracts
    /// the noise if `options` ask for it. This is done before lines are sought, because a motor's tone is no part of
    /// the texture.
    fn tell_floor(&mut self, mut axes: Vec<Axes>, options: &Options, part: Part) -> Result<()> {
        let is_taken_off = options.floor == FloorChoice::Subtract;
        let Some(floor) = self.floor(&mut axes, options)? else {
            // A texture of nothing but the rig's noise has no recording that needs the noise taken off.
            let has_surface = |own: &&Recorded<'_>| own.trial.is_in_motion_and_contact();
            return match self.trials.iter().find(has_surface) {
                Some(own) if is_taken_off => Err(unknown(&own.trial.texture)),
                _ => Ok(()),
            };
        };
        self.trials.par_iter_mut().zip(axes).for_each(|(own, axes)| {
            let (Axes::Texture(view), Some(signal)) = (axes, &mut own.signal) else {
                return;
            };
            if !own.trial.is_in_motion_and_contact() {
                return;
            }
            let speed_mm_s = own.trial.speed_mm_s;
            let shares = floor.apply(&mut signal.samples, speed_mm_s, &view, is_taken_off);
            own.analysis.floor = Some(Box::new(shares));
            if is_taken_off {
                own.estimate_again(options, part);
            }
        });
        Ok(())
    }

    /// Returns the rig's noise; `None` if no usable recording of it exists. The noise comes from the recordings that
    /// the user named. Without them it comes from the trials at 0 N that have no dropped verdict, and the axes of these
    /// trials are moved out of `axes`.
    fn floor(&self, axes: &mut [Axes], options: &Options) -> Result<Option<Floor>> {
        let channels = axes.iter().find_map(|axes| match axes {
            Axes::Texture(view) => Some(view.channels()),
            Axes::Noise(_) => None,
        });
        let takes = if let (Some(path), Some(first)) = (&options.floor_recording, self.trials.first()) {
            named(path, first.trial, channels, options)?
        } else {
            let own = self.trials.iter().zip(axes);
            let take = |(own, axes): (&Recorded<'_>, &mut Axes)| match axes {
                Axes::Noise(axes) if !own.analysis.is_dropped(options) => {
                    let axes = std::mem::take(axes);
                    Some(NoiseTake::of(own.trial, axes, &own.trial.texture, channels))
                }
                _ => None,
            };
            own.filter_map(take).collect::<Result<_>>()?
        };
        Ok(Floor::of(takes, options.sample_rate_hz))
    }

    /// Subtracts the texture's lines from the signals, and estimates lags and bands again. The power stays that of the
    /// signal with its lines.
    fn separate_lines(&mut self, options: &Options, part: Part) {
        let (mut pieces, mut signals) = (Vec::new(), Vec::new());
        for (index, own) in self.trials.iter_mut().enumerate() {
            let is_sought = can_have_lines(own.trial, &own.analysis, options);
            let Some(signal) = own.signal.as_mut().filter(|_| is_sought) else {
                continue;
            };
            // A phase jumps where a part was cut out, so each stretch is searched by itself.
            let first = pieces.len();
            let fitted = part.of(signal.samples.len());
            for stretch in signal.stretches.iter().rev() {
                let samples = match stretch.start {
                    // What is left, without a copy.
                    0 => std::mem::take(&mut signal.samples),
                    start => signal.samples.split_off(start),
                };
                signals.insert(first, samples);
                pieces.insert(first, (index, within(&fitted, stretch)));
            }
        }
        let speeds_mm_s: Vec<f64> = pieces
            .iter()
            .map(|(index, _)| self.trials[*index].trial.line_speed_mm_s())
            .collect();
        let (indices, ranges): (Vec<usize>, Vec<_>) = pieces.into_iter().unzip();
        let separated = separate(&speeds_mm_s, signals, &ranges);
        self.findings = separated.findings;
        let mut followed: Vec<usize> = indices
            .iter()
            .zip(&separated.followed)
            .filter(|(_, followed)| **followed)
            .map(|(index, _)| *index)
            .collect();
        followed.dedup();
        self.findings.followed_trials = followed.len();
        let mut shares: Vec<Vec<(usize, TrialLines)>> = vec![Vec::new(); self.trials.len()];
        for ((index, rest), share) in indices.into_iter().zip(separated.rest).zip(separated.shares) {
            shares[index].push((rest.len(), share));
            if let Some(signal) = &mut self.trials[index].signal {
                if signal.samples.is_empty() {
                    signal.samples = rest;
                } else {
                    signal.samples.extend(rest);
                }
            }
        }
        self.trials.par_iter_mut().zip(shares).for_each(|(own, shares)| {
            own.analysis.lines = TrialLines::of_stretches(&shares);
            // Without a line in the trial nothing was subtracted, and its estimate still holds.
            if own.analysis.lines.amplitudes_m_s2.iter().flatten().any(|&a| a > 0.0) {
                own.estimate_again(options, part);
            }
        });
    }

    /// Returns the number of bytes of the samples that are held.
    pub(super) fn held_bytes(&self) -> usize {
        self.trials.iter().map(|own| size_of_val(own.samples())).sum()
    }

    /// Frees the signals.
    pub(super) fn let_go(&mut self) {
        self.trials.iter_mut().for_each(|own| own.signal = None);
    }

    /// Returns only the signals; `None` if they are not held.
    pub(super) fn into_takes(self) -> Option<Vec<Take<'s>>> {
        let take = |own: Recorded<'s>| {
            Some(Take {
                number: own.number,
                trial: own.trial,
                signal: own.signal?,
            })
        };
        self.trials.into_iter().map(take).collect()
    }
}

/// Axes of a recording, as far as the estimate of the rig's noise needs them.
enum Axes {
    /// Axes of a recording of the rig's noise, with their means removed, m/s².
    Noise(Vec<Vec<f64>>),
    /// How the axes of a texture's recording were reduced to one.
    Texture(View),
}

/// A trial with its signal.
pub(super) struct Take<'s> {
    /// Index of the trial in the set.
    pub number: usize,
    /// The trial.
    pub trial: &'s Trial,
    /// Signal of the trial without the texture's lines.
    pub signal: Signal,
}

impl Recorded<'_> {
    /// Samples of the trial; empty if they are not held.
    pub fn samples(&self) -> &[f64] {
        self.signal.as_ref().map_or(&[], |signal| &signal.samples)
    }

    /// Estimates lags and bands of the fitted `part` again, after the signal has changed.
    pub(super) fn estimate_again(&mut self, options: &Options, part: Part) {
        let samples = self.samples();
        let parts: Vec<&[f64]> = part
            .of(samples.len())
            .into_iter()
            .map(|range| &samples[range])
            .collect();
        let rate_hz = options.sample_rate_hz;
        let known = self.analysis.known_band(rate_hz);
        let estimate = estimate_of(rate_hz, &parts, options.order.highest(), known);
        (self.analysis.lags, self.analysis.bands) = (estimate.lags, estimate.bands);
    }
}

/// Returns whether lines are sought in a trial: it is in motion and contact, not silent and not dropped.
fn can_have_lines(trial: &Trial, analysis: &Analysis, options: &Options) -> bool {
    trial.is_in_motion_and_contact() && !analysis.is_silent() && !analysis.is_dropped(options)
}

/// Returns what lies of `ranges` within `stretch`, counted from its start.
fn within(ranges: &[Range<usize>], stretch: &Range<usize>) -> Vec<Range<usize>> {
    ranges
        .iter()
        .map(|own| own.start.max(stretch.start)..own.end.min(stretch.end))
        .filter(|own| !own.is_empty())
        .map(|own| own.start - stretch.start..own.end - stretch.start)
        .collect()
}
