//! Waveforms of several signals beside each other, with their envelopes.

use plotters::prelude::*;

use super::canvas::{
    ACCELERATION, Area, Axis, Drawn, INK, LEFT, Stroke, Swatch, TEXT, TIME_MS, TIME_S, Ticks, at,
    axes, highest_of, legend, picture, text,
};
use super::colours::SERIES;
use super::figure::Panel;
use super::{Caption, Svg};
use crate::support::error::{Error, Result};

/// Durations of the two columns, s: cycles on the left, changes of level on the right.
pub const DURATIONS_S: [f64; 2] = [0.1, 2.0];

/// Window of the envelope, s.
const ENVELOPE_S: f64 = 0.01;

/// Shown height of a row, pixels.
const ROW: u32 = 130;

/// Signals, m/s², each with its name, one below the other: 100 ms of the middle on the left, 2 s on the right, with
/// the envelope, ± the RMS over windows of 10 ms. All have one scale, up to `peak_m_s2` where pictures are compared.
///
/// # Errors
/// A rate that is not positive, and that the picture cannot be laid out.
pub fn waveforms(
    caption: &Caption<'_>,
    signals: &[(&str, &[f64])],
    rate_hz: f64,
    peak_m_s2: Option<f64>,
) -> Result<Svg> {
    if !(rate_hz > 0.0 && rate_hz.is_finite()) {
        return Err(Error::Request(format!(
            "waveforms at {rate_hz} Hz cannot be drawn"
        )));
    }
    let columns = DURATIONS_S.map(|seconds| {
        let signals = signals.iter();
        let middles = signals.map(|(_, signal)| middle(signal, seconds, rate_hz));
        middles.collect::<Vec<&[f64]>>()
    });
    let own = peak(signals.iter().map(|(_, signal)| *signal), rate_hz);
    let highest = peak_m_s2.or(own).map_or(1.0, |peak| 1.06 * peak);
    let rows = signals.len().max(1) as u32;
    picture(caption, (960, 32 + 24 + 40 + ROW * rows), |area, panels| {
        let entries = [(
            Swatch::Line {
                colour: INK,
                dashed: false,
            },
            "± RMS over 10 ms, over the samples",
        )];
        let below = legend(area, &entries)?;
        let halves = below.split_evenly((1, 2));
        for ((half, column), seconds) in halves.iter().zip(&columns).zip(DURATIONS_S) {
            let mut rest = half.clone();
            for (row, ((name, _), signal)) in signals.iter().zip(column).enumerate() {
                let is_last = row + 1 == signals.len();
                let (own, left) = if is_last {
                    (rest.clone(), rest)
                } else {
                    rest.split_vertically(at(ROW))
                };
                rest = left;
                let view = View {
                    seconds,
                    rate_hz,
                    highest,
                    is_last,
                };
                panels.push(draw(&own, name, signal, colour(row), &view)?);
            }
        }
        Ok(())
    })
}

/// The largest magnitude that [`waveforms`] draws of signals; `None` of silence.
pub fn peak<'s>(signals: impl Iterator<Item = &'s [f64]>, rate_hz: f64) -> Option<f64> {
    let longest_s = DURATIONS_S.into_iter().fold(0.0, f64::max);
    highest_of(signals.flat_map(|signal| middle(signal, longest_s, rate_hz).iter().copied()))
}

/// The middle of a signal.
fn middle(signal: &[f64], seconds: f64, rate_hz: f64) -> &[f64] {
    let len = ((seconds * rate_hz).round() as usize).min(signal.len());
    let begin = (signal.len() - len) / 2;
    &signal[begin..begin + len]
}

/// Colour of a row; the recording is the first.
fn colour(row: usize) -> RGBColor {
    SERIES[row % SERIES.len()]
}

/// The frame of a panel.
struct View {
    seconds: f64,
    rate_hz: f64,
    highest: f64,
    is_last: bool,
}

