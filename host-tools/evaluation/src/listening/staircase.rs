//! Adaptive staircases on the strength of a part: two right answers in a row make the next trial harder, one wrong
//! answer makes it easier. So they converge where two right answers in a row have a probability of one half, that is at
//! 70.7 % of right answers (Levitt, "Transformed up-down methods in psychoacoustics", 1971).
//!
//! A trial has A, B and X. One of A and B is the reference, and the other is changed. The page adapts the strength to
//! the answers; all random choices are made here.

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::Serialize;
use stylus_dsp::sums::mean_square;

use super::excerpts::{SHORTEST_EXCERPT_S, Sounds, WINDOWS, excerpts};

/// A part of a texture whose strength is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// The level: the texture as fitted against the same, louder by so many decibels.
    Level,
    /// The recording's own excitation: Gaussian noise through the filter against a mixture of both
    /// with that share of power. Lines are left out.
    Codebook,
    /// The lines that are tied to position: the texture without them against the texture with that share of their
    /// power.
    Lines,
}

impl Part {
    /// All parts.
    pub const ALL: [Self; 3] = [Self::Level, Self::Codebook, Self::Lines];

    /// The part's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Level => "level",
            Self::Codebook => "codebook",
            Self::Lines => "lines",
        }
    }

    /// Returns the unit and the greatest of the strengths, and the ratio of each strength to the next smaller one. With
    /// wider steps, staircases of simulated listeners end at 65 % of right answers instead of 70.7 %.
    fn grid(self) -> (&'static str, f64, f64) {
        match self {
            Self::Level => ("dB", 8.0, 2f64.powf(0.25)),
            Self::Codebook => ("power share", 1.0, 2f64.powf(0.25)),
            // A quarter octave of the lines' amplitude.
            Self::Lines => ("power share", 1.0, 2f64.sqrt()),
        }
    }

    /// Returns the strengths, rising. They are spaced geometrically, because differences are perceived that way.
    fn strengths(self) -> Vec<f64> {
        let (_, greatest, ratio) = self.grid();
        let strength = |n: i32| greatest * ratio.powi(n + 1 - STRENGTHS);
        (0..STRENGTHS).map(strength).collect()
    }
}

/// Number of strengths of a grid.
const STRENGTHS: i32 = 17;

/// Rule of a staircase. It ends after `reversals` reversals. A step covers two strengths until the `coarse_reversals`
/// are over. The threshold is the geometric mean of the strengths at the last `averaged_reversals` reversals.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Rule {
    reversals: usize,
    coarse_reversals: usize,
    averaged_reversals: usize,
}

/// Random choices of a trial: whether A or B is changed, the other being the reference; whether X is changed; and the
/// windows of A, B and X.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Coin {
    a_is_changed: bool,
    x_is_changed: bool,
    windows: [usize; WINDOWS],
}

/// A staircase: the sounds of the reference and of each strength, by window, and the random choices of each possible
/// trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Track {
    part: Part,
    unit: &'static str,
    surface: String,
    strengths: Vec<f64>,
    reference: Vec<usize>,
    changed: Vec<Vec<usize>>,
    coins: Vec<Coin>,
}

/// All staircases of a test, which take turns.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Staircases {
    rule: Rule,
    tracks: Vec<Track>,
}

impl Staircases {
    pub(super) fn of(tracks: Vec<Track>) -> Self {
        let rule = Rule {
            reversals: 12,
            coarse_reversals: 2,
            averaged_reversals: 8,
        };
        Self { rule, tracks }
    }

    pub(super) fn most_trials(&self) -> usize {
        self.tracks.iter().map(|track| track.coins.len()).sum()
    }
}

/// Signals of a texture at one speed and force, with one seed: as fitted, without its lines, and as Gaussian noise. If
/// the texture lacks a part, the signals with and without it are equal.
pub(super) struct Strands {
    pub surface: String,
    pub fitted: Vec<f64>,
    pub without_lines: Vec<f64>,
    pub gaussian: Vec<f64>,
    pub has_codebook: bool,
    pub has_lines: bool,
}

