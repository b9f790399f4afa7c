//! A scene along a motion: where the tool is on which surface, how it moves, and what is played, one above the other.

use plotters::prelude::*;

use super::canvas::{
    Area, Axis, BAR, Drawn, INK, PALE, Plot, SERIES, Stroke, Swatch, VERMILION, at, axes, legend,
    picture, px, range_with_zero,
};
use super::colours::pale;
use super::figure::{ACCELERATION, FORCE, FREQUENCY, Quantity, SPEED, TIME_S};
use super::spectrogram::{Windows, draw_bar, fill, levels_db, top_of};
use super::{Caption, Svg};
use crate::playing::motion::Hand;
use crate::support::error::{Error, Result};

/// Size of the picture, shown pixels.
const SIZE: (u32, u32) = (960, 1020);

/// Heights of path, speed, force and output, shown pixels; the spectrogram has the rest.
const HEIGHTS: [u32; 4] = [190, 160, 150, 170];

/// Length of a window of the spectrogram, s: short enough to tell taps apart.
const WINDOW_S: f64 = 0.05;

/// Moments at which the hand is looked at; at most so many are drawn.
const MOMENTS: usize = 2000;

/// A stretch of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneRegion {
    /// Its beginning, mm.
    pub start_mm: f64,
    /// Its end, mm.
    pub end_mm: f64,
    /// Index of its surface.
    pub surface: usize,
}

/// The parts of a scene that are drawn.
#[derive(Clone, Debug)]
pub struct SceneView<'a> {
    /// Names of the surfaces.
    pub surface_names: &'a [String],
    /// Regions; without any, the first surface lies everywhere.
    pub regions: &'a [SceneRegion],
    /// Motion of the hand from 0 s on.
    pub hand: Hand<'a>,
    /// Samples that are played, m/s².
    pub samples_m_s2: &'a [f64],
    /// Its samples per second.
    pub rate_hz: f64,
    /// Highest frequency of the spectrogram, Hz.
    pub highest_hz: f64,
}

/// One moment of the hand.
#[derive(Clone, Copy)]
struct Moment {
    time_s: f64,
    position_mm: f64,
    speed_mm_s: f64,
    force_n: f64,
    contact: bool,
}

/// Draws the scene.
///
/// # Errors
/// Nothing that is played, or a picture that cannot be laid out.
pub fn scene(caption: &Caption<'_>, view: &SceneView<'_>) -> Result<Svg> {
    let (samples, rate_hz) = (view.samples_m_s2, view.rate_hz);
    if samples.is_empty() {
        return Err(Error::Request(
            "a scene of no duration cannot be drawn".to_owned(),
        ));
    }
    let end_s = samples.len() as f64 / rate_hz;
    let highest_hz = view.highest_hz.min(0.5 * rate_hz);
    let moments = moments(&view.hand, end_s);
    let levels = levels_db(samples, rate_hz, highest_hz, WINDOW_S);
    let time = |is_told| Axis::new(TIME_S, 0.0..end_s, 10).told_if(is_told);
    picture(caption, SIZE, |area, drawn| {
        let below = legend(area, &entries(view, &moments))?;
        // The spectrogram has its bar on the right, and all panes are as wide as it is.
        let (mut rest, bar) = below.split_horizontally(at(SIZE.0 - BAR));
        let mut panes = Vec::new();
        for height in HEIGHTS {
            let (pane, after) = rest.split_vertically(px(height));
            panes.push(pane);
            rest = after;
        }
        drawn.push(draw_path(&panes[0], view, &moments, &time(false))?.panel);
        let of = |value: fn(&Moment) -> f64| -> Vec<(f64, f64)> {
            moments.iter().map(|m| (m.time_s, value(m))).collect()
        };
        let output = samples.iter().enumerate();
        let output = output.map(|(n, x)| (n as f64 / rate_hz, *x)).collect();
        let curves = [
            (of(|moment| moment.speed_mm_s), SPEED),
            (of(|moment| moment.force_n), FORCE),
            (output, ACCELERATION),
        ];
        for (pane, (points, quantity)) in panes[1..].iter().zip(curves) {
            let range = range_with_zero(points.iter().map(|point| point.1));
            let y = Axis::new(quantity, range, 4);
            let mut plot = axes(pane, quantity.name, &time(false), &y)?;
            plot.path(vec![(0.0, 0.0), (end_s, 0.0)], Stroke::solid(PALE, 2))?;
            plot.curve("", points.into_iter(), Stroke::solid(INK, 2))?;
            drawn.push(plot.panel);
        }
        let y = Axis::new(FREQUENCY, 0.0..highest_hz, 5);
        let mut own = axes(&rest, "spectrogram", &time(true), &y)?.panel;
        // Silence has no levels; its pane stays empty.
        if let Some(top_db) = top_of(levels.iter().flatten().copied()) {
            let windows = Windows::of(samples.len(), rate_hz, WINDOW_S);
            fill(&mut own, &levels, top_db, windows)?;
            let above: u32 = HEIGHTS.iter().sum();
            let bottom = bar.dim_in_pixel().1 as i32 - at(52);
            draw_bar(&bar, (at(above + 12), bottom), top_db)?;
        }
        drawn.push(own);
        Ok(())
    })
}