fn draw(
    area: &Area<'_>,
    name: &str,
    signal: &[f64],
    colour: RGBColor,
    view: &View,
) -> Drawn<Panel> {
    let (unit, quantity) = if view.seconds < 1.0 {
        (1000.0, TIME_MS)
    } else {
        (1.0, TIME_S)
    };
    let x = Axis {
        range: 0.0..unit * view.seconds,
        quantity,
        ticks: if view.is_last {
            Ticks::Numbers(6)
        } else {
            Ticks::Blank(6)
        },
    };
    let y = Axis {
        range: -view.highest..view.highest,
        quantity: ACCELERATION,
        ticks: Ticks::Numbers(4),
    };
    let mut plot = axes(area, &format!("{name}, {} s", view.seconds), &x, &y)?;
    let time = |n: f64| unit * n / view.rate_hz;
    let samples = signal.iter().enumerate();
    let points = samples.map(|(n, value)| (time(n as f64), *value));
    plot.curve("samples", points, Stroke::solid(colour, 2))?;
    let envelope = envelope(signal, view.rate_hz);
    for (sign, name) in [(1.0, "+ RMS over 10 ms"), (-1.0, "- RMS over 10 ms")] {
        let points = envelope.iter().map(|&(n, rms)| (time(n), sign * rms));
        plot.curve(name, points, Stroke::solid(INK, 3))?;
    }
    area.draw_text(name, &text(TEXT, INK), (at(LEFT + 14), at(16)))?;
    Ok(plot.panel)
}

/// RMS over windows of 10 ms that overlap by half, each with the sample at its middle.
fn envelope(signal: &[f64], rate_hz: f64) -> Vec<(f64, f64)> {
    let window = ((ENVELOPE_S * rate_hz).round() as usize).max(2);
    let windows = signal.windows(window).step_by(window / 2);
    windows
        .enumerate()
        .map(|(index, part)| {
            let square = part.iter().map(|x| x * x).sum::<f64>() / window as f64;
            let middle = index * (window / 2) + window / 2;
            (middle as f64, square.sqrt())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;

    fn caption() -> Caption<'static> {
        Caption {
            title: "test",
            simulated: true,
        }
    }

    #[test]
    fn every_signal_is_named_in_both_columns_and_drawn_within_the_picture() {
        let long: Vec<f64> = (0..30_000).map(|n| (f64::from(n) * 0.1).sin()).collect();
        let names = ["recording", "synthesis", "Gaussian", "residual"];
        let signals: Vec<(&str, &[f64])> = names.iter().map(|name| (*name, &long[..])).collect();
        let svg = waveforms(&caption(), &signals, 5000.0, None).unwrap();
        assert_drawn_within(&svg, 960, 96 + 130 * 4);
        for name in names {
            assert_eq!(
                svg.as_str().matches(&format!("\n{name}\n")).count(),
                2,
                "{name}"
            );
        }
        assert!(svg.as_str().contains("SIMULATED"));
    }

    #[test]
    fn short_silent_and_no_signals_can_be_drawn() {
        let odd = [f64::NAN, f64::INFINITY, 1.0];
        for signals in [
            vec![],
            vec![("none", &[][..])],
            vec![("one", &[1.0][..]), ("silence", &[0.0; 5000][..])],
            vec![("odd", &odd[..])],
        ] {
            let rows = signals.len().max(1) as u32;
            let svg = waveforms(&caption(), &signals, 5000.0, None).unwrap();
            assert_drawn_within(&svg, 960, 96 + 130 * rows);
        }
        assert!(waveforms(&caption(), &[], 0.0, None).is_err());
    }

    #[test]
    fn the_envelope_is_the_rms_at_its_middle() {
        let step: Vec<f64> = (0..1000).map(|n| if n < 500 { 1.0 } else { 3.0 }).collect();
        let envelope = envelope(&step, 5000.0);
        assert_eq!(envelope[0], (25.0, 1.0));
        for (n, rms) in envelope {
            let expected = if n < 475.0 {
                Some(1.0)
            } else if n > 525.0 {
                Some(3.0)
            } else {
                None
            };
            assert!(
                expected.is_none_or(|expected| (rms - expected).abs() < 1e-12),
                "{n}: {rms}"
            );
        }
    }
}
