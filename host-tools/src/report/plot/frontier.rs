//! Accuracy against time.

use std::ops::Range;

use plotters::prelude::*;

use super::canvas::{
    Axis, BLUE, Chart, Drawn, GREEN, INK, Mark, ORANGE, PURPLE, Quantity, SKY, Swatch, TEXT, Ticks,
    VERMILION, at, axes, centred, legend, line, picture, range_with_zero, text_width,
};
use super::colours::FADED;
use super::figure::{Kind, Series};
use super::labels::{Frame, Labelled, placed};
use super::{Caption, Svg};
use crate::support::error::Result;

/// Size of the picture, shown pixels.
const SIZE: (u32, u32) = (960, 560);

/// Radius around a point that its mark needs, drawn pixels.
const CLEAR: i32 = at(10);

/// Lettering of labels, shown pixels.
const LABEL: u32 = TEXT - 1;

/// A quantity along an axis with its scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontAxis<'a> {
    quantity: Quantity<'a>,
    /// True if equal ratios are equal steps.
    in_octaves: bool,
}

impl<'a> FrontAxis<'a> {
    /// In even steps from zero.
    pub fn from_zero(quantity: Quantity<'a>) -> Self {
        Self {
            quantity,
            in_octaves: false,
        }
    }

    /// In octaves, over the values that there are; only what is above zero is drawn.
    pub fn octaves(quantity: Quantity<'a>) -> Self {
        Self {
            quantity,
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

/// The front of some choices: a line in steps, because between two of its choices the cheaper one holds.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontLine {
    /// Its name.
    pub name: String,
    /// Its look.
    pub look: FrontLook,
    /// Its choices from left to right, with their labels.
    pub points: Vec<(f64, f64, String)>,
}

/// The look of a front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrontLook {
    /// A line, with a ring around each choice and its label.
    Ringed,
    /// A dashed line, with a square around each choice and its label.
    Squared,
    /// A grey line alone: what was before.
    Faded,
}

impl FrontLook {
    fn mark(self) -> Option<Mark> {
        match self {
            Self::Ringed => Some(Mark::Ring),
            Self::Squared => Some(Mark::Square),
            Self::Faded => None,
        }
    }

    fn swatch(self) -> Swatch {
        match self.mark() {
            Some(mark) => Swatch::Mark(mark),
            None => Swatch::Line {
                colour: FADED,
                dashed: false,
            },
        }
    }
}

/// Colours of series, one after the other.
const COLOURS: [RGBColor; 6] = [ORANGE, VERMILION, GREEN, SKY, BLUE, PURPLE];

/// Places of points in the chart.
type Places = Vec<(f64, f64)>;

/// Places of a front's choices, with their labels.
type Labels<'a> = Vec<((f64, f64), &'a str)>;

/// Series of choices over two quantities, with their fronts. Every choice that is marked as one of a front has a label.
///
/// Series and fronts without a point that can be drawn have no entry in the legend.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn front_chart(
    caption: &Caption<'_>,
    (x, y): (FrontAxis<'_>, FrontAxis<'_>),
    series: &[FrontSeries],
    fronts: &[FrontLine],
) -> Result<Svg> {
    let (by_series, by_front) = (series, fronts);
    let points = || {
        let of_series = series.iter().flat_map(|series| &series.points);
        let of_fronts = fronts.iter().flat_map(|front| &front.points);
        let of_series = of_series.map(|point| (point.x, point.y));
        of_series.chain(of_fronts.map(|(x, y, _)| (*x, *y)))
    };
    let x_scale = Scale::of(x, points().map(|point| point.0));
    let y_scale = Scale::of(y, points().map(|point| point.1));
    let place = |(x, y): (f64, f64)| {
        let (x, y) = (x_scale.place(x), y_scale.place(y));
        (x.is_finite() && y.is_finite()).then_some((x, y))
    };
    // Places of each series, and of those of its points that its line joins.
    let drawn: Vec<(Places, Places)> = series
        .iter()
        .map(|series| {
            let all = series.points.iter();
            let places = all.clone().filter_map(|point| place((point.x, point.y)));
            let joined = all.filter(|point| point.joined);
            let joined = joined.filter_map(|point| place((point.x, point.y)));
            (places.collect(), joined.collect())
        })
        .collect();
    let mut entries: Vec<(Swatch, &str)> = Vec::new();
    for (index, series) in series.iter().enumerate() {
        if !drawn[index].0.is_empty() {
            let (colour, dashed) = (COLOURS[index % COLOURS.len()], series.dashed);
            entries.push((Swatch::Line { colour, dashed }, &series.name));
        }
    }
    let fronts: Vec<(&FrontLine, Labels<'_>)> = fronts
        .iter()
        .map(|front| {
            let points = front.points.iter();
            let places =
                points.filter_map(|(x, y, label)| Some((place((*x, *y))?, label.as_str())));
            (front, places.collect::<Vec<_>>())
        })
        .filter(|(_, places)| !places.is_empty())
        .collect();
    entries.extend(
        fronts
            .iter()
            .map(|(front, _)| (front.look.swatch(), front.name.as_str())),
    );
    let places = || points().filter_map(place);
    let (x_names, y_names) = (x_scale.names(), y_scale.names());
    let x_axis = Axis {
        range: x_scale.range(places().map(|place| place.0)),
        quantity: x.quantity,
        ticks: x_scale.ticks(&x_names),
    };
    let y_axis = Axis {
        range: y_scale.range(places().map(|place| place.1)),
        quantity: y.quantity,
        ticks: y_scale.ticks(&y_names),
    };
    picture(caption, SIZE, |area, panels| {
        let below = legend(area, &entries)?;
        let mut plot = axes(&below, "", &x_axis, &y_axis)?;
        plot.panel.series = data(by_series, by_front, place);
        panels.push(plot.panel);
        let mut chart = plot.chart;
        for (front, places) in fronts
            .iter()
            .filter(|(front, _)| front.look == FrontLook::Faded)
        {
            draw_front(&mut chart, front.look, places)?;
        }
        for (index, (series, (places, joined))) in series.iter().zip(&drawn).enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            if series.dashed {
                let joined = joined.iter().copied();
                let dashes = DashedLineSeries::new(joined, at(6), at(4), line(colour, 3));
                chart.draw_series(dashes)?;
            } else {
                chart.draw_series(LineSeries::new(joined.iter().copied(), line(colour, 3)))?;
            }
            let dots = places.iter();
            chart.draw_series(dots.map(|place| Circle::new(*place, at(3), colour.filled())))?;
        }
        let marked = fronts
            .iter()
            .filter(|(front, _)| front.look != FrontLook::Faded);
        for (front, places) in marked.clone() {
            draw_front(&mut chart, front.look, places)?;
        }
        let labels = marked.flat_map(|(_, places)| places.iter().copied());
        let fronts: Vec<Places> = fronts.iter().map(|(_, places)| steps(places)).collect();
        let joined = drawn.iter().map(|(_, joined)| joined);
        let lines = joined.chain(&fronts).flat_map(|line| line.windows(2));
        draw_labels(&mut chart, labels.collect(), lines)
    })
}

