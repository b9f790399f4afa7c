//! A recording and its synthesis in frequency.

use super::canvas::{
    Axis, BLUE, Stroke, Swatch, VERMILION, axes, legend, picture, range_with_zero,
};
use super::figure::{FREQUENCY, Quantity};
use super::{Caption, Svg};
use crate::dsp::spectrum::{smoothed_amplitude, spectral_cost};
use crate::support::error::Result;

/// Highest frequency shown, Hz: as high as skin feels.
const HIGHEST_HZ: f64 = 1000.0;

/// The paper's figures 7 and 10: the smoothed DFT amplitudes of a recording and of its synthesis, and in the title the
/// cost C ([`spectral_cost`]).
///
/// Amplitudes are scaled by √(2 / (N · rate)), so that those of noise do not depend on the length N: m/s²/√Hz. The
/// longer signal is cut as for C.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn spectra(
    caption: &Caption<'_>,
    (recorded, synthesised): (&[f64], &[f64]),
    rate_hz: f64,
    smoothing_width_hz: f64,
) -> Result<Svg> {
    let cost = spectral_cost(recorded, synthesised, rate_hz, smoothing_width_hz);
    let cost = cost.map_or("C is undefined".to_owned(), |cost| {
        format!("C = {:.1} %", 100.0 * cost)
    });
    let title = format!("{}: {cost}", caption.title);
    let caption = Caption {
        title: &title,
        ..*caption
    };
    let len = recorded.len().min(synthesised.len());
    let end_hz = HIGHEST_HZ.min(rate_hz / 2.0);
    let curves = [
        (recorded, BLUE, "recorded"),
        (synthesised, VERMILION, "synthesised"),
    ]
    .map(|(signal, colour, name)| {
        let scale = (2.0 / (len.max(1) as f64 * rate_hz)).sqrt();
        let amplitude = smoothed_amplitude(&signal[..len], rate_hz, smoothing_width_hz);
        let bins = amplitude.into_iter().enumerate();
        let points = bins.map(|(bin, x)| (bin as f64 * rate_hz / len as f64, scale * x));
        let points: Vec<(f64, f64)> = points.take_while(|point| point.0 <= end_hz).collect();
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
    picture(&caption, (960, 400), |area, panels| {
        let mut plot = axes(&legend(area, &entries)?, "", &x, &y)?;
        for (points, colour, name) in curves {
            plot.curve(name, points.into_iter(), Stroke::solid(colour, 3))?;
        }
        panels.push(plot.panel);
        Ok(())
    })
}
