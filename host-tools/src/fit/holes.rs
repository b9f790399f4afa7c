//! Models for the nodes of a grid that were not recorded, from those that were.

use model_format::{LevelLaw, NodeFlags};

use crate::dsp::model::Model;

/// Fills holes from the nodes that were measured, and from those only, so that the order of filling does not matter.
pub(super) struct Filler {
    /// Speeds of the grid.
    pub speeds: usize,
    /// Forces of the grid.
    pub forces: usize,
    /// Measured models, all forces of the first speed first.
    pub known: Vec<Option<Model>>,
}

impl Filler {
    /// Returns the model at node `index`: the measured one, or one filled in.
    pub fn model(&self, index: usize) -> Model {
        let at = (index / self.forces, index % self.forces);
        match &self.known[index] {
            Some(model) if model.is_silent() => Model {
                // The way to silence keeps the timbre of its surroundings: only the level goes to zero.
                reflection: self.nearest(at, |m| !m.is_silent()).reflection,
                ..model.clone()
            },
            Some(model) => model.clone(),
            None => self.filled(at),
        }
    }

    fn filled(&self, at: (usize, usize)) -> Model {
        let lines = [self.along_speed(at), self.along_force(at)];
        let pairs: Vec<_> = lines.into_iter().flatten().collect();
        if pairs.is_empty() {
            let nearest = self.nearest(at, |_| true);
            let flags = nearest.flags.with(NodeFlags::EXTRAPOLATED);
            return Model { flags, ..nearest };
        }
        // The error of a straight line between two points goes with the product of the distances to them.
        let weight = |pair: &Bracket<'_>| 1.0 / (pair.before.0 * pair.after.0) as f64;
        let total: f64 = pairs.iter().map(weight).sum();
        let mut terms = Vec::new();
        for pair in &pairs {
            let share = weight(pair) / total;
            let (before, after) = (pair.before.0 as f64, pair.after.0 as f64);
            terms.push((share * after / (before + after), pair.before.1));
            terms.push((share * before / (before + after), pair.after.1));
        }
        let mean = Model::mean(&terms, LevelLaw::Logarithm);
        let flags = mean.flags.with(NodeFlags::INTERPOLATED);
        Model { flags, ..mean }
    }

    fn along_speed(&self, (speed, force): (usize, usize)) -> Option<Bracket<'_>> {
        self.bracket(speed, self.speeds, |s| s * self.forces + force)
    }

    fn along_force(&self, (speed, force): (usize, usize)) -> Option<Bracket<'_>> {
        self.bracket(force, self.forces, |f| speed * self.forces + f)
    }

    /// The nearest measured nodes on both sides of `at` on a line of `length` nodes.
    fn bracket(
        &self,
        at: usize,
        length: usize,
        index: impl Fn(usize) -> usize,
    ) -> Option<Bracket<'_>> {
        let known = |position: usize| self.known[index(position)].as_ref();
        let before = (0..at).rev().find_map(|p| Some((at - p, known(p)?)))?;
        let after = (at + 1..length).find_map(|p| Some((p - at, known(p)?)))?;
        Some(Bracket { before, after })
    }

    /// The mean of the measured nodes, of those that are `wanted`, that are least steps away; silence if there is none.
    fn nearest(&self, (speed, force): (usize, usize), wanted: impl Fn(&Model) -> bool) -> Model {
        let distance = |index: usize| {
            let (s, f) = (index / self.forces, index % self.forces);
            s.abs_diff(speed).pow(2) + f.abs_diff(force).pow(2)
        };
        let candidates: Vec<(usize, &Model)> = self
            .known
            .iter()
            .enumerate()
            .filter_map(|(index, model)| Some((distance(index), model.as_ref()?)))
            .filter(|(_, model)| wanted(model))
            .collect();
        let Some(least) = candidates.iter().map(|(distance, _)| *distance).min() else {
            return Model::silent();
        };
        let nearest: Vec<&Model> = candidates
            .into_iter()
            .filter(|&(distance, _)| distance == least)
            .map(|(_, model)| model)
            .collect();
        let weight = 1.0 / nearest.len() as f64;
        let terms: Vec<_> = nearest.into_iter().map(|model| (weight, model)).collect();
        Model::mean(&terms, LevelLaw::Logarithm)
    }
}

/// Measured nodes on both sides of a hole, each with its distance in nodes.
struct Bracket<'a> {
    before: (usize, &'a Model),
    after: (usize, &'a Model),
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn model(k: f64, power: f64) -> Model {
        Model {
            reflection: vec![k, -k / 2.0],
            output_power: power,
            flags: NodeFlags::NONE,
        }
    }

    fn filler(speeds: usize, forces: usize, known: Vec<Option<Model>>) -> Filler {
        Filler {
            speeds,
            forces,
            known,
        }
    }

    #[test]
    fn a_hole_between_two_nodes_is_their_mean_and_says_so() {
        let filler = filler(
            3,
            1,
            vec![Some(model(0.1, 1.0)), None, Some(model(0.5, 4.0))],
        );
        let filled = filler.model(1);
        let expected = f64::midpoint(0.1f64.asin(), 0.5f64.asin()).sin();
        assert!((filled.reflection[0] - expected).abs() < 1e-12);
        assert!((filled.output_power - 2.0).abs() < 1e-12);
        assert_eq!(filled.flags, NodeFlags::INTERPOLATED);
    }

    #[test]
    fn beyond_the_last_node_the_nearest_is_taken_over_and_says_so() {
        let filler = filler(
            1,
            3,
            vec![Some(model(0.1, 1.0)), Some(model(0.5, 4.0)), None],
        );
        let filled = filler.model(2);
        assert!((filled.reflection[0] - 0.5).abs() < 1e-12);
        assert_eq!(filled.flags, NodeFlags::EXTRAPOLATED);
    }

    #[test]
    fn a_silent_node_keeps_its_neighbours_timbre() {
        let filler = filler(1, 2, vec![Some(Model::silent()), Some(model(0.5, 4.0))]);
        let silent = filler.model(0);
        assert!(silent.output_power.abs() <= 0.0 && silent.flags == NodeFlags::SILENT);
        assert!((silent.reflection[0] - 0.5).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn every_filled_grid_is_whole_and_stable(
            known in prop::collection::vec(prop::option::of((-0.999f64..0.999, 0.0f64..10.0)), 24),
        ) {
            prop_assume!(known.iter().any(Option::is_some));
            let known: Vec<_> = known.into_iter().map(|node| node.map(|(k, power)| {
                if power < 1.0 { Model::silent() } else { model(k, power) }
            })).collect();
            let filler = filler(6, 4, known.clone());
            for (index, known) in known.iter().enumerate() {
                let filled = filler.model(index);
                prop_assert!(filled.reflection.iter().all(|k| k.abs() < 1.0));
                prop_assert!(filled.output_power >= 0.0);
                prop_assert_eq!(filled.is_silent(), filled.output_power <= 0.0);
                if let Some(known) = known && !known.is_silent() {
                    prop_assert_eq!(&filled, known);
                }
            }
        }
    }
}
