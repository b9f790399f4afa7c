//! Trials of A, B and X.

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::excerpts::{Sounds, TrialExcerpts, able};
use super::{Kind, Pair};

/// One trial: three excerpts and their kinds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trial {
    /// The pair.
    pub pair: Pair,
    /// The kind of A.
    pub a: Kind,
    /// The kind of B.
    pub b: Kind,
    /// The kind of X: that of A, or that of B.
    pub x: Kind,
    /// Texture, speed and force.
    pub surface: String,
    /// Indices of the excerpts of A, B and X; all three differ.
    pub sounds: [usize; 3],
}

/// Plans `count` trials of each pair, in random order. `heard` has the takes of each surface at a speed and force.
/// Within a pair, and then among all trials, each of these is heard as often as the others, give or take one.
pub(super) fn trials(
    pairs: &[Pair],
    heard: &[Vec<TrialExcerpts>],
    count: usize,
    sounds: &mut Sounds,
    generator: &mut Pcg64,
) -> Vec<Trial> {
    let mut pairs = pairs.to_vec();
    // Pairs with more surfaces come later and even out what the others cannot.
    pairs.sort_by_key(|pair| able(heard, pair.kinds()).len());
    let mut times_of_all = vec![0; heard.len()];
    let mut trials = Vec::new();
    for pair in pairs {
        let able = able(heard, pair.kinds());
        let mut times = vec![0; heard.len()];
        for (x, is_a) in answers(pair, count, generator) {
            let rarest = |(surface, _): &&(usize, _)| (times[*surface], times_of_all[*surface]);
            let (surface, takes) = able.iter().min_by_key(rarest).expect("a surface has it");
            let heard = takes[times_of_all[*surface] % takes.len()];
            times[*surface] += 1;
            times_of_all[*surface] += 1;
            let [one, other] = pair.kinds();
            let (a, b) = if (x == one) == is_a { (one, other) } else { (other, one) };
            trials.push(Trial {
                pair,
                a,
                b,
                x,
                surface: heard.surface.clone(),
                sounds: heard.drawn([a, b, x], sounds, generator),
            });
        }
    }
    trials.shuffle(generator);
    trials
}