impl Strands {
    fn has(&self, part: Part) -> bool {
        match part {
            Part::Level => true,
            Part::Codebook => self.has_codebook,
            Part::Lines => self.has_lines,
        }
    }

    /// Returns the signal at `strength` of `part`, before its level is set. At 0 it is the reference.
    fn at(&self, part: Part, strength: f64) -> Vec<f64> {
        let mixed =
            |a: &[f64], of_a: f64, b: &[f64], of_b: f64| (a.iter().zip(b).map(|(a, b)| of_a * a + of_b * b)).collect();
        match part {
            Part::Level => self.fitted.clone(),
            Part::Codebook => {
                let (own, noise) = (&self.without_lines, &self.gaussian);
                // Both get the same power, so the strength is the fraction of power.
                let gain = (mean_square(noise) / mean_square(own)).sqrt();
                mixed(own, gain * strength.sqrt(), noise, (1.0 - strength).sqrt())
            }
            // The two signals differ only in the lines.
            Part::Lines => {
                let of_lines = strength.sqrt();
                mixed(&self.fitted, of_lines, &self.without_lines, 1.0 - of_lines)
            }
        }
    }

    /// The excerpts at `strength` of `part`, one for each window; `None` if one would be silent or too short.
    fn excerpts(&self, part: Part, strength: f64, seconds: f64) -> Option<Vec<Vec<f64>>> {
        let rate_hz = f64::from(model_format::SAMPLE_RATE_HZ);
        let signal = self.at(part, strength);
        let samples = (signal.len() / WINDOWS).min((seconds * rate_hz) as usize);
        if (samples as f64) < SHORTEST_EXCERPT_S * rate_hz {
            return None;
        }
        let mut heard: Vec<Vec<f64>> = excerpts(&[&signal[..WINDOWS * samples]], samples)
            .into_iter()
            .map(|one| one.samples)
            .collect();
        // All excerpts have an RMS of 1 here, so that this gain is the whole difference.
        if part == Part::Level {
            let gain = 10f64.powf(strength / 20.0);
            heard.iter_mut().flatten().for_each(|x| *x *= gain);
        }
        (heard.len() == WINDOWS).then_some(heard)
    }
}

