//! Accuracy against time.

use plotters::prelude::*;

use super::canvas::{
    Axis, BLUE, GREEN, INK, Mark, ORANGE, PURPLE, SKY, Swatch, TEXT, Ticks, VERMILION, at, axes,
    centred, legend, line, picture, range_with_zero,
};
use super::{Caption, Svg};
use crate::support::error::Result;

/// The quantity along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity<'a> {
    /// Its name with its unit.
    name: &'a str,
    /// True if equal ratios are equal steps.
    in_octaves: bool,
}

impl<'a> Quantity<'a> {
    /// In even steps from zero.
    pub fn from_zero(name: &'a str) -> Self {
        Self {
            name,
            in_octaves: false,
        }
    }

    /// In octaves, over the values that there are; only what is above zero is drawn.
    pub fn octaves(name: &'a str) -> Self {
        Self {
            name,
            in_octaves: true,
        }
    }
}

/// A choice.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontPoint {
    /// Along the horizontal axis.
    pub x: f64,
    /// Along the vertical axis.
    pub y: f64,
    /// Label beside it; empty for none.
    pub label: String,
    /// True for a point with a ring.
    pub on_front: bool,
    /// True for a point on the line of its series.
    pub joined: bool,
}

/// Choices that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontSeries {
    /// Their name.
    pub name: String,
    /// Points; those that are not finite are left out.
    pub points: Vec<FrontPoint>,
    /// True for a dashed line.
    pub dashed: bool,
}

/// Series of choices over two quantities, those on the Pareto front ringed.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn front_chart(
    caption: &Caption<'_>,
    (x, y): (Quantity<'_>, Quantity<'_>),
    series: &[FrontSeries],
) -> Result<Svg> {
    const COLOURS: [RGBColor; 6] = [ORANGE, VERMILION, GREEN, SKY, BLUE, PURPLE];
    let colour = |index: usize| COLOURS[index % COLOURS.len()];
    let (x_scale, y_scale) = (
        Scale::of(x, series, |point| point.x),
        Scale::of(y, series, |point| point.y),
    );
    let place = |point: &FrontPoint| (x_scale.place(point.x), y_scale.place(point.y));
    let finite: Vec<Vec<&FrontPoint>> = series
        .iter()
        .map(|series| {
            let is_drawn = |point: &&FrontPoint| {
                let (x, y) = place(point);
                x.is_finite() && y.is_finite()
            };
            series.points.iter().filter(is_drawn).collect()
        })
        .collect();
    let mut entries: Vec<(Swatch, &str)> = Vec::new();
    for (index, series) in series.iter().enumerate() {
        let (colour, dashed) = (colour(index), series.dashed);
        entries.push((Swatch::Line { colour, dashed }, &series.name));
    }
    if finite.iter().flatten().any(|point| point.on_front) {
        entries.push((Swatch::Mark(Mark::Ring), "on the Pareto front"));
    }
    let range = |scale: &Scale, of: fn((f64, f64)) -> f64| {
        let places = finite.iter().flatten().map(|point| of(place(point)));
        match scale {
            Scale::Even => range_with_zero(places),
            Scale::Octaves { names, .. } => -0.2..names.len().max(1) as f64 - 0.8,
        }
    };
    let (x_names, y_names) = (x_scale.names(), y_scale.names());
    let x_axis = Axis {
        range: range(&x_scale, |place| place.0),
        quantity: x.name,
        ticks: x_scale.ticks(&x_names),
    };
    let y_axis = Axis {
        range: range(&y_scale, |place| place.1),
        quantity: y.name,
        ticks: y_scale.ticks(&y_names),
    };
    picture(caption, (960, 460), |area| {
        let below = legend(area, &entries)?;
        let mut chart = axes(&below, &x_axis, &y_axis)?;
        for (index, (series, points)) in series.iter().zip(&finite).enumerate() {
            let colour = colour(index);
            let joined = points.iter().filter(|point| point.joined);
            let path: Vec<(f64, f64)> = joined.map(|point| place(point)).collect();
            if series.dashed {
                let dashes = DashedLineSeries::new(path, at(6), at(4), line(colour, 3));
                chart.draw_series(dashes)?;
            } else {
                chart.draw_series(LineSeries::new(path, line(colour, 3)))?;
            }
            let dots = points.iter().map(|point| place(point));
            chart.draw_series(dots.map(|place| Circle::new(place, at(3), colour.filled())))?;
        }
        for point in finite.iter().flatten() {
            let place = place(point);
            if point.on_front {
                chart.draw_series([Circle::new(place, at(7), line(INK, 3))])?;
            }
            if !point.label.is_empty() {
                let text = Text::new(point.label.clone(), (0, -at(14)), centred(TEXT - 2, INK));
                chart.draw_series([EmptyElement::at(place) + text])?;
            }
        }
        Ok(())
    })
}