/// Returns the kind of X, and whether A is of this kind, for each of `count` trials in random order. Either is as often
/// as the other, give or take one, and so are all four combinations.
fn answers(pair: Pair, count: usize, generator: &mut Pcg64) -> Vec<(Kind, bool)> {
    let mut kinds = pair.kinds();
    kinds.shuffle(generator);
    let ([one, other], is_a) = (kinds, generator.random_bool(0.5));
    // Both change from the first to the second and from the third to the fourth, so that any count is balanced.
    let cycle = [(one, is_a), (other, !is_a), (one, !is_a), (other, is_a)];
    let mut answers: Vec<_> = cycle.into_iter().cycle().take(count).collect();
    // Random also within a pair, so that no answer belongs to a surface.
    answers.shuffle(generator);
    answers
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::hash::Hash;

    use proptest::prelude::*;
    use rand::SeedableRng;

    use super::*;
    use test_helpers::near;

    /// Trials on `surfaces` surfaces. Those of odd numbers have three takes, and the others have one.
    fn planned(seed: u64, pairs: &[Pair], count: usize, surfaces: usize) -> (Vec<Trial>, Sounds) {
        let mut generator = Pcg64::seed_from_u64(seed);
        let mut sounds = Sounds::default();
        let takes = |surface: usize| {
            let take = |n| TrialExcerpts::made(&format!("felt, {surface} mm/s, 1 N"), 3 * surface + n);
            (0..=2 * (surface % 2)).map(take).collect()
        };
        let heard: Vec<Vec<TrialExcerpts>> = (0..surfaces).map(takes).collect();
        let planned = trials(pairs, &heard, count, &mut sounds, &mut generator);
        (planned, sounds)
    }

    /// Whether each of `count` values of `property` is as frequent in `trials` as the others, give or take one.
    fn is_even<T: Hash + Eq>(trials: &[&Trial], count: usize, property: impl Fn(&Trial) -> T) -> bool {
        let mut times: HashMap<T, usize> = HashMap::new();
        for trial in trials {
            *times.entry(property(trial)).or_default() += 1;
        }
        let each = trials.len() / count..=trials.len().div_ceil(count);
        times.values().all(|times| each.contains(times)) && times.len() == count.min(trials.len())
    }

    proptest! {
        #[test]
        fn x_is_of_the_kind_of_a_or_b_and_no_two_sounds_are_of_one_window(
            seed: u64,
            pairs in prop::sample::select(vec![Pair::USUAL, Pair::WITH_BEFORE]),
        ) {
            let (trials, sounds) = planned(seed, &pairs, 10, 3);
            prop_assert_eq!(trials.len(), 30);
            for trial in &trials {
                let mut pair = trial.pair.kinds();
                prop_assert!(pair.contains(&trial.x));
                let mut played = [trial.a, trial.b];
                pair.sort_by_key(|kind| kind.name());
                played.sort_by_key(|kind| kind.name());
                prop_assert_eq!(pair, played);
                let kinds = [trial.a, trial.b, trial.x];
                let mut of = kinds.into_iter().zip(trial.sounds).map(|(kind, sound)| {
                    let samples = &sounds.all()[sound];
                    assert_eq!(samples[0] as usize, kind as usize);
                    // All kinds but recordings share a noise.
                    (kind == Kind::Recording, samples[1] as usize)
                });
                let (a, b, x) = (of.next(), of.next(), of.next());
                prop_assert!(a != b && b != x && a != x);
            }
        }

        #[test]
        fn answers_and_surfaces_are_as_even_as_their_number_allows(
            seed: u64,
            count in 1usize..30,
            surfaces in 1usize..8,
        ) {
            let (trials, _) = planned(seed, &Pair::USUAL, count, surfaces);
            let all: Vec<&Trial> = trials.iter().collect();
            prop_assert!(is_even(&all, surfaces, |t| t.surface.clone()));
            for pair in Pair::USUAL {
                let own: Vec<&Trial> = all.iter().copied().filter(|t| t.pair == pair).collect();
                prop_assert_eq!(own.len(), count);
                prop_assert!(is_even(&own, 2, |t| t.x));
                prop_assert!(is_even(&own, 2, |t| t.x == t.a));
                prop_assert!(is_even(&own, 4, |t| (t.x, t.x == t.a)));
                prop_assert!(is_even(&own, surfaces, |t| t.surface.clone()));
            }
        }
    }

    /// Neither the number of a trial nor the trial before it tells the answer, and no answer belongs to a surface.
    #[test]
    fn no_place_in_the_order_and_no_surface_tells_the_answer() {
        let tests: Vec<Vec<Trial>> = (0..400).map(|seed| planned(seed, &Pair::USUAL, 12, 4).0).collect();
        let is_a = |trial: &Trial| trial.x == trial.a;
        let share = |of: &[bool]| of.iter().filter(|is| **is).count() as f64 / of.len() as f64;
        for place in 0..36 {
            let at: Vec<bool> = tests.iter().map(|test| is_a(&test[place])).collect();
            assert!((share(&at) - 0.5).abs() < 0.1, "trial {place}: {}", share(&at));
        }
        let same = |test: &Vec<Trial>| {
            test.windows(2)
                .map(|two| is_a(&two[0]) == is_a(&two[1]))
                .collect::<Vec<_>>()
        };
        let repeated: Vec<bool> = tests.iter().flat_map(same).collect();
        // 18 of each in 36 trials repeat in 17 of 35.
        near(share(&repeated), 17.0 / 35.0, 0.02);
        for surface in 0..4 {
            let is_own = |t: &&Trial| t.surface == format!("felt, {surface} mm/s, 1 N");
            let own: Vec<bool> = tests.iter().flatten().filter(is_own).map(is_a).collect();
            assert!((share(&own) - 0.5).abs() < 0.05, "{surface}: {}", share(&own));
            let of_one = |test: &Vec<Trial>| {
                let own: Vec<bool> = test.iter().filter(is_own).map(is_a).collect();
                own.iter().all(|is| *is == own[0])
            };
            // Nine fair coins are alike in one of 256 tests.
            assert!(tests.iter().filter(|test| of_one(test)).count() < 20);
        }
    }
}
