//! A recording and its synthesis, in time and in frequency.

use plotters::prelude::*;

use super::canvas::{
    ACCELERATION, Area, Axis, BLUE, Drawn, FREQUENCY, Quantity, Stroke, Swatch, TIME_MS, TIME_S,
    Ticks, VERMILION, axes, highest_of, legend, picture, px, range_with_zero,
};
use super::figure::Panel;
use super::{Caption, Svg};
use crate::dsp::spectrum;
use crate::dsp::spectrum::{DEFAULT_SMOOTHING_WIDTH_HZ, smoothed_amplitude};
use crate::support::error::{Error, Result};

/// The part of two signals that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectraView {
    /// Duration of the excerpt in time, s, from the middle of the signals.
    pub excerpt_s: f64,
    /// Highest frequency, Hz, at most half the rate.
    pub highest_hz: f64,
    /// Full width of the Hann kernel that smooths the amplitudes, Hz.
    pub smoothing_width_hz: f64,
    /// Ends of the axes where pictures are compared.
    pub ends: SpectraEnds,
}

/// Ends of the axes of pictures that are compared; `None` for those of the picture's own signals.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpectraEnds {
    /// The largest magnitude of the excerpts, m/s².
    pub acceleration_m_s2: Option<f64>,
    /// The largest smoothed amplitude, m/s²/√Hz.
    pub amplitude: Option<f64>,
}

impl SpectraEnds {
    /// The ends that hold the signals of both pictures.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        let larger = |a: Option<f64>, b: Option<f64>| [a, b].into_iter().flatten().reduce(f64::max);
        Self {
            acceleration_m_s2: larger(self.acceleration_m_s2, other.acceleration_m_s2),
            amplitude: larger(self.amplitude, other.amplitude),
        }
    }
}

/// The ends of the axes that hold a recording and its synthesis, drawn as `view`.
pub fn spectra_ends(
    recorded: &[f64],
    synthesised: &[f64],
    rate_hz: f64,
    view: &SpectraView,
) -> SpectraEnds {
    let len = recorded.len().min(synthesised.len());
    let signals = [&recorded[..len], &synthesised[..len]];
    let excerpts = signals
        .iter()
        .flat_map(|signal| excerpt(signal, rate_hz, view));
    let curves = signals
        .iter()
        .flat_map(|signal| amplitudes(signal, rate_hz, view));
    SpectraEnds {
        acceleration_m_s2: highest_of(excerpts.copied()),
        amplitude: highest_of(curves.map(|point| point.1)),
    }
}

/// The middle of a signal.
fn excerpt<'s>(signal: &'s [f64], rate_hz: f64, view: &SpectraView) -> &'s [f64] {
    let shown = ((view.excerpt_s * rate_hz).round() as usize).min(signal.len());
    let begin = (signal.len() - shown) / 2;
    &signal[begin..begin + shown]
}

/// Frequencies, Hz, up to the highest shown, with smoothed amplitudes, m/s²/√Hz.
fn amplitudes(signal: &[f64], rate_hz: f64, view: &SpectraView) -> Vec<(f64, f64)> {
    let len = signal.len().max(1) as f64;
    let scale = (2.0 / (len * rate_hz)).sqrt();
    let end_hz = view.highest_hz.min(rate_hz / 2.0);
    let amplitude = smoothed_amplitude(signal, rate_hz, view.smoothing_width_hz);
    let bins = amplitude.into_iter().enumerate();
    bins.map(|(bin, x)| (bin as f64 * rate_hz / len, scale * x))
        .take_while(|point| point.0 <= end_hz)
        .collect()
}

impl Default for SpectraView {
    /// 100 ms, and up to 1 kHz, which is as high as skin feels.
    fn default() -> Self {
        Self {
            excerpt_s: 0.1,
            highest_hz: 1000.0,
            smoothing_width_hz: DEFAULT_SMOOTHING_WIDTH_HZ,
            ends: SpectraEnds::default(),
        }
    }
}

