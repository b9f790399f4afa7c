//! Orders within a budget of cycles per sample, and what they give up.
//!
//! The time of a sample is that of the highest order of a texture's nodes, wherever the hand is: so that the path of a
//! tick does not depend on the data, a frame has as many stages as any node of its texture. A
//! budget therefore bounds the highest order, and each node then takes, among the orders that the bound leaves, the one
//! with the least error to be expected of new data: by Akaike's criterion, as `fit` does without a bound. Cycles are
//! those of a sample at worst, of `cargo tasks costs`.

use model_format::NodeFlags;
use serde::Serialize;

use crate::dsp::linear_prediction::error_share;
use crate::dsp::log_spectrum::LogSpectrum;
use crate::dsp::model::Model;
use crate::dsp::spectrum::{DEFAULT_SMOOTHING_WIDTH_HZ, expected_cost_of_noise};
use crate::evaluation::frontier::FilterStructure;
use crate::evaluation::frontier::costs::{Core, Costs};
use crate::fit::{Fit, Order};
use crate::recording::TRIAL_DURATION_S;
use crate::support::error::{Error, Result};
use model_format::SAMPLE_RATE_HZ;

/// So many cycles for the synthesis of one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Cycles, at worst.
    pub cycles: f64,
    /// Of this core.
    pub core: Core,
}

/// The accuracy that a texture gives up for a budget.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Concession {
    /// The texture.
    pub texture: String,
    /// The highest order that the budget leaves.
    pub highest_order: usize,
    /// Nodes with a model of their own, those that are filled left out.
    pub nodes: usize,
    /// Number of them whose order the budget lowers.
    pub capped: usize,
    /// The lowest and the highest order that those would have; zero where there are none.
    pub orders_without: (usize, usize),
    /// Mean rise of the prediction error over those, dB.
    pub mean_error_rise_db: f64,
    /// The largest.
    pub largest_error_rise_db: f64,
    /// Speed, mm/s, and force, N, of that node.
    pub worst_node: Option<(f32, f32)>,
    /// Mean C to be expected at those, were nothing given up: that of a model of just this spectrum.
    pub expected_cost_without: f64,
    /// Mean C to be expected at those with what is given up.
    pub expected_cost: f64,
}

/// Nodes of the grids whose costs are looked up: the four around a motion. A sample takes the same over one.
const NODES: usize = 4;

impl Budget {
    /// The highest order that fits.
    ///
    /// # Errors
    /// A budget below what the least order takes, with what that is.
    pub fn highest_order(&self) -> Result<usize> {
        let (cycles, core) = (self.cycles, self.core);
        let found = Costs::measured().highest_order(
            FilterStructure::NormalisedLattice32,
            NODES,
            core,
            cycles,
        );
        found.map_err(|least| {
            Error::Request(match least {
                Some(least) => format!(
                    "a budget of {cycles} cycles holds no model: a sample takes {least:.0} at the \
                     least order on a {core}; give --budget-cycles {:.0} or more",
                    least.ceil()
                ),
                None => format!(
                    "no cost is known of it on a {core}; leave --budget-cycles out, or measure it with \
                     cargo tasks costs"
                ),
            })
        })
    }
}

/// Returns `order` within a budget that leaves orders up to `highest`.
pub fn capped(order: Order, highest: usize) -> Order {
    match order {
        // Thrift saves no time, because the budget is for the highest order.
        Order::Auto | Order::Bayesian => Order::AtMost(highest),
        Order::AtMost(order) => Order::AtMost(order.min(highest)),
        Order::Fixed(order) => Order::Fixed(order.min(highest)),
    }
}

/// Returns the accuracy that each texture of `within`, fitted with orders up to `highest_order`, gives up of `without`,
/// the same set fitted with no such bound.
pub fn concessions(without: &Fit, within: &Fit, highest_order: usize) -> Vec<Concession> {
    let textures = without.textures.iter().zip(&within.textures);
    let concession = textures.map(|(without, within)| {
        let filled = NodeFlags::SILENT
            .with(NodeFlags::INTERPOLATED)
            .with(NodeFlags::EXTRAPOLATED);
        let nodes: Vec<(f32, f32, &Model, &Model)> = without
            .grid
            .nodes()
            .zip(&within.grid.models)
            .filter(|((.., model), _)| model.flags.bits() & filled.bits() == 0)
            .map(|((speed, force, wanted), kept)| (speed, force, wanted, kept))
            .collect();
        let lowered = nodes
            .iter()
            .filter(|(.., wanted, kept)| kept.reflection.len() < wanted.reflection.len());
        let lowered: Vec<_> = lowered.collect();
        let order = |node: &&&(f32, f32, &Model, &Model)| node.2.reflection.len();
        let rises: Vec<f64> = lowered
            .iter()
            .map(|(.., wanted, kept)| error_rise_db(wanted, kept))
            .collect();
        let worst = (0..rises.len()).max_by(|&a, &b| rises[a].total_cmp(&rises[b]));
        let floor = expected_cost_of_noise(
            (TRIAL_DURATION_S * f64::from(SAMPLE_RATE_HZ)) as usize,
            f64::from(SAMPLE_RATE_HZ),
            DEFAULT_SMOOTHING_WIDTH_HZ,
        );
        let costs = lowered
            .iter()
            .map(|(.., wanted, kept)| floor.hypot(cost_of_giving_up(wanted, kept)));
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
            if count > 0.0 { sum / count } else { 0.0 }
        };
        Concession {
            texture: without.name.clone(),
            highest_order,
            nodes: nodes.len(),
            capped: lowered.len(),
            orders_without: (
                lowered.iter().map(|node| order(&node)).min().unwrap_or(0),
                lowered.iter().map(|node| order(&node)).max().unwrap_or(0),
            ),
            mean_error_rise_db: mean(&mut rises.iter().copied()),
            largest_error_rise_db: worst.map_or(0.0, |worst| rises[worst]),
            worst_node: worst.map(|worst| (lowered[worst].0, lowered[worst].1)),
            expected_cost_without: floor,
            expected_cost: if lowered.is_empty() {
                floor
            } else {
                mean(&mut costs.into_iter())
            },
        }
    });
    concession.collect()
}