/// The values of all points that `place` finds a place for, series by series and front by front.
fn data(
    series: &[FrontSeries],
    fronts: &[FrontLine],
    place: impl Fn((f64, f64)) -> Option<(f64, f64)>,
) -> Vec<Series> {
    let is_drawn = |point: &(f64, f64)| place(*point).is_some();
    let of_series = series.iter().enumerate().map(|(index, series)| {
        let points = series.points.iter().map(|point| (point.x, point.y));
        let points: Vec<(f64, f64)> = points.filter(is_drawn).collect();
        let colour = COLOURS[index % COLOURS.len()];
        Series::new(&series.name, Kind::Points, colour, &points)
    });
    let of_fronts = fronts.iter().map(|front| {
        let drawn = front.points.iter().filter(|(x, y, _)| is_drawn(&(*x, *y)));
        let points: Vec<(f64, f64)> = drawn.clone().map(|(x, y, _)| (*x, *y)).collect();
        Series {
            notes: drawn.map(|(_, _, label)| label.clone()).collect(),
            ..Series::new(&front.name, Kind::Points, INK, &points)
        }
    });
    let all = of_series.chain(of_fronts);
    all.filter(|series| !series.x.is_empty()).collect()
}

/// The line of a front in steps.
fn steps(places: &[((f64, f64), &str)]) -> Places {
    let mut steps = Vec::new();
    let mut before: Option<f64> = None;
    for &((x, y), _) in places {
        steps.extend(before.map(|y| (x, y)));
        steps.push((x, y));
        before = Some(y);
    }
    steps
}

/// Draws the line of a front in steps, and the marks of its choices.
fn draw_front(chart: &mut Chart<'_>, look: FrontLook, places: &[((f64, f64), &str)]) -> Drawn {
    let steps = steps(places);
    match look {
        FrontLook::Ringed => chart.draw_series(LineSeries::new(steps, line(INK, 3)))?,
        FrontLook::Squared => {
            chart.draw_series(DashedLineSeries::new(steps, at(3), at(3), line(INK, 3)))?
        }
        FrontLook::Faded => chart.draw_series(LineSeries::new(steps, line(FADED, 5)))?,
    };
    let (area, origin) = (
        chart.plotting_area().strip_coord_spec(),
        chart.plotting_area(),
    );
    let base = area.get_base_pixel();
    for (place, _) in places {
        let (x, y) = origin.map_coordinate(place);
        if let Some(mark) = look.mark() {
            mark.draw(&area, (x - base.0, y - base.1), (x - base.0, y - base.1))?;
        }
    }
    Ok(())
}

