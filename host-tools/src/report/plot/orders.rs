//! The cost of a model by its order.

use plotters::prelude::*;

use super::canvas::{
    Axis, COST, INK, Mark, ORDER, Stroke, Swatch, Ticks, at, axes, legend, line, picture,
    range_with_zero,
};
use super::colours::SERIES;
use super::figure::{Kind, Series};
use super::{Caption, Svg};
use crate::support::error::Result;

/// The cost of one recording's or texture's models by their order.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderSeries<'a> {
    /// Name of the series.
    pub name: &'a str,
    /// (order, cost C as a fraction), orders ascending.
    pub costs: &'a [(usize, f64)],
    /// The order that was chosen, which is ringed; anywhere between those of `costs`.
    pub chosen: Option<usize>,
}

/// The paper's figure 8: cost against order, for several surfaces, with the chosen orders ringed.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn order_against_cost(caption: &Caption<'_>, series: &[OrderSeries<'_>]) -> Result<Svg> {
    // Past the last colour they come again, dashed.
    let look = |index: usize| (SERIES[index % SERIES.len()], index / SERIES.len() % 2 == 1);
    let names: Vec<String> = series
        .iter()
        .map(|series| match series.chosen {
            Some(order) => format!("{} (order {order})", series.name),
            None => series.name.to_owned(),
        })
        .collect();
    let mut entries: Vec<(Swatch, &str)> = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let (colour, dashed) = look(index);
        let costs = series[index].costs.iter();
        if costs.filter(|cost| cost.1.is_finite()).count() > 0 {
            entries.push((Swatch::Line { colour, dashed }, name));
        }
    }
    let chosen = |series: &OrderSeries<'_>| {
        let order = series.chosen?;
        let cost = cost_at(series.costs, order).filter(|cost| cost.is_finite())?;
        Some((order as f64, 100.0 * cost))
    };
    if series.iter().any(|series| chosen(series).is_some()) {
        entries.push((Swatch::Mark(Mark::Ring), "the library's order there"));
    }
    let orders = series
        .iter()
        .flat_map(|series| series.costs.iter().map(|cost| cost.0 as f64));
    let costs = series
        .iter()
        .flat_map(|series| series.costs.iter().map(|cost| 100.0 * cost.1));
    let x = Axis {
        range: range_with_zero(orders),
        quantity: ORDER,
        ticks: Ticks::Numbers(12),
    };
    let y = Axis {
        range: range_with_zero(costs),
        quantity: COST,
        ticks: Ticks::Numbers(8),
    };
    picture(caption, (960, 400), |area, panels| {
        let below = legend(area, &entries)?;
        let mut plot = axes(&below, "", &x, &y)?;
        for (index, series) in series.iter().enumerate() {
            let (colour, dashed) = look(index);
            let stroke = Stroke {
                colour,
                half_pixels: 4,
                dashed,
            };
            let costs = series.costs.iter();
            let points = costs.map(|&(order, cost)| (order as f64, 100.0 * cost));
            plot.curve(series.name, points, stroke)?;
        }
        for (index, series) in series.iter().enumerate() {
            let Some(place) = chosen(series) else {
                continue;
            };
            let name = format!("{}, the library's order there", series.name);
            let data = Series::new(&name, Kind::Points, look(index).0, &[place]);
            plot.panel.series.push(data);
        }
        for series in series {
            let ring = chosen(series).map(|place| Circle::new(place, at(6), line(INK, 3)));
            plot.chart.draw_series(ring)?;
        }
        panels.push(plot.panel);
        Ok(())
    })
}

/// The cost at `order`, on the straight line between the orders around it.
fn cost_at(costs: &[(usize, f64)], order: usize) -> Option<f64> {
    let after = costs.partition_point(|cost| cost.0 < order);
    let &(next, cost) = costs.get(after)?;
    if next == order {
        return Some(cost);
    }
    let &(before, cost_before) = costs.get(after.checked_sub(1)?)?;
    let fraction = (order - before) as f64 / (next - before) as f64;
    Some(cost_before + (cost - cost_before) * fraction)
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;

    #[test]
    fn the_cost_of_an_order_lies_on_the_curve() {
        let costs = [(10, 0.8), (20, 0.4), (40, 0.2)];
        assert_eq!(cost_at(&costs, 10), Some(0.8));
        assert_eq!(cost_at(&costs, 40), Some(0.2));
        assert!((cost_at(&costs, 15).unwrap() - 0.6).abs() < 1e-12);
        assert!((cost_at(&costs, 35).unwrap() - 0.25).abs() < 1e-12);
        assert_eq!(cost_at(&costs, 9), None);
        assert_eq!(cost_at(&costs, 41), None);
        assert_eq!(cost_at(&[], 1), None);
    }

    #[test]
    fn every_series_is_named_and_its_choice_is_ringed() {
        let costs = [(0, 1.0), (400, 0.2)];
        let caption = Caption {
            title: "test",
            simulated: false,
        };
        let names: Vec<String> = (0..14).map(|index| format!("surface {index}")).collect();
        let series: Vec<OrderSeries<'_>> = names
            .iter()
            .map(|name| OrderSeries {
                name,
                costs: &costs,
                chosen: Some(100),
            })
            .collect();
        let svg = order_against_cost(&caption, &series).unwrap();
        assert_drawn_within(&svg, 960, 400);
        for name in &names {
            assert!(svg.as_str().contains(&format!("{name} (order 100)")));
        }
        // One of them in the legend.
        assert_eq!(svg.as_str().matches("<circle").count(), series.len() + 1);
    }

    #[test]
    fn a_picture_of_nothing_and_of_what_is_not_a_number_can_be_drawn() {
        let caption = Caption {
            title: "test",
            simulated: false,
        };
        assert_drawn_within(&order_against_cost(&caption, &[]).unwrap(), 960, 400);
        let costs = [(0, f64::NAN), (3, f64::INFINITY), (4, 0.5)];
        for chosen in [None, Some(0), Some(2), Some(4)] {
            let series = [OrderSeries {
                name: "odd",
                costs: &costs,
                chosen,
            }];
            assert_drawn_within(&order_against_cost(&caption, &series).unwrap(), 960, 400);
        }
    }
}
