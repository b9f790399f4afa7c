//! A scene along a motion: where the tool is on which surface, how it moves, and what is played, one above the other.

use plotters::prelude::*;

use super::canvas::{
    ACCELERATION, Area, Axis, BAR, BLUE, Drawn, FORCE, FREQUENCY, GREEN, INK, ORANGE, PALE, PURPLE,
    Quantity, SKY, SPEED, Stroke, Swatch, TIME_S, Ticks, VERMILION, at, axes, legend, line,
    picture, px, range_with_zero,
};
use super::colours::pale;
use super::figure::Panel;
use super::spectrogram::{Windows, draw_bar, fill, highest, levels_db, top_of};
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

/// Colours of surfaces, one after the other; beyond the last they begin again.
const SURFACES: [RGBColor; 6] = [BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION];

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
/// A rate or highest frequency that is not positive, nothing that is played, or a picture that cannot be laid out.
pub fn scene(caption: &Caption<'_>, view: &SceneView<'_>) -> Result<Svg> {
    let rate_hz = view.rate_hz;
    let is_sound = rate_hz > 0.0 && view.highest_hz > 0.0 && view.highest_hz.is_finite();
    if !is_sound || view.samples_m_s2.is_empty() {
        return Err(Error::Request(format!(
            "{} samples at {rate_hz} Hz up to {} Hz cannot be drawn",
            view.samples_m_s2.len(),
            view.highest_hz
        )));
    }
    let end_s = view.samples_m_s2.len() as f64 / rate_hz;
    let highest_hz = view.highest_hz.min(0.5 * rate_hz);
    let moments = moments(&view.hand, end_s);
    let panel = levels_db(view.samples_m_s2, rate_hz, highest_hz, WINDOW_S);
    let top_db = highest(panel.iter().flatten().copied()).map(top_of);
    picture(caption, SIZE, |area, drawn| {
        let below = legend(area, &entries(view, &moments))?;
        // The spectrogram has its bar on the right, and all panes are as wide as it is.
        let (mut rest, mut bar) = below.split_horizontally(at(SIZE.0 - BAR));
        let mut panes = Vec::new();
        for height in HEIGHTS {
            let (pane, after) = rest.split_vertically(px(height));
            panes.push(pane);
            rest = after;
            bar = bar.split_vertically(px(height)).1;
        }
        drawn.push(draw_path(&panes[0], view, &moments, end_s)?);
        let of = |value: fn(&Moment) -> f64| -> Vec<(f64, f64)> {
            moments.iter().map(|m| (m.time_s, value(m))).collect()
        };
        let output = view.samples_m_s2.iter().enumerate();
        let output = output.map(|(n, x)| (n as f64 / rate_hz, *x)).collect();
        let curves = [
            (of(|moment| moment.speed_mm_s), SPEED),
            (of(|moment| moment.force_n), FORCE),
            (output, ACCELERATION),
        ];
        for (pane, (points, quantity)) in panes[1..].iter().zip(curves) {
            drawn.push(draw_curve(pane, points, quantity, end_s)?);
        }
        let y = Axis {
            range: 0.0..highest_hz,
            quantity: FREQUENCY,
            ticks: Ticks::Numbers(5),
        };
        let x = time_axis(end_s, Ticks::Numbers(10));
        let mut own = axes(&rest, "spectrogram", &x, &y)?.panel;
        // Silence has no levels; its pane stays empty.
        if let Some(top_db) = top_db {
            let windows = Windows::of(view.samples_m_s2.len(), rate_hz, WINDOW_S);
            fill(&mut own, &panel, top_db, windows)?;
            let ends = (at(12), bar.dim_in_pixel().1 as i32 - at(52));
            draw_bar(&bar, ends, top_db)?;
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
    let path = |colour| Swatch::Line {
        colour,
        dashed: false,
    };
    for (contact, colour, name) in [
        (true, INK, "the tool, touching"),
        (false, VERMILION, "not touching"),
    ] {
        if moments.iter().any(|moment| moment.contact == contact) {
            entries.push((path(colour), name));
        }
    }
    entries
}

fn colour_of(surface: usize) -> RGBColor {
    SURFACES[surface % SURFACES.len()]
}

fn time_axis(end_s: f64, ticks: Ticks<'_>) -> Axis<'_> {
    Axis {
        range: 0.0..end_s,
        quantity: TIME_S,
        ticks,
    }
}

/// The place of the tool over time, over bands that are the surfaces.
fn draw_path(
    area: &Area<'_>,
    view: &SceneView<'_>,
    moments: &[Moment],
    end_s: f64,
) -> Drawn<Panel> {
    let ends = view.regions.iter().flat_map(|r| [r.start_mm, r.end_mm]);
    let places = moments.iter().map(|moment| moment.position_mm);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for place in ends.chain(places) {
        (low, high) = (low.min(place), high.max(place));
    }
    let room = 0.04 * (high - low).max(1.0);
    let (low, high) = (low - room, high + room);
    let y = Axis {
        range: low..high,
        quantity: Quantity::new("place on the path", "mm"),
        ticks: Ticks::Numbers(6),
    };
    let x = time_axis(end_s, Ticks::Blank(10));
    let mut plot = axes(area, "place", &x, &y)?;
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
    Ok(plot.panel)
}

fn draw_curve(
    area: &Area<'_>,
    points: Vec<(f64, f64)>,
    quantity: Quantity<'_>,
    end_s: f64,
) -> Drawn<Panel> {
    let y = Axis {
        range: range_with_zero(points.iter().map(|point| point.1)),
        quantity,
        ticks: Ticks::Numbers(4),
    };
    let x = time_axis(end_s, Ticks::Blank(10));
    let mut plot = axes(area, quantity.name(), &x, &y)?;
    let zero = LineSeries::new([(0.0, 0.0), (end_s, 0.0)], line(PALE, 2));
    plot.chart.draw_series(zero)?;
    plot.curve("", points.into_iter(), Stroke::solid(INK, 2))?;
    Ok(plot.panel)
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;
    use crate::playing::motion::MotionPath;
    use model_format::{MillimetresPerSecond, Newton};

    const CAPTION: Caption<'_> = Caption {
        title: "test",
        simulated: true,
    };

    fn draw(samples: &[f64], regions: &[SceneRegion], names: &[String]) -> Result<Svg> {
        let motion = MotionPath::constant(MillimetresPerSecond(100.0), Newton(1.0)).unwrap();
        let view = SceneView {
            surface_names: names,
            regions,
            hand: Hand::new(&motion),
            samples_m_s2: samples,
            rate_hz: 5000.0,
            highest_hz: 1000.0,
        };
        scene(&CAPTION, &view)
    }

    #[test]
    fn a_picture_stays_small_and_within_its_frame_whatever_is_played() {
        let long: Vec<f64> = (0..100_000).map(|n| (0.3 * f64::from(n)).sin()).collect();
        let names: Vec<String> = (0..16).map(|n| format!("a surface, number {n}")).collect();
        let regions: Vec<SceneRegion> = (0..16)
            .map(|n| SceneRegion {
                start_mm: 10.0 * n as f64,
                end_mm: 10.0 * n as f64 + 8.0,
                surface: n,
            })
            .collect();
        for samples in [&long[..], &long[..7], &[0.0; 900][..]] {
            for (regions, names) in [(&regions[..], &names[..]), (&[], &names[..1])] {
                let svg = draw(samples, regions, names).unwrap();
                assert_drawn_within(&svg, SIZE.0, SIZE.1);
                assert!(svg.as_str().len() < 500_000, "{}", svg.as_str().len());
                assert!(svg.as_str().contains("SIMULATED"));
                assert!(svg.as_str().trim_end().ends_with("</svg>"));
            }
        }
    }

    #[test]
    fn silence_is_drawn_and_nothing_is_refused() {
        let names = ["smooth".to_owned()];
        let silent = draw(&[0.0; 500], &[], &names).unwrap();
        assert_eq!(silent.as_str().matches("<image").count(), 0);
        assert!(draw(&[], &[], &names).is_err());
    }
}
