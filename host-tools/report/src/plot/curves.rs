//! Pictures of curves and points, each on one pair of axes.

use std::ops::Range;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use stylus_dsp::spectrum::{smoothed_amplitude, spectral_cost};
use stylus_support::Result;

use super::canvas::{
    Axis, BLUE, Drawn, INK, Plot, SERIES, Stroke, Swatch, TEXT, VERMILION, at, chart, line, range_with_zero, text,
    text_width,
};
use super::figure::{ACCELERATION, FREQUENCY, Kind, POWER_DENSITY, Quantity, Series, TIME_MS};
use super::{Caption, Svg};

/// One choice as a point of a chart of fronts.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontPoint {
    /// Value along the horizontal axis.
    pub x: f64,
    /// Value along the vertical axis.
    pub y: f64,
    /// Name of the choice, shown when a reader points at it.
    pub name: String,
}

/// Choices that form one series.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontSeries {
    /// Name of the series.
    pub name: String,
    /// The points. Points that are not finite are not drawn.
    pub points: Vec<FrontPoint>,
    /// True if the line is dashed.
    pub dashed: bool,
}

/// Draws series of choices and their fronts over two quantities. The horizontal axis is in octaves if `in_octaves`; the
/// vertical axis includes zero. A front is a line in steps, because between two of its choices the cheaper one holds.
/// Each of `names` is written to the lower left of its place, where no choice beats it.
///
/// A series or front without a drawable point has no entry in the legend.
pub fn front_chart(
    caption: &Caption<'_>,
    (x, y): (Quantity, Quantity),
    in_octaves: bool,
    (series, fronts): (&[FrontSeries], &[FrontSeries]),
    names: &[(&str, f64, f64)],
) -> Result<Svg> {
    // A colour depends on the position in `series`, so that a structure has the same colour in several pictures.
    let colours = series.iter().zip(SERIES.into_iter().cycle());
    let colour = |name: &str| {
        let mut own = colours.clone().filter(|(series, _)| series.name == name);
        own.next().map_or(INK, |(_, colour)| colour)
    };
    let [series, fronts] = [series, fronts].map(|all| drawable(all, in_octaves));
    let all = || series.iter().chain(&fronts).flat_map(|series| &series.points);
    let octave = |x: f64| if in_octaves { x.log2() } else { x };
    let places = || all().map(|point| octave(point.x));
    let lowest = places().reduce(f64::min).unwrap_or(0.0);
    let highest = places().reduce(f64::max).unwrap_or(0.0);
    let first = lowest.floor();
    // At least three octaves are written, because fewer numbers do not show the scale.
    let start = lowest - first - 0.5;
    let end = (highest - first + 0.3).max(start.ceil() + 2.0);
    // Bounded, because values of any size may be drawn.
    let octaves: Vec<String> = (0..=end.min(64.0) as i32)
        .map(|n| (first + f64::from(n)).exp2())
        .map(|value| value.to_string())
        .collect();
    let octaves: Vec<&str> = octaves.iter().map(String::as_str).collect();
    let (x, origin) = if in_octaves {
        (Axis::of_octaves(x, start..end, first, &octaves), first)
    } else {
        (Axis::new(x, range_with_zero(places()), 8), 0.0)
    };
    let y = Axis::new(y, range_with_zero(all().map(|point| point.y)), 8);
    let place = |point: &FrontPoint| (octave(point.x) - origin, point.y);
    let stroke = |series: &FrontSeries| Stroke {
        dashed: series.dashed,
        ..Stroke::solid(colour(&series.name), 3)
    };
    let entries: Vec<(Swatch, &str)> = series
        .iter()
        .chain(&fronts)
        .map(|series| (Swatch::Line(stroke(series)), series.name.as_str()))
        .collect();
    chart(caption, (960, 560), &entries, (&x, &y), |plot| {
        for (is_front, of) in [(false, &series), (true, &fronts)] {
            for series in of {
                draw_front_series(plot, series, stroke(series), is_front, place)?;
            }
        }
        // Names come last, because each has a background that hides what is drawn below it.
        for &(name, x, y) in names {
            draw_name(plot, name, (octave(x) - origin, y))?;
        }
        Ok(())
    })
}

/// Returns the series of `all` that have drawable points, with only these points.
fn drawable(all: &[FrontSeries], in_octaves: bool) -> Vec<FrontSeries> {
    let is_drawn = |point: &&FrontPoint| point.x.is_finite() && point.y.is_finite() && (!in_octaves || point.x > 0.0);
    all.iter()
        .map(|series| FrontSeries {
            points: series.points.iter().filter(is_drawn).cloned().collect(),
            ..series.clone()
        })
        .filter(|series| !series.points.is_empty())
        .collect()
}

/// Draws choices at their `place`s, as dots joined by a line; the line of a front is in steps.
fn draw_front_series(
    plot: &mut Plot<'_>,
    series: &FrontSeries,
    stroke: Stroke,
    is_front: bool,
    place: impl Fn(&FrontPoint) -> (f64, f64),
) -> Drawn {
    let joined: Vec<(f64, f64)> = series.points.iter().map(&place).collect();
    let path = if is_front { steps(&joined) } else { joined };
    plot.path(path, stroke)?;
    let (radius, style) = if is_front {
        // Rings, which leave the dots of the same choices visible.
        (at(6), line(INK, 3))
    } else {
        (at(3), stroke.colour.filled())
    };
    let dots = series.points.iter().map(&place);
    plot.chart
        .draw_series(dots.map(|dot| Circle::new(dot, radius, style)))?;
    let values: Vec<(f64, f64)> = series.points.iter().map(|point| (point.x, point.y)).collect();
    let names = series.points.iter().map(|point| point.name.clone());
    plot.panel.series.push(Series {
        notes: names.collect(),
        ..Series::new(&series.name, Kind::Points, stroke.colour, &values)
    });
    Ok(())
}