/// Plans the staircase of `part` with the signals `strands`, of at most `trials` trials. Returns `None` if the signals
/// lack the part, are too short or are silent in a window.
pub(super) fn track(
    part: Part,
    strands: &Strands,
    seconds: f64,
    trials: usize,
    sounds: &mut Sounds,
    generator: &mut Pcg64,
) -> Option<Track> {
    if !strands.has(part) {
        return None;
    }
    let strengths = part.strengths();
    let mut kept = |strength: f64| -> Option<Vec<usize>> {
        let heard = strands.excerpts(part, strength, seconds)?;
        Some(heard.iter().map(|one| sounds.index_of(one)).collect())
    };
    // All sounds are made here, and the page only chooses among them.
    let reference = kept(0.0)?;
    let changed = strengths.iter().map(|s| kept(*s)).collect::<Option<_>>()?;
    let coins = (0..trials).map(|_| {
        let mut windows = [0, 1, 2];
        windows.shuffle(generator);
        Coin {
            a_is_changed: generator.random_bool(0.5),
            x_is_changed: generator.random_bool(0.5),
            windows,
        }
    });
    Some(Track {
        part,
        unit: part.grid().0,
        surface: strands.surface.clone(),
        coins: coins.collect(),
        strengths,
        reference,
        changed,
    })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use test_helpers::near;

    /// Noise of two kinds, and a line at 500 Hz of the power of the first.
    fn strands() -> Strands {
        let mut generator = Pcg64::seed_from_u64(8);
        let mut noise = || (0..9000).map(|_| generator.random_range(-1.0..1.0)).collect();
        let [gaussian, without_lines]: [Vec<f64>; 2] = [noise(), noise()];
        let line = |n: usize| (n as f64 * 0.2 * std::f64::consts::PI).sin() * (2f64 / 3.0).sqrt();
        Strands {
            surface: "weave, 100 mm/s, 1 N".into(),
            fitted: (0..9000).map(|n| without_lines[n] + line(n)).collect(),
            without_lines,
            gaussian,
            has_codebook: true,
            has_lines: true,
        }
    }

    fn decibels(ratio: f64) -> f64 {
        10.0 * ratio.log10()
    }

    /// Returns the fraction of `signal`'s power that lies along `direction`.
    fn share(signal: &[f64], direction: &[f64]) -> f64 {
        let along: f64 = signal.iter().zip(direction).map(|(a, b)| a * b).sum();
        (along / signal.len() as f64).powi(2) / mean_square(direction) / mean_square(signal)
    }

    #[test]
    fn a_strength_is_the_share_of_power_or_the_step_of_level_that_it_says() {
        let strands = strands();
        let quiet = strands.excerpts(Part::Level, 0.0, 0.5).unwrap();
        for (strength, word) in [(8.0, "loud"), (0.25, "hardly")] {
            let loud = strands.excerpts(Part::Level, strength, 0.5).unwrap();
            let found = decibels(mean_square(&loud[1]) / mean_square(&quiet[1]));
            assert!((found - strength).abs() < 1e-9, "{word}: {found}");
        }
        for strength in [0.03, 0.3, 0.8] {
            let mixed = strands.at(Part::Codebook, strength);
            let found = share(&mixed, &strands.without_lines);
            near(found, strength, 0.03);
            let (own, all) = (&strands.without_lines, strands.at(Part::Lines, strength));
            let line = |whole: &[f64]| mean_square(&whole.iter().zip(own).map(|(a, b)| a - b).collect::<Vec<_>>());
            let found = line(&all) / line(&strands.fitted);
            near(found, strength, 1e-9);
        }
        assert_eq!(strands.at(Part::Lines, 1.0), strands.fitted);
        assert_eq!(strands.at(Part::Codebook, 0.0), strands.gaussian);
    }

    #[test]
    fn all_but_the_level_have_one_rms_and_no_trial_has_a_window_twice() {
        let (strands, mut sounds) = (strands(), Sounds::default());
        let mut generator = Pcg64::seed_from_u64(1);
        let mut made = |part| track(part, &strands, 0.5, 200, &mut sounds, &mut generator).unwrap();
        let tracks = Part::ALL.map(&mut made);
        for track in &tracks {
            let (strengths, all) = (&track.strengths, sounds.all());
            assert!(strengths.windows(2).all(|two| two[0] < two[1]));
            let (_, greatest, _) = track.part.grid();
            near(strengths[strengths.len() - 1], greatest, 1e-9);
            for (strength, changed) in strengths.iter().zip(&track.changed) {
                for (one, other) in track.reference.iter().zip(changed) {
                    assert_ne!(one, other);
                    let louder = decibels(mean_square(&all[*other]) / mean_square(&all[*one]));
                    let expected = if track.part == Part::Level { *strength } else { 0.0 };
                    assert!((louder - expected).abs() < 0.2, "{}: {louder}", track.part.name());
                }
            }
            for coin in &track.coins {
                let [a, b, x] = coin.windows;
                assert!(a != b && b != x && a != x);
            }
            let changed = track.coins.iter().filter(|coin| coin.a_is_changed == coin.x_is_changed);
            assert!((70..130).contains(&changed.count()));
        }
        let plain = Strands {
            has_lines: false,
            ..strands
        };
        assert_eq!(track(Part::Lines, &plain, 0.5, 9, &mut sounds, &mut generator), None);
    }
}
