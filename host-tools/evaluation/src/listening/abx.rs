//! Trials of A, B and X.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::excerpts::{Heard, Sounds};
use super::kinds::{Kind, Pair};

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

/// Plans a trial of `pair`. The order of A and B and the kind of X are random, and no excerpt occurs twice in the
/// trial.
pub(super) fn trial(
    pair: Pair,
    heard: &Heard,
    sounds: &mut Sounds,
    generator: &mut Pcg64,
) -> Trial {
    let [mut a, mut b] = pair.kinds();
    if generator.random_bool(0.5) {
        std::mem::swap(&mut a, &mut b);
    }
    let x = if generator.random_bool(0.5) { a } else { b };
    let (own, other) = (heard.of(x), heard.of(if x == a { b } else { a }));
    let shown = generator.random_range(0..own.len());
    // X is another excerpt than the one shown as A or B.
    let as_x = (shown + generator.random_range(1..own.len())) % own.len();
    let beside = generator.random_range(0..other.len());
    let [own, as_x, other] =
        [&own[shown], &own[as_x], &other[beside]].map(|excerpt| sounds.index_of(excerpt));
    Trial {
        pair,
        a,
        b,
        x,
        surface: heard.surface.clone(),
        sounds: if x == a {
            [own, other, as_x]
        } else {
            [other, own, as_x]
        },
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::SeedableRng;

    use super::*;

    fn planned(seed: u64, count: usize) -> (Vec<Trial>, Vec<Vec<f64>>) {
        let mut generator = Pcg64::seed_from_u64(seed);
        let mut sounds = Sounds::default();
        let trials = (0..count)
            .map(|n| {
                let pair = Pair::WITH_BEFORE[n % 3];
                trial(pair, &Heard::made(), &mut sounds, &mut generator)
            })
            .collect();
        (trials, sounds.all().to_vec())
    }

    proptest! {
        #[test]
        fn x_is_another_excerpt_of_the_kind_of_a_or_b(seed: u64) {
            let (trials, sounds) = planned(seed, 30);
            for trial in &trials {
                prop_assert!(trial.x == trial.a || trial.x == trial.b);
                let kinds = [trial.a, trial.b, trial.x];
                for (kind, sound) in kinds.into_iter().zip(trial.sounds) {
                    prop_assert_eq!(sounds[sound][0] as usize, kind as usize);
                }
                let [a, b, x] = trial.sounds;
                prop_assert!(a != b && b != x && a != x);
                let mut pair = trial.pair.kinds().map(Kind::name);
                let mut played = [trial.a, trial.b].map(Kind::name);
                pair.sort_unstable();
                played.sort_unstable();
                prop_assert_eq!(pair, played);
            }
        }

        #[test]
        fn a_seed_decides_all(seed: u64) {
            prop_assert_eq!(planned(seed, 12), planned(seed, 12));
        }
    }

    #[test]
    fn coins_are_fair() {
        let (trials, _) = planned(5, 4000);
        let share = |is: fn(&Trial) -> bool| {
            trials.iter().filter(|trial| is(trial)).count() as f64 / trials.len() as f64
        };
        for share in [
            share(|trial| trial.x == trial.a),
            share(|trial| trial.a == trial.pair.kinds()[0]),
            share(|trial| (trial.x == trial.a) == (trial.a == trial.pair.kinds()[0])),
        ] {
            assert!((share - 0.5).abs() < 0.04, "{share}");
        }
    }
}