/// The paper's figure 7: on the left an excerpt of a recording, m/s², above one of its synthesis; on the right the
/// smoothed DFT amplitudes of both; in the title the cost C ([`spectrum::spectral_cost`]).
///
/// Amplitudes are scaled by √(2 / (N · rate)), so that those of noise do not depend on the length N: m/s²/√Hz. The
/// longer signal is cut as for C.
///
/// # Errors
/// A rate or a view that is not positive and finite, and that the picture cannot be laid out.
pub fn time_and_frequency(
    caption: &Caption<'_>,
    recorded: &[f64],
    synthesised: &[f64],
    rate_hz: f64,
    view: &SpectraView,
) -> Result<Svg> {
    for (what, value) in [
        ("the rate", rate_hz),
        ("the excerpt", view.excerpt_s),
        ("the highest frequency", view.highest_hz),
    ] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::Request(format!(
                "{what} to be drawn is {value}: it must be positive"
            )));
        }
    }
    let len = recorded.len().min(synthesised.len());
    let signals = [
        (&recorded[..len], BLUE, NAMES[0]),
        (&synthesised[..len], VERMILION, NAMES[1]),
    ];
    let cost = spectrum::spectral_cost(recorded, synthesised, rate_hz, view.smoothing_width_hz);
    let cost = cost.map_or("C is undefined".to_owned(), |cost| {
        format!("C = {:.1} %", 100.0 * cost)
    });
    let title = format!("{}: {cost}", caption.title);
    picture(
        &Caption {
            title: &title,
            ..*caption
        },
        (960, 400),
        |area, panels| {
            let entries = signals.map(|(_, colour, name)| {
                (
                    Swatch::Line {
                        colour,
                        dashed: false,
                    },
                    name,
                )
            });
            let below = legend(area, &entries)?;
            let (left, right) = below.split_horizontally((50).percent_width());
            draw_time(&left, panels, signals, rate_hz, view)?;
            draw_frequency(&right, panels, signals, rate_hz, view)
        },
    )
}

/// Names of both signals.
const NAMES: [&str; 2] = ["recorded", "synthesised"];

/// Signals with their colours and names, recorded first, of the same length.
type Pair<'a> = [(&'a [f64], RGBColor, &'a str); 2];

/// Draws the middle of both signals, one above the other and to the same scale.
fn draw_time(
    area: &Area<'_>,
    panels: &mut Vec<Panel>,
    signals: Pair<'_>,
    rate_hz: f64,
    view: &SpectraView,
) -> Drawn {
    let excerpts =
        signals.map(|(signal, colour, name)| (excerpt(signal, rate_hz, view), colour, name));
    let values = excerpts.iter().flat_map(|(signal, ..)| signal.iter());
    let own = highest_of(values.copied());
    let highest = view.ends.acceleration_m_s2.or(own);
    let highest = highest.map_or(1.0, |highest| 1.06 * highest);
    let end_s = excerpts[0].0.len().max(1) as f64 / rate_hz;
    let (unit, quantity) = if end_s < 2.0 {
        (1000.0, TIME_MS)
    } else {
        (1.0, TIME_S)
    };

    let (_, height) = area.dim_in_pixel();
    // The lower chart also has the numbers and the name of the time axis below it.
    let (upper, lower) = area.split_vertically(height.saturating_sub(px(34)) / 2);
    let halves = [(upper, Ticks::Blank(6)), (lower, Ticks::Numbers(6))];
    for ((half, ticks), (signal, colour, name)) in halves.into_iter().zip(excerpts) {
        let x = Axis {
            range: 0.0..unit * end_s,
            quantity,
            ticks,
        };
        let y = Axis {
            range: -highest..highest,
            quantity: ACCELERATION,
            ticks: Ticks::Numbers(5),
        };
        let mut plot = axes(&half, name, &x, &y)?;
        let samples = signal.iter().enumerate();
        let points = samples.map(|(n, value)| (unit * n as f64 / rate_hz, *value));
        plot.curve("", points, Stroke::solid(colour, 2))?;
        panels.push(plot.panel);
    }
    Ok(())
}