fn moments(hand: &Hand<'_>, end_s: f64) -> Vec<Moment> {
    let mut hand = hand.clone();
    (0..=MOMENTS)
        .map(|n| {
            let time_s = end_s * n as f64 / MOMENTS as f64;
            let interaction = hand.at(time_s);
            Moment {
                time_s,
                position_mm: interaction.position_mm().into(),
                speed_mm_s: interaction.motion.speed_mm_s().into(),
                force_n: interaction.motion.force_n().into(),
                contact: interaction.contact,
            }
        })
        .collect()
}

fn entries<'a>(view: &'a SceneView<'_>, moments: &[Moment]) -> Vec<(Swatch, &'a str)> {
    let names = view.surface_names.iter().enumerate();
    // Without regions the first surface lies everywhere.
    let lies = |index: usize| {
        let mut regions = view.regions.iter();
        regions.any(|region| region.surface == index) || view.regions.is_empty() && index == 0
    };
    let mut entries: Vec<(Swatch, &str)> = names
        .filter(|(index, _)| lies(*index))
        .map(|(index, name)| (Swatch::Box(pale(colour_of(index))), name.as_str()))
        .collect();
    for (contact, colour, name) in [
        (true, INK, "the tool, touching"),
        (false, VERMILION, "not touching"),
    ] {
        if moments.iter().any(|moment| moment.contact == contact) {
            entries.push((Swatch::line(colour), name));
        }
    }
    entries
}

fn colour_of(surface: usize) -> RGBColor {
    SERIES[surface % SERIES.len()]
}

/// Draws the place of the tool over time, over bands that are the surfaces.
fn draw_path<'a>(
    area: &Area<'a>,
    view: &SceneView<'_>,
    moments: &[Moment],
    time: &Axis<'_>,
) -> Drawn<Plot<'a>> {
    let end_s = time.range.end;
    let ends = view.regions.iter().flat_map(|r| [r.start_mm, r.end_mm]);
    let places = moments.iter().map(|moment| moment.position_mm);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for place in ends.chain(places) {
        (low, high) = (low.min(place), high.max(place));
    }
    let room = 0.04 * (high - low).max(1.0);
    let (low, high) = (low - room, high + room);
    let y = Axis::new(Quantity::new("place on the path", "mm"), low..high, 6);
    let mut plot = axes(area, "place", time, &y)?;
    let everywhere = [SceneRegion {
        start_mm: low,
        end_mm: high,
        surface: 0,
    }];
    let regions = if view.regions.is_empty() {
        &everywhere[..]
    } else {
        view.regions
    };
    plot.chart.draw_series(regions.iter().map(|region| {
        let corners = [(0.0, region.start_mm), (end_s, region.end_mm)];
        Rectangle::new(corners, pale(colour_of(region.surface)).filled())
    }))?;
    for run in moments.chunk_by(|a, b| a.contact == b.contact) {
        let (colour, name) = if run[0].contact {
            (INK, "touching")
        } else {
            (VERMILION, "not touching")
        };
        let points = run.iter().map(|m| (m.time_s, m.position_mm));
        plot.curve(name, points, Stroke::solid(colour, 3))?;
    }
    Ok(plot)
}
