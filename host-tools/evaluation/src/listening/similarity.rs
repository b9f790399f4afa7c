//! Ratings of how alike two sounds are, in an order that a Latin square balances.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::excerpts::{Sounds, TrialExcerpts, able};
use super::{Kind, Pair};

/// One rating: two different excerpts and their kinds. The pair's name has the kinds in the pair's order, whichever of
/// them is A.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Rating {
    pair: String,
    a: Kind,
    b: Kind,
    surface: String,
    sounds: [usize; 2],
}

/// All ratings of a test: every condition of the first block, then of the second, and so on. `orders` holds orders of
/// the conditions within a block. The listener numbered `n` begins with order `n`, and uses the next order in the next
/// block.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ratings {
    orders: Vec<Vec<usize>>,
    pub(super) trials: Vec<Rating>,
}

/// Returns the two kinds of each pair, and then each kind with itself. Noise is never exactly the same, so two excerpts
/// of one kind stand for "the same". Their rating is the best that a perfect texture can reach.
fn conditions(pairs: &[Pair]) -> Vec<[Kind; 2]> {
    let mut conditions: Vec<[Kind; 2]> = pairs.iter().map(|pair| pair.kinds()).collect();
    for kind in pairs.iter().flat_map(|pair| pair.kinds()) {
        if !conditions.contains(&[kind; 2]) {
            conditions.push([kind; 2]);
        }
    }
    conditions
}

/// Plans the ratings of `blocks` blocks, each on the next of the surfaces in `heard`, which have several takes. A and B
/// change places from one block to the next. Which is A in the first block is random for each condition.
pub(super) fn ratings(
    pairs: &[Pair],
    heard: &[Vec<TrialExcerpts>],
    blocks: usize,
    sounds: &mut Sounds,
    generator: &mut Pcg64,
) -> Ratings {
    let conditions = conditions(pairs);
    let coins: Vec<bool> = (conditions.iter()).map(|_| generator.random_bool(0.5)).collect();
    let mut trials = Vec::new();
    for block in 0..blocks {
        for (&kinds, coin) in conditions.iter().zip(&coins) {
            let able = able(heard, kinds);
            let (_, takes) = &able[block % able.len()];
            let heard = takes[block / able.len() % takes.len()];
            let [mut a, mut b] = kinds;
            if *coin == (block % 2 == 0) {
                std::mem::swap(&mut a, &mut b);
            }
            trials.push(Rating {
                pair: kinds.map(Kind::name).join("-"),
                a,
                b,
                surface: heard.surface.clone(),
                sounds: heard.drawn([a, b], sounds, generator),
            });
        }
    }
    Ratings {
        orders: latin_square(conditions.len()),
        trials,
    }
}

/// Returns a Latin square that is balanced for carry-over, after Williams (1949). Every condition occurs equally often
/// at every place, and equally often directly after every other condition. An odd number of conditions requires twice
/// as many rows.
fn latin_square(conditions: usize) -> Vec<Vec<usize>> {
    // The row 0, 1, n-1, 2, n-2, ...: modulo an even n its steps are all different, so each pair of neighbours occurs
    // once in the shifted rows. Modulo an odd n each step occurs twice, and the reversed rows add the opposite steps.
    let first = |place: usize| match place % 2 {
        0 => (conditions - place / 2) % conditions,
        _ => place.div_ceil(2),
    };
    let row = |shift: usize| (0..conditions).map(move |place| (first(place) + shift) % conditions);
    let mut rows: Vec<Vec<usize>> = (0..conditions).map(|shift| row(shift).collect()).collect();
    if conditions % 2 == 1 {
        rows.extend((0..conditions).map(|shift| row(shift).rev().collect()));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_condition_is_as_often_at_every_place_and_after_every_other() {
        for count in 1..9 {
            let rows = latin_square(count);
            let mut at = vec![vec![0; count]; count];
            let mut after = vec![vec![0; count]; count];
            for row in &rows {
                assert_eq!(row.len(), count);
                for (place, condition) in row.iter().enumerate() {
                    at[place][*condition] += 1;
                }
                for two in row.windows(2) {
                    after[two[0]][two[1]] += 1;
                }
            }
            let each = rows.len() / count;
            assert!(at.iter().flatten().all(|&times| times == each), "{rows:?}");
            for (before, row) in after.iter().enumerate() {
                for (next, &times) in row.iter().enumerate() {
                    assert_eq!(times, if before == next { 0 } else { each }, "{rows:?}");
                }
            }
        }
    }

    #[test]
    fn a_and_b_are_two_excerpts_of_their_kinds_and_change_places_from_block_to_block() {
        use rand::SeedableRng;
        let takes = vec![TrialExcerpts::made("denim, 120 mm/s, 1 N", 0)];
        let mut sounds = Sounds::default();
        let mut generator = Pcg64::seed_from_u64(4);
        let rated = ratings(&Pair::USUAL, &[takes], 8, &mut sounds, &mut generator);
        let names = ["recording-recording", "gaussian-gaussian", "fitted-fitted"].map(String::from);
        assert_eq!(rated.trials.len(), 8 * 6);
        for block in rated.trials.chunks(6) {
            for name in names.iter().chain(&Pair::USUAL.map(Pair::name)) {
                assert_eq!(block.iter().filter(|one| one.pair == *name).count(), 1);
            }
        }
        for (index, rating) in rated.trials.iter().enumerate() {
            let of = [(rating.a, rating.sounds[0]), (rating.b, rating.sounds[1])];
            // All kinds but recordings share a noise.
            let [a, b] = of.map(|(kind, n)| (kind == Kind::Recording, sounds.all()[n][1] as usize));
            assert_ne!(a, b);
            for (kind, sound) in [rating.a, rating.b].into_iter().zip(rating.sounds) {
                assert_eq!(sounds.all()[sound][0] as usize, kind as usize);
            }
            if let Some(next) = rated.trials.get(index + 6) {
                assert_eq!((rating.a, rating.b), (next.b, next.a));
            }
        }
    }
}
