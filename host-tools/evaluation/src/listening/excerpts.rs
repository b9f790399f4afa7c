//! Excerpts of signals, which a listener hears.

use std::f64::consts::PI;

use model_format::SAMPLE_RATE_HZ;

use super::kinds::Kind;

/// Excerpts of a trial of the set, by kind. `fitted` is empty if the fitted texture plays only Gaussian noise and no
/// other library is compared.
pub(super) struct Heard {
    pub surface: String,
    pub recording: Vec<Vec<f64>>,
    pub gaussian: Vec<Vec<f64>>,
    pub fitted: Vec<Vec<f64>>,
    pub before: Vec<Vec<f64>>,
}

impl Heard {
    pub fn of(&self, kind: Kind) -> &[Vec<f64>] {
        match kind {
            Kind::Recording => &self.recording,
            Kind::Gaussian => &self.gaussian,
            Kind::Fitted => &self.fitted,
            Kind::Before => &self.before,
        }
    }

    /// Returns whether a trial of these kinds is possible: each kind needs two excerpts.
    pub fn has(&self, kinds: [Kind; 2]) -> bool {
        kinds.iter().all(|kind| self.of(*kind).len() >= 2)
    }
}

/// The sounds of a page, each kept once.
#[derive(Debug, Default)]
pub(super) struct Sounds(Vec<Vec<f64>>);

impl Sounds {
    /// Returns the index of a sound. Adds the sound if it is new.
    pub fn index_of(&mut self, excerpt: &[f64]) -> usize {
        let known = self.0.iter().position(|sound| sound == excerpt);
        known.unwrap_or_else(|| {
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
pub(super) fn excerpts(blocks: &[&[f64]], samples: usize) -> Vec<Vec<f64>> {
    let parts = blocks.iter().flat_map(|block| block.chunks_exact(samples));
    parts.filter_map(levelled).collect()
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
    gain.is_finite()
        .then(|| part.iter().enumerate().map(sample).collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    impl Heard {
        /// Three excerpts of each kind, of two samples: the kind and their number.
        pub fn made() -> Self {
            let of = |kind: usize| {
                let excerpt = |n: usize| vec![kind as f64, n as f64];
                (0..3).map(excerpt).collect::<Vec<_>>()
            };
            Self {
                surface: "denim, 120 mm/s, 1 N".into(),
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
        let loud = (0..10_000).map(|n| 40.0 * (f64::from(n) * 0.3).sin() + 7.0);
        let loud: Vec<f64> = loud.collect();
        let soft: Vec<f64> = loud.iter().map(|x| x * 1e-4).collect();
        for signal in [loud, soft] {
            let found = excerpts(&[&signal], 5000);
            assert_eq!(found.len(), 2);
            for excerpt in found {
                let middle = &excerpt[100..4900];
                let rms = crate::dsp::sums::rms(middle);
                assert!((rms - 1.0).abs() < 0.01, "{rms}");
                assert!(excerpt[0].abs() < 1e-3 && excerpt[4999].abs() < 1e-3);
            }
        }
        assert_eq!(excerpts(&[&vec![3.0; 5000]], 1000), Vec::<Vec<f64>>::new());
    }
}