/// Returns the power of the prediction error of `kept` over that of `wanted`, dB.
fn error_rise_db(wanted: &Model, kept: &Model) -> f64 {
    10.0 * (error_share(&kept.reflection) / error_share(&wanted.reflection)).log10()
}

/// C of the spectrum of `kept` against that of `wanted`, were all scatter smoothed away.
fn cost_of_giving_up(wanted: &Model, kept: &Model) -> f64 {
    let (wanted, kept) = (LogSpectrum::of_model(wanted), LogSpectrum::of_model(kept));
    wanted.cost(&kept, DEFAULT_SMOOTHING_WIDTH_HZ)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::spectrum::spectral_cost;
    use crate::evaluation::stress::reference::FloatLattice;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn a_larger_budget_holds_a_higher_order_and_none_holds_one_that_takes_more() {
        let mut before = 0;
        for thousands in 1..12u32 {
            let budget = Budget {
                cycles: 1000.0 * f64::from(thousands),
                core: Core::M4,
            };
            let order = budget.highest_order().unwrap();
            assert!(order >= before);
            let lattice = FilterStructure::NormalisedLattice32;
            let cost = Costs::measured().at(lattice, NODES, Core::M4, order);
            assert!(cost.unwrap().sample.cycles <= budget.cycles);
            before = order;
        }
        assert_eq!(before, model_format::limits::MAX_ORDER);
    }

    #[test]
    fn a_budget_that_holds_nothing_is_refused_with_the_least_that_would_do() {
        let refusal = |cycles| {
            let budget = Budget {
                cycles,
                core: Core::M4,
            };
            budget.highest_order()
        };
        let text = refusal(20.0).unwrap_err().to_string();
        let least = text.split("--budget-cycles ").nth(1).unwrap();
        let least: f64 = least.split(' ').next().unwrap().parse().unwrap();
        assert!(refusal(least).is_ok(), "{text}");
        assert!(refusal(least - 1.0).is_err(), "{text}");
    }

    /// The error foretold for a model of lower order equals the one measured between its noise and that of the full
    /// model.
    #[test]
    fn the_expected_cost_is_that_of_synthesised_noise() {
        let reflection = vec![-0.9, 0.7, -0.3, 0.5, -0.4, 0.3, 0.2, -0.35];
        let wanted = Model {
            reflection: reflection.clone(),
            output_power: 4.0,
            flags: NodeFlags::NONE,
        };
        let noise = |model: &Model, seed| -> Vec<f64> {
            let mut filter = FloatLattice::new(model.reflection.len());
            filter.reflect_by(&model.reflection);
            let generator = rand_pcg::Pcg64::seed_from_u64(seed);
            let excitation = StandardNormal.sample_iter(generator);
            let played = excitation.map(|e: f64| filter.filter(2.0 * e));
            played.skip(500).take(10_000).collect()
        };
        let floor = expected_cost_of_noise(10_000, 5000.0, DEFAULT_SMOOTHING_WIDTH_HZ);
        for order in [3, 5, 8] {
            let kept = Model {
                reflection: reflection[..order].to_vec(),
                ..wanted.clone()
            };
            let expected = floor.hypot(cost_of_giving_up(&wanted, &kept));
            let runs = 8u64;
            let measured: f64 = (0..runs)
                .map(|run| {
                    let (a, b) = (noise(&wanted, 2 * run), noise(&kept, 2 * run + 1));
                    spectral_cost(&a, &b, 5000.0, DEFAULT_SMOOTHING_WIDTH_HZ).unwrap()
                })
                .sum::<f64>()
                / runs as f64;
            println!("order {order}: expected {expected:.3}, measured {measured:.3}");
            assert!(
                (expected - measured).abs() < 0.1 * measured,
                "order {order}: {expected} {measured}"
            );
        }
    }
}
