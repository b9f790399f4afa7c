//! Accuracy against time.

use plotters::prelude::*;

use super::canvas::{
    Axis, INK, SERIES, Stroke, Swatch, at, axes, legend, line, picture, range_with_zero,
};
use super::figure::{Kind, Quantity, Series};
use super::{Caption, Svg};
use crate::support::error::Result;

/// A choice.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontPoint {
    /// Along the horizontal axis.
    pub x: f64,
    /// Along the vertical axis.
    pub y: f64,
    /// A name, which is told where one points at the choice.
    pub name: String,
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

/// Series of choices and their fronts over two quantities: the horizontal axis in octaves if `in_octaves`, the vertical
/// one from zero. A front is a line in steps, because between two of its choices the cheaper one holds.
///
/// Series and fronts without a point that can be drawn have no entry in the legend.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn front_chart(
    caption: &Caption<'_>,
    (x, y): (Quantity<'_>, Quantity<'_>),
    in_octaves: bool,
    series: &[FrontSeries],
    fronts: &[FrontSeries],
) -> Result<Svg> {
    let is_drawn = |point: &&FrontPoint| {
        point.x.is_finite() && point.y.is_finite() && (!in_octaves || point.x > 0.0)
    };
    let drawn = |series: &FrontSeries| -> Vec<FrontPoint> {
        series.points.iter().filter(is_drawn).cloned().collect()
    };
    let kept = |all: &[FrontSeries]| -> Vec<FrontSeries> {
        let kept = all.iter().map(|series| FrontSeries {
            points: drawn(series),
            ..series.clone()
        });
        kept.filter(|series| !series.points.is_empty()).collect()
    };
    // Colours go by the place among all, so that a structure has one colour in several pictures.
    let colours = series.iter().zip(SERIES.into_iter().cycle());
    let colour = |name: &str| {
        let mut own = colours.clone().filter(|(series, _)| series.name == name);
        own.next().map_or(INK, |(_, colour)| colour)
    };
    let (series, fronts) = (kept(series), kept(fronts));
    let all = || {
        series
            .iter()
            .chain(&fronts)
            .flat_map(|series| &series.points)
    };
    let octave = |x: f64| if in_octaves { x.log2() } else { x };
    let places = || all().map(|point| octave(point.x));
    let lowest = places().reduce(f64::min).unwrap_or(0.0);
    let highest = places().reduce(f64::max).unwrap_or(0.0);
    let first = lowest.floor();
    let names =
        (0..=(highest.ceil() - first).min(64.0) as i32).map(|n| (first + f64::from(n)).exp2());
    let names: Vec<String> = names.map(|value| value.to_string()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let (x, origin) = if in_octaves {
        let range = lowest - first - 0.3..highest - first + 0.3;
        (Axis::of_octaves(x, range, first, &names), first)
    } else {
        (Axis::new(x, range_with_zero(places()), 8), 0.0)
    };
    let y = Axis::new(y, range_with_zero(all().map(|point| point.y)), 8);
    let place = |point: &FrontPoint| (octave(point.x) - origin, point.y);
    let swatch = |series: &FrontSeries| Swatch::Line {
        colour: colour(&series.name),
        dashed: series.dashed,
    };
    let entries = series.iter().chain(&fronts);
    let entries: Vec<(Swatch, &str)> = entries.map(|s| (swatch(s), s.name.as_str())).collect();
    picture(caption, (960, 560), |area, panels| {
        let mut plot = axes(&legend(area, &entries)?, "", &x, &y)?;
        for (is_front, of) in [(false, &series), (true, &fronts)] {
            for series in of {
                let stroke = Stroke {
                    colour: colour(&series.name),
                    half_pixels: 3,
                    dashed: series.dashed,
                };
                let joined = series.points.iter().filter(|point| point.joined);
                let joined: Vec<(f64, f64)> = joined.map(place).collect();
                let path = if is_front { steps(&joined) } else { joined };
                plot.path(path, stroke)?;
                let (radius, style) = if is_front {
                    (at(6), line(INK, 3))
                } else {
                    (at(3), stroke.colour.filled())
                };
                let dots = series.points.iter().map(place);
                plot.chart
                    .draw_series(dots.map(|place| Circle::new(place, radius, style)))?;
                plot.panel.series.push(data(series, stroke.colour));
            }
        }
        panels.push(plot.panel);
        Ok(())
    })
}

fn data(series: &FrontSeries, colour: RGBColor) -> Series {
    let points = series.points.iter().map(|point| (point.x, point.y));
    Series {
        notes: series
            .points
            .iter()
            .map(|point| point.name.clone())
            .collect(),
        ..Series::new(
            &series.name,
            Kind::Points,
            colour,
            &points.collect::<Vec<_>>(),
        )
    }
}

/// The line of a front in steps.
fn steps(places: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut steps = Vec::new();
    for (index, &(x, y)) in places.iter().enumerate() {
        if index > 0 {
            steps.push((x, places[index - 1].1));
        }
        steps.push((x, y));
    }
    steps
}