/// Draws the smoothed amplitudes of both signals in one chart.
fn draw_frequency(
    area: &Area<'_>,
    panels: &mut Vec<Panel>,
    signals: Pair<'_>,
    rate_hz: f64,
    view: &SpectraView,
) -> Drawn {
    let curves =
        signals.map(|(signal, colour, name)| (amplitudes(signal, rate_hz, view), colour, name));
    let values = curves
        .iter()
        .flat_map(|(points, ..)| points.iter().map(|point| point.1));
    let x = Axis {
        range: 0.0..view.highest_hz.min(rate_hz / 2.0),
        quantity: FREQUENCY,
        ticks: Ticks::Numbers(6),
    };
    let y = Axis {
        range: match view.ends.amplitude {
            Some(highest) => range_with_zero([highest]),
            None => range_with_zero(values),
        },
        quantity: Quantity::new("smoothed DFT amplitude", "m/s²/√Hz"),
        ticks: Ticks::Numbers(8),
    };
    let mut plot = axes(area, "spectra", &x, &y)?;
    for (points, colour, name) in curves {
        plot.curve(name, points.into_iter(), Stroke::solid(colour, 3))?;
    }
    panels.push(plot.panel);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const CAPTION: Caption<'_> = Caption {
        title: "test",
        simulated: false,
    };

    fn noise(len: usize, seed: u64) -> Vec<f64> {
        let generator = rand_pcg::Pcg64::seed_from_u64(seed);
        StandardNormal.sample_iter(generator).take(len).collect()
    }

    #[test]
    fn the_title_tells_the_cost() {
        let (a, b) = (noise(10_000, 1), noise(10_000, 2));
        let svg = time_and_frequency(&CAPTION, &a, &b, 5000.0, &SpectraView::default()).unwrap();
        let cost = spectrum::spectral_cost(&a, &b, 5000.0, DEFAULT_SMOOTHING_WIDTH_HZ).unwrap();
        assert!(
            svg.as_str()
                .contains(&format!("test: C = {:.1} %", 100.0 * cost))
        );
        let svg =
            time_and_frequency(&CAPTION, &[0.0; 9], &b, 5000.0, &SpectraView::default()).unwrap();
        assert!(svg.as_str().contains("C is undefined"));
    }

    #[test]
    fn a_picture_stays_small_and_within_its_frame_whatever_the_signals() {
        let long = noise(400_000, 3);
        let all = SpectraView {
            excerpt_s: 1e6,
            highest_hz: 1e6,
            smoothing_width_hz: 0.0,
            ..SpectraView::default()
        };
        let odd = [f64::NAN, f64::INFINITY, 1e300, -1e300];
        for (recorded, synthesised, view) in [
            (&long[..], &long[..], all),
            (&long[..1], &[], SpectraView::default()),
            (&long[..1], &long[..1], all),
            (&[0.0; 50], &[0.0; 50], all),
            (&odd, &long[..4], all),
        ] {
            let svg = time_and_frequency(&CAPTION, recorded, synthesised, 5000.0, &view).unwrap();
            assert!(svg.as_str().len() < 200_000, "{}", svg.as_str().len());
            assert_drawn_within(&svg, 960, 400);
        }
    }

    #[test]
    fn a_view_of_nothing_is_refused() {
        let view = SpectraView::default();
        for (rate_hz, view) in [
            (0.0, view),
            (f64::NAN, view),
            (
                5000.0,
                SpectraView {
                    excerpt_s: -1.0,
                    ..view
                },
            ),
            (
                5000.0,
                SpectraView {
                    highest_hz: 0.0,
                    ..view
                },
            ),
        ] {
            let error = time_and_frequency(&CAPTION, &[1.0], &[1.0], rate_hz, &view).unwrap_err();
            assert!(matches!(error, Error::Request(_)), "{error}");
        }
    }
}