/// The scale of an axis.
enum Scale {
    Even,
    /// Octaves from 2^`lowest` on, one for each name.
    Octaves {
        lowest: f64,
        names: Vec<String>,
    },
}

impl Scale {
    fn of(quantity: Quantity<'_>, series: &[FrontSeries], value: fn(&FrontPoint) -> f64) -> Self {
        if !quantity.in_octaves {
            return Self::Even;
        }
        let values = series.iter().flat_map(|series| &series.points).map(value);
        let positive = values.filter(|value| value.is_finite() && *value > 0.0);
        let (low, high) = positive
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                (low.min(value.log2().floor()), high.max(value.log2().ceil()))
            });
        if low > high {
            return Self::Octaves {
                lowest: 0.0,
                names: Vec::new(),
            };
        }
        let octaves = 0..=(high - low) as usize;
        Self::Octaves {
            lowest: low,
            names: octaves
                .map(|octave| (low + octave as f64).exp2().to_string())
                .collect(),
        }
    }

    fn place(&self, value: f64) -> f64 {
        match self {
            Self::Even => value,
            // What is not above zero is nowhere.
            Self::Octaves { lowest, .. } => Some(value.log2() - lowest)
                .filter(|place| place.is_finite())
                .unwrap_or(f64::NAN),
        }
    }

    fn names(&self) -> Vec<&str> {
        match self {
            Self::Even => Vec::new(),
            Self::Octaves { names, .. } => names.iter().map(String::as_str).collect(),
        }
    }

    fn ticks<'a>(&self, names: &'a [&'a str]) -> Ticks<'a> {
        match self {
            Self::Even => Ticks::Numbers(8),
            Self::Octaves { .. } => Ticks::Names(names),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;

    #[test]
    fn every_choice_is_drawn_and_the_front_is_ringed() {
        let point = |x: f64, y: f64, on_front| FrontPoint {
            x,
            y,
            label: format!("{x}"),
            on_front,
            joined: true,
        };
        let series = FrontSeries {
            name: "one".to_owned(),
            points: vec![
                point(100.0, 3.0, true),
                point(200.0, f64::NAN, false),
                point(300.0, 1.0, true),
                point(900.0, 2.0, false),
            ],
            dashed: false,
        };
        let dashed = FrontSeries {
            name: "two".to_owned(),
            dashed: true,
            ..series.clone()
        };
        let caption = Caption {
            title: "test",
            simulated: false,
        };
        for quantity in [Quantity::from_zero, Quantity::octaves] {
            let quantities = (quantity("x"), Quantity::from_zero("y"));
            let svg = front_chart(&caption, quantities, &[series.clone(), dashed.clone()]).unwrap();
            assert_drawn_within(&svg, 960, 460);
            // Three dots and two rings each, and one ring in the legend.
            assert_eq!(svg.as_str().matches("<circle").count(), 11);
            // Ring and dot of one choice are at one place, and the three choices at three.
            let places: std::collections::BTreeSet<&str> = svg
                .as_str()
                .split("<circle cx=\"")
                .skip(2)
                .map(|circle| circle.split('"').next().unwrap())
                .collect();
            assert!((3..=4).contains(&places.len()), "{places:?}");
            let nothing = front_chart(&caption, quantities, &[]).unwrap();
            assert_drawn_within(&nothing, 960, 460);
        }
    }
}