/// Draws the labels of points of fronts, one for each place.
fn draw_labels<'a>(
    chart: &mut Chart<'_>,
    mut points: Labels<'_>,
    lines: impl Iterator<Item = &'a [(f64, f64)]>,
) -> Drawn {
    let area = chart.plotting_area();
    let points_area = area.strip_coord_spec();
    let base = points_area.get_base_pixel();
    let pixel = |place: &(f64, f64)| {
        let (x, y) = area.map_coordinate(place);
        (x - base.0, y - base.1)
    };
    points.retain(|(_, label)| !label.is_empty());
    points.sort_by(|a, b| a.0.0.total_cmp(&b.0.0).then(a.0.1.total_cmp(&b.0.1)));
    points.dedup_by(|a, b| a == b);
    let labels: Vec<Labelled> = points
        .iter()
        .map(|(place, label)| Labelled {
            point: pixel(place),
            size: (text_width(label, LABEL) + at(4), at(LABEL + 2)),
        })
        .collect();
    let lines: Vec<_> = lines
        .map(|ends| (pixel(&ends[0]), pixel(&ends[1])))
        .collect();
    let (width, height) = points_area.dim_in_pixel();
    let frame = Frame {
        left: 0,
        top: 0,
        right: width as i32,
        bottom: height as i32,
    };
    for (placed, (_, label)) in placed(&labels, &lines, frame, CLEAR).iter().zip(&points) {
        let Some(placed) = placed else { continue };
        if let Some((from, to)) = placed.leader {
            points_area.draw(&PathElement::new([from, to], line(INK, 1)))?;
        }
        let middle = (
            i32::midpoint(placed.frame.left, placed.frame.right),
            i32::midpoint(placed.frame.top, placed.frame.bottom),
        );
        // Lines behind it are pale, so that it can be read.
        let Frame {
            left,
            top,
            right,
            bottom,
        } = placed.frame;
        let ground = Rectangle::new([(left, top), (right, bottom)], WHITE.mix(0.8).filled());
        points_area.draw(&ground)?;
        points_area.draw_text(label, &centred(LABEL, INK), middle)?;
    }
    Ok(())
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
    fn of(axis: FrontAxis<'_>, values: impl Iterator<Item = f64>) -> Self {
        if !axis.in_octaves {
            return Self::Even;
        }
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

    /// The range that holds places with a little room.
    fn range(&self, places: impl Iterator<Item = f64> + Clone) -> Range<f64> {
        match self {
            Self::Even => range_with_zero(places),
            Self::Octaves { .. } => {
                let low = places.clone().reduce(f64::min).unwrap_or(0.0);
                let high = places.reduce(f64::max).unwrap_or(0.0);
                low - 0.3..high + 0.3
            }
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
            Self::Octaves { lowest, .. } => Ticks::Octaves {
                lowest: *lowest,
                names,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;

    fn point(x: f64, y: f64) -> FrontPoint {
        FrontPoint { x, y, joined: true }
    }

    #[test]
    fn every_choice_is_drawn_and_those_of_a_front_are_marked_labelled_and_joined() {
        let series = FrontSeries {
            name: "one".to_owned(),
            points: vec![
                point(100.0, 3.0),
                point(200.0, f64::NAN),
                point(300.0, 1.0),
                point(900.0, 2.0),
            ],
            dashed: false,
        };
        let dashed = FrontSeries {
            name: "two".to_owned(),
            dashed: true,
            ..series.clone()
        };
        let nowhere = FrontSeries {
            name: "never drawn".to_owned(),
            points: vec![point(1.0, f64::NAN)],
            dashed: false,
        };
        let all = [series, dashed, nowhere];
        let front = |name: &str, look| FrontLine {
            name: name.to_owned(),
            look,
            points: vec![
                (100.0, 3.0, "the cheap one".to_owned()),
                (300.0, 1.0, "the dear one".to_owned()),
            ],
        };
        let fronts = [
            front("front of all", FrontLook::Ringed),
            front("front of some", FrontLook::Squared),
            front("front before", FrontLook::Faded),
        ];
        let caption = Caption {
            title: "test",
            simulated: false,
        };
        for axis in [FrontAxis::from_zero, FrontAxis::octaves] {
            let axes = (
                axis(Quantity::new("cycles", "per sample")),
                FrontAxis::from_zero(Quantity::new("error", "dB")),
            );
            let svg = front_chart(&caption, axes, &all, &fronts).unwrap();
            assert_drawn_within(&svg, SIZE.0, SIZE.1);
            // Three dots of two series, and two rings and the legend's.
            assert_eq!(svg.as_str().matches("<circle").count(), 6 + 2 + 1);
            let count = |text: &str| svg.as_str().matches(&format!(">\n{text}\n<")).count();
            for once in [
                "one",
                "two",
                "the cheap one",
                "the dear one",
                "front of all",
                "front of some",
                "front before",
            ] {
                assert_eq!(count(once), 1, "{once}");
            }
            assert_eq!(count("never drawn"), 0);
            let nothing = front_chart(&caption, axes, &[], &[]).unwrap();
            assert_drawn_within(&nothing, SIZE.0, SIZE.1);
        }
    }
}
