//! A recording and its synthesis, in time and in frequency.

use plotters::prelude::*;

use super::canvas::{
    Area, Axis, BLUE, Drawn, Swatch, Ticks, VERMILION, axes, legend, line, picture, px,
    range_with_zero, thinned,
};
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
}

impl Default for SpectraView {
    /// 100 ms, and up to 1 kHz, which is as high as skin feels.
    fn default() -> Self {
        Self {
            excerpt_s: 0.1,
            highest_hz: 1000.0,
            smoothing_width_hz: DEFAULT_SMOOTHING_WIDTH_HZ,
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
    let signals = [(&recorded[..len], BLUE), (&synthesised[..len], VERMILION)];
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
        |area| {
            let names = [(BLUE, "recorded"), (VERMILION, "synthesised")];
            let entries = names.map(|(colour, name)| {
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
            draw_time(&left, signals, rate_hz, view)?;
            draw_frequency(&right, signals, rate_hz, view)
        },
    )
}

/// Signals with their colours, recorded first, of the same length.
type Pair<'a> = [(&'a [f64], RGBColor); 2];

/// Draws the middle of both signals, one above the other and to the same scale.
fn draw_time(area: &Area<'_>, signals: Pair<'_>, rate_hz: f64, view: &SpectraView) -> Drawn {
    let len = signals[0].0.len();
    let shown = ((view.excerpt_s * rate_hz).round() as usize).min(len);
    let begin = (len - shown) / 2;
    let excerpts = signals.map(|(signal, colour)| (&signal[begin..begin + shown], colour));
    let values = excerpts.iter().flat_map(|(signal, _)| signal.iter());
    let largest = values
        .map(|value| value.abs())
        .filter(|value| value.is_finite())
        .fold(0.0, f64::max);
    let highest = if largest > 0.0 { 1.06 * largest } else { 1.0 };
    let end_s = shown.max(1) as f64 / rate_hz;
    let (unit, quantity) = if end_s < 2.0 {
        (1000.0, "time (ms)")
    } else {
        (1.0, "time (s)")
    };

    let (_, height) = area.dim_in_pixel();
    // The lower chart also has the numbers and the name of the time axis below it.
    let (upper, lower) = area.split_vertically(height.saturating_sub(px(34)) / 2);
    let halves = [
        (upper, "", Ticks::Blank(8)),
        (lower, quantity, Ticks::Numbers(8)),
    ];
    for ((half, quantity, ticks), (signal, colour)) in halves.into_iter().zip(excerpts) {
        let x = Axis {
            range: 0.0..unit * end_s,
            quantity,
            ticks,
        };
        let y = Axis {
            range: -highest..highest,
            quantity: "m/s²",
            ticks: Ticks::Numbers(5),
        };
        let mut chart = axes(&half, &x, &y)?;
        let time = |n: usize| unit * n as f64 / rate_hz;
        let points = thinned(
            signal
                .iter()
                .enumerate()
                .map(|(n, value)| (time(n), *value)),
        );
        chart.draw_series(LineSeries::new(points, line(colour, 2)))?;
    }
    Ok(())
}

/// Draws the smoothed amplitudes of both signals in one chart.
fn draw_frequency(area: &Area<'_>, signals: Pair<'_>, rate_hz: f64, view: &SpectraView) -> Drawn {
    let len = signals[0].0.len().max(1) as f64;
    let scale = (2.0 / (len * rate_hz)).sqrt();
    let end_hz = view.highest_hz.min(rate_hz / 2.0);
    let curves = signals.map(|(signal, colour)| {
        let amplitude = smoothed_amplitude(signal, rate_hz, view.smoothing_width_hz);
        let points = amplitude
            .into_iter()
            .enumerate()
            .map(|(bin, x)| (bin as f64 * rate_hz / len, scale * x));
        (
            thinned(points.take_while(|point| point.0 <= end_hz)),
            colour,
        )
    });
    let values = curves
        .iter()
        .flat_map(|(points, _)| points.iter().map(|point| point.1));
    let x = Axis {
        range: 0.0..end_hz,
        quantity: "frequency (Hz)",
        ticks: Ticks::Numbers(8),
    };
    let y = Axis {
        range: range_with_zero(values),
        quantity: "smoothed DFT amplitude (m/s²/√Hz)",
        ticks: Ticks::Numbers(8),
    };
    let mut chart = axes(area, &x, &y)?;
    for (points, colour) in curves {
        chart.draw_series(LineSeries::new(points, line(colour, 3)))?;
    }
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
            assert!(svg.as_str().len() < 150_000, "{}", svg.as_str().len());
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
