//! Waveforms of several signals, one below the other, with their envelopes.

use stylus_support::Result;

use super::canvas::{
    Axis, HEADING, INK, LEFT, SERIES, Stroke, Swatch, TEXT, at, axes, legend, picture, range_around_zero, text,
};
use super::figure::{ACCELERATION, TIME_MS, TIME_S};
use super::{Caption, Svg};

/// Durations of the two columns, s. The left one shows cycles, the right one changes of level.
const DURATIONS_S: [f64; 2] = [0.1, 2.0];

/// Window of the envelope, s.
const ENVELOPE_S: f64 = 0.01;

/// Height of a row, shown pixels.
const ROW: u32 = 144;

/// Height of a signal's name above its row, shown pixels.
const NAME: u32 = 18;

/// Height of the lowest row's numbers and of the legend together, shown pixels.
const BESIDE: u32 = 64;

/// Draws signals, m/s², each with its name, one below the other: the middle 100 ms on the left, and the middle 2 s on
/// the right, both with the envelope, ± the RMS over windows of 10 ms. All signals have one scale.
pub fn waveforms(caption: &Caption<'_>, signals: &[(&str, &[f64])], rate_hz: f64) -> Result<Svg> {
    let middle = |signal: &'_ [f64], seconds: f64| {
        let len = ((seconds * rate_hz).round() as usize).min(signal.len());
        let begin = (signal.len() - len) / 2;
        begin..begin + len
    };
    // Samples outside the longer column are not drawn. They do not count, because a click there would make the drawn
    // part small.
    let drawn = signals
        .iter()
        .flat_map(|(_, signal)| &signal[middle(signal, DURATIONS_S[1])]);
    let range = range_around_zero(drawn.copied());
    let height = HEADING + BESIDE + ROW * signals.len().max(1) as u32;
    picture(caption, (960, height), |area| {
        let mut panels = Vec::new();
        let entries = [(Swatch::line(INK), "± RMS over 10 ms, over the samples")];
        let halves = legend(area, &entries)?.split_evenly((1, 2));
        let columns = halves
            .into_iter()
            .zip(DURATIONS_S)
            .zip([(1000.0, TIME_MS), (1.0, TIME_S)]);
        for ((mut rest, seconds), (unit, quantity)) in columns {
            for (row, (name, signal)) in signals.iter().enumerate() {
                let is_last = row + 1 == signals.len();
                let pane = if is_last {
                    rest.clone()
                } else {
                    let (pane, below) = rest.split_vertically(at(ROW));
                    rest = below;
                    pane
                };
                let (name_area, pane) = pane.split_vertically(at(NAME));
                let x = Axis::new(quantity, 0.0..unit * seconds, 6).told_if(is_last);
                let y = Axis::new(ACCELERATION, range.clone(), 4);
                let mut plot = axes(&pane, &format!("{name}, {seconds} s"), &x, &y)?;
                let signal = &signal[middle(signal, seconds)];
                let time = |n: f64| unit * n / rate_hz;
                let points = signal.iter().enumerate().map(|(n, value)| (time(n as f64), *value));
                let stroke = Stroke::solid(SERIES[row % SERIES.len()], 2);
                plot.curve("samples", points, stroke)?;
                let envelope = envelope(signal, rate_hz);
                for (sign, name) in [(1.0, "+ RMS over 10 ms"), (-1.0, "- RMS over 10 ms")] {
                    let points = envelope.iter().map(|&(n, rms)| (time(n), sign * rms));
                    plot.curve(name, points, Stroke::solid(INK, 3))?;
                }
                name_area.draw_text(name, &text(TEXT, INK), (at(LEFT + 6), at(NAME / 2 + 2)))?;
                panels.push(plot.panel);
            }
        }
        Ok(panels)
    })
}

/// Computes the RMS over windows of 10 ms that overlap by half. Each value is at its window's middle sample.
fn envelope(signal: &[f64], rate_hz: f64) -> Vec<(f64, f64)> {
    // At least two samples, because the step is half a window.
    let window = ((ENVELOPE_S * rate_hz).round() as usize).max(2);
    signal
        .windows(window)
        .step_by(window / 2)
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
    use super::*;

    #[test]
    fn the_envelope_is_the_rms_at_its_middle() {
        let step: Vec<f64> = (0..1000).map(|n| if n < 500 { 1.0 } else { 3.0 }).collect();
        let envelope = envelope(&step, 5000.0);
        assert_eq!(envelope[0], (25.0, 1.0));
        for (n, rms) in envelope {
            let is_sure = !(475.0..=525.0).contains(&n);
            let expected: f64 = if n < 500.0 { 1.0 } else { 3.0 };
            assert!(!is_sure || (rms - expected).abs() < 1e-12, "{n}: {rms}");
        }
    }
}
