//! The cost of a model by its order.

use plotters::prelude::*;

use super::canvas::{
    Axis, INK, Mark, SERIES, Stroke, Swatch, at, axes, legend, line, picture, range_with_zero,
};
use super::figure::{COST, Kind, Quantity, Series};
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

impl OrderSeries<'_> {
    /// The chosen order and its cost in per cent, on the straight line between the orders around it.
    fn chosen(&self) -> Option<(f64, f64)> {
        let order = self.chosen?;
        let after = self.costs.partition_point(|cost| cost.0 < order);
        let &(next, mut cost) = self.costs.get(after)?;
        if next != order {
            let &(before, cost_before) = self.costs.get(after.checked_sub(1)?)?;
            let fraction = (order - before) as f64 / (next - before) as f64;
            cost = cost_before + (cost - cost_before) * fraction;
        }
        cost.is_finite().then_some((order as f64, 100.0 * cost))
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        let costs = self.costs.iter();
        costs.map(|&(order, cost)| (order as f64, 100.0 * cost))
    }
}

/// The paper's figure 8: cost against order, for several surfaces, with the chosen orders ringed.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn order_against_cost(caption: &Caption<'_>, series: &[OrderSeries<'_>]) -> Result<Svg> {
    // Past the last colour they come again, dashed.
    let look = |index: usize| Stroke {
        colour: SERIES[index % SERIES.len()],
        half_pixels: 4,
        dashed: index / SERIES.len() % 2 == 1,
    };
    let named = |series: &OrderSeries<'_>| match series.chosen {
        Some(order) => format!("{} (order {order})", series.name),
        None => series.name.to_owned(),
    };
    let names: Vec<String> = series.iter().map(named).collect();
    let mut entries: Vec<(Swatch, &str)> = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let Stroke { colour, dashed, .. } = look(index);
        if series[index].points().any(|(_, cost)| cost.is_finite()) {
            entries.push((Swatch::Line { colour, dashed }, name));
        }
    }
    if series.iter().any(|series| series.chosen().is_some()) {
        entries.push((Swatch::Mark(Mark::Ring), "the library's order there"));
    }
    let points = || series.iter().flat_map(OrderSeries::points);
    let x = Axis::new(
        Quantity::new("order of the model", ""),
        range_with_zero(points().map(|point| point.0)),
        12,
    );
    let y = Axis::new(COST, range_with_zero(points().map(|point| point.1)), 8);
    picture(caption, (960, 400), |area, panels| {
        let mut plot = axes(&legend(area, &entries)?, "", &x, &y)?;
        for (index, series) in series.iter().enumerate() {
            plot.curve(series.name, series.points(), look(index))?;
        }
        for (index, series) in series.iter().enumerate() {
            let Some(place) = series.chosen() else {
                continue;
            };
            let name = format!("{}, the library's order there", series.name);
            let data = Series::new(&name, Kind::Points, look(index).colour, &[place]);
            plot.panel.series.push(data);
            plot.chart
                .draw_series([Circle::new(place, at(6), line(INK, 3))])?;
        }
        panels.push(plot.panel);
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cost_of_an_order_lies_on_the_curve() {
        let costs = [(10, 0.8), (20, 0.4), (40, 0.2)];
        for (order, cost) in [
            (10, Some(80.0)),
            (40, Some(20.0)),
            (15, Some(60.0)),
            (35, Some(25.0)),
            (9, None),
            (41, None),
        ] {
            let series = OrderSeries {
                name: "",
                costs: &costs,
                chosen: Some(order),
            };
            let found = series.chosen().map(|place| (10.0 * place.1).round() / 10.0);
            assert_eq!(found, cost, "{order}");
        }
    }
}
