//! Excerpts of signals, which a listener hears.

use std::f64::consts::PI;

use model_format::SAMPLE_RATE_HZ;
use rand::seq::IndexedRandom;
use rand_pcg::Pcg64;

use super::Kind;

/// Number of sounds of a trial, of which no two may be from the same window of one noise.
pub(super) const WINDOWS: usize = 3;

/// An excerpt of a signal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Excerpt {
    /// Number of the window in time from which it is.
    pub window: usize,
    pub samples: Vec<f64>,
}

/// Excerpts of a trial of the set, by kind. `fitted` is empty if the fitted texture plays only Gaussian noise and no
/// other library is compared.
pub(super) struct TrialExcerpts {
    pub surface: String,
    pub recording: Vec<Excerpt>,
    pub gaussian: Vec<Excerpt>,
    pub fitted: Vec<Excerpt>,
    pub before: Vec<Excerpt>,
}

impl TrialExcerpts {
    fn of(&self, kind: Kind) -> &[Excerpt] {
        match kind {
            Kind::Recording => &self.recording,
            Kind::Gaussian => &self.gaussian,
            Kind::Fitted => &self.fitted,
            Kind::Before => &self.before,
        }
    }

    /// Returns whether a trial of these kinds is possible: each kind needs two excerpts, and kinds that share a noise
    /// need three.
    pub fn has(&self, kinds: [Kind; 2]) -> bool {
        let has_recording = kinds.contains(&Kind::Recording);
        let least = if has_recording { 2 } else { WINDOWS };
        kinds.iter().all(|kind| self.of(*kind).len() >= least)
    }

    /// Draws an excerpt of each of `kinds`, which are of a pair that this [has](Self::has). Returns their indices.
    ///
    /// All synthetic kinds are played with one seed. In the same window they have the same noise, by which a listener
    /// could recognise X. So no two excerpts are from the same window of the recording, or of the syntheses.
    pub fn drawn<const N: usize>(&self, kinds: [Kind; N], sounds: &mut Sounds, generator: &mut Pcg64) -> [usize; N] {
        let mut taken = Vec::new();
        kinds.map(|kind| {
            let source = |excerpt: &Excerpt| (kind == Kind::Recording, excerpt.window);
            let free: Vec<&Excerpt> = self
                .of(kind)
                .iter()
                .filter(|one| !taken.contains(&source(one)))
                .collect();
            let drawn = free.choose(generator).expect("a trial has fewer sounds");
            taken.push(source(drawn));
            sounds.index_of(&drawn.samples)
        })
    }
}

/// Returns the surfaces that have a take with excerpts of `kinds`: the index of each in `heard`, and these takes.
pub(super) fn able(heard: &[Vec<TrialExcerpts>], kinds: [Kind; 2]) -> Vec<(usize, Vec<&TrialExcerpts>)> {
    heard
        .iter()
        .enumerate()
        .map(|(surface, takes)| {
            let takes = takes.iter().filter(|take| take.has(kinds));
            (surface, takes.collect::<Vec<_>>())
        })
        .filter(|(_, takes)| !takes.is_empty())
        .collect()
}

/// The sounds of a page, each kept once.
#[derive(Debug, Default)]
pub(super) struct Sounds(Vec<Vec<f64>>);

impl Sounds {
    /// Returns the index of a sound. Adds the sound if it is new.
    pub fn index_of(&mut self, excerpt: &[f64]) -> usize {
        self.0.iter().position(|sound| sound == excerpt).unwrap_or_else(|| {
            self.0.push(excerpt.to_vec());
            self.0.len() - 1
        })
    }

    /// All sounds.
    pub fn all(&self) -> &[Vec<f64>] {
        &self.0
    }
}

/// Duration of the fade at each end of an excerpt, s. It is short, but long enough to avoid clicks.
pub const FADE_S: f64 = 0.02;

/// Shortest excerpt, s. A shorter one would be mostly fades.
pub const SHORTEST_EXCERPT_S: f64 = 0.2;