/// Writes `name` to the lower left of its `place`.
fn draw_name(plot: &mut Plot<'_>, name: &str, place: (f64, f64)) -> Drawn {
    let (width, height) = (text_width(name, TEXT), at(TEXT));
    let ground = [(-at(10) - width, at(6)), (-at(6), at(10) + height)];
    let style = text(TEXT, INK).pos(Pos::new(HPos::Right, VPos::Top));
    let element = EmptyElement::at(place)
        + Circle::new((0, 0), at(6), INK.filled())
        + Rectangle::new(ground, WHITE.filled())
        + Text::new(name.to_owned(), (-at(8), at(8)), style);
    plot.chart.draw_series([element])?;
    Ok(())
}

/// Returns the line of a front in steps.
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

/// Highest frequency shown, Hz. Skin feels nothing above it.
const HIGHEST_HZ: f64 = 1000.0;

/// Draws the smoothed DFT amplitudes of a recording and of its synthesis, as in the paper's figures 7 and 10. The title
/// has the cost C ([`spectral_cost`]).
///
/// Amplitudes are scaled by √(2 / (N · rate)), so that those of noise do not depend on the length N. Their unit is
/// m/s²/√Hz. The longer signal is shortened, as it is for C.
pub fn spectra(
    caption: &Caption<'_>,
    (recorded, synthesised): (&[f64], &[f64]),
    rate_hz: f64,
    smoothing_width_hz: f64,
) -> Result<Svg> {
    let cost = spectral_cost(recorded, synthesised, rate_hz, smoothing_width_hz);
    let cost = cost.map_or("C is undefined".to_owned(), |cost| {
        format!("C of this block {:.1} %", 100.0 * cost)
    });
    let title = format!("{}: {cost}", caption.title);
    let caption = Caption::new(&title, caption.simulated);
    // With the same number of bins, amplitudes can be compared bin by bin, as for C.
    let len = recorded.len().min(synthesised.len());
    let end_hz = HIGHEST_HZ.min(rate_hz / 2.0);
    let curves =
        [(recorded, BLUE, "recorded"), (synthesised, VERMILION, "synthesised")].map(|(signal, colour, name)| {
            let scale = (2.0 / (len.max(1) as f64 * rate_hz)).sqrt();
            let amplitude = smoothed_amplitude(&signal[..len], rate_hz, smoothing_width_hz);
            let points: Vec<(f64, f64)> = amplitude
                .into_iter()
                .enumerate()
                .map(|(bin, x)| (bin as f64 * rate_hz / len as f64, scale * x))
                .take_while(|point| point.0 <= end_hz)
                .collect();
            (points, colour, name)
        });
    let values = curves.iter().flat_map(|(points, ..)| points);
    let x = Axis::new(FREQUENCY, 0.0..end_hz, 11);
    let y = Axis::new(
        Quantity::new("smoothed DFT amplitude", "m/s²/√Hz"),
        range_with_zero(values.map(|point| point.1)),
        8,
    );
    let entries: [(Swatch, &str); 2] = [0, 1].map(|n| (Swatch::line(curves[n].1), curves[n].2));
    chart(&caption, (960, 400), &entries, (&x, &y), |plot| {
        for (points, colour, name) in curves {
            plot.curve(name, points.into_iter(), Stroke::solid(colour, 3))?;
        }
        Ok(())
    })
}

/// Width of the pictures of a page to rub on, shown pixels. Three fit beside each other under the patch, and one fits a
/// page 420 pixels wide without being scaled down.
pub const NARROW: u32 = 388;

/// Height of the page's axes, shown pixels.
const HEIGHT: u32 = 280;

/// Octave frequencies that are written along a frequency axis, Hz.
pub(super) const OCTAVES_HZ: [&str; 7] = ["16", "31.5", "63", "125", "250", "500", "1000"];

/// The exact value of the first of [`OCTAVES_HZ`], Hz.
pub(super) const FIRST_OCTAVE_HZ: f64 = 1000.0 / 64.0;

/// Draws empty axes for the last 100 ms of an acceleration within ± `peak_m_s2`.
///
/// # Errors
/// The axes cannot be laid out, because the peak is not positive and finite.
pub fn waveform_axes(caption: &Caption<'_>, peak_m_s2: f64) -> Result<Svg> {
    let x = Axis::new(TIME_MS, -100.0..0.0, 6);
    empty(caption, &x, &Axis::new(ACCELERATION, -peak_m_s2..peak_m_s2, 7))
}

/// Draws empty axes for the power density from 20 Hz to 1 kHz, over octaves, between two levels in dB re 1 (m/s²)²/Hz.
///
/// # Errors
/// The axes cannot be laid out, because the levels are not finite and ascending.
pub fn spectrum_axes(caption: &Caption<'_>, levels_db: Range<f64>) -> Result<Svg> {
    let lowest = FIRST_OCTAVE_HZ.log2();
    // From 20 Hz to 1 kHz, with a small margin.
    let x = Axis::of_octaves(FREQUENCY, 0.35..6.05, lowest, &OCTAVES_HZ);
    empty(caption, &x, &Axis::new(POWER_DENSITY, levels_db, 9))
}

fn empty(caption: &Caption<'_>, x: &Axis<'_>, y: &Axis<'_>) -> Result<Svg> {
    chart(caption, (NARROW, HEIGHT), &[], (x, y), |_| Ok(()))
}