/// Returns the number of samples of an excerpt of at most `seconds`, such that `blocks` hold at least two excerpts
/// without overlap. Returns `None` if these would be shorter than [`SHORTEST_EXCERPT_S`].
pub(super) fn samples(blocks: &[Vec<f64>], seconds: f64) -> Option<usize> {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let mut lengths: Vec<usize> = blocks.iter().map(Vec::len).collect();
    lengths.sort_unstable();
    let longest = lengths.pop()?;
    // Both excerpts are in the longest block, or one is in it and one in the second longest.
    let most = (longest / 2).max(lengths.pop().unwrap_or(0));
    let samples = most.min((seconds * rate_hz) as usize);
    (samples as f64 >= SHORTEST_EXCERPT_S * rate_hz).then_some(samples)
}

/// Cuts a signal in blocks into adjacent excerpts of `samples` samples. Each has an RMS of 1 about its mean before its
/// ends are faded. Silent excerpts are left out.
pub(super) fn excerpts(blocks: &[&[f64]], samples: usize) -> Vec<Excerpt> {
    let parts = blocks.iter().flat_map(|block| block.chunks_exact(samples));
    let excerpt = |(window, part)| levelled(part).map(|samples| Excerpt { window, samples });
    parts.enumerate().filter_map(excerpt).collect()
}

fn levelled(part: &[f64]) -> Option<Vec<f64>> {
    let mean = part.iter().sum::<f64>() / part.len() as f64;
    let square = part.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / part.len() as f64;
    let gain = 1.0 / square.sqrt();
    let fade = (FADE_S * f64::from(SAMPLE_RATE_HZ)) as usize;
    let weight = |n: usize| {
        let from_end = n.min(part.len() - 1 - n);
        if from_end < fade {
            0.5 - 0.5 * (PI * (from_end as f64 + 0.5) / fade as f64).cos()
        } else {
            1.0
        }
    };
    let sample = |(n, x): (usize, &f64)| (x - mean) * gain * weight(n);
    // The gain of silence is infinite.
    gain.is_finite().then(|| part.iter().enumerate().map(sample).collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use test_helpers::near;

    impl TrialExcerpts {
        /// Three excerpts of each kind, of three samples: the kind, their window, and the number `take`.
        pub fn made(surface: &str, take: usize) -> Self {
            let of = |kind: usize| {
                let excerpt = |window: usize| Excerpt {
                    window,
                    samples: [kind, window, take].map(|number| number as f64).into(),
                };
                (0..3).map(excerpt).collect::<Vec<_>>()
            };
            Self {
                surface: surface.into(),
                recording: of(0),
                gaussian: of(1),
                fitted: of(2),
                before: of(3),
            }
        }
    }

    proptest! {
        #[test]
        fn two_excerpts_fit_side_by_side(
            lengths in prop::collection::vec(0usize..30_000, 0..6),
            seconds in 0.2..5.0f64,
        ) {
            let blocks: Vec<Vec<f64>> = lengths
                .iter()
                .map(|&len| (0..len).map(|n| (n as f64 * 0.7).sin()).collect())
                .collect();
            if let Some(samples) = samples(&blocks, seconds) {
                let slices: Vec<&[f64]> = blocks.iter().map(Vec::as_slice).collect();
                prop_assert!(excerpts(&slices, samples).len() >= 2);
                prop_assert!(samples <= (seconds * 5000.0) as usize);
            }
        }
    }

    #[test]
    fn excerpts_have_one_rms_and_begin_and_end_near_zero() {
        let loud: Vec<f64> = (0..10_000).map(|n| 40.0 * (f64::from(n) * 0.3).sin() + 7.0).collect();
        let soft: Vec<f64> = loud.iter().map(|x| x * 1e-4).collect();
        for signal in [loud, soft] {
            let found = excerpts(&[&signal], 5000);
            assert_eq!(found.len(), 2);
            for Excerpt { samples: excerpt, .. } in found {
                let middle = &excerpt[100..4900];
                let rms = stylus_dsp::sums::rms(middle);
                near(rms, 1.0, 0.01);
                assert!(excerpt[0].abs() < 1e-3 && excerpt[4999].abs() < 1e-3);
            }
        }
        assert_eq!(excerpts(&[&vec![3.0; 5000]], 1000), []);
    }

    #[test]
    fn a_silent_window_moves_no_other_to_its_place() {
        let mut signal: Vec<f64> = (0..4000).map(|n| (f64::from(n) * 0.3).sin()).collect();
        signal[1000..2000].fill(0.0);
        let found = excerpts(&[&signal], 1000);
        let windows: Vec<usize> = found.iter().map(|one| one.window).collect();
        assert_eq!(windows, [0, 2, 3]);
    }
}
