//! Measured levels over frequency.

use super::canvas::{Axis, INK, SERIES, Stroke, Swatch, chart};
use super::curves::{FIRST_OCTAVE_HZ, OCTAVES_HZ};
use super::figure::FREQUENCY;
use super::{Caption, Quantity, Svg};
use crate::support::error::Result;

/// A level over frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve<'a> {
    /// Name of the curve.
    pub name: &'a str,
    /// Frequency, Hz, and level, dB.
    pub points: &'a [(f64, f64)],
}

/// Draws levels from 10 Hz to 1 kHz over octaves, with dashed lines at ± `within_db` over `band_hz`.
pub fn responses(caption: &Caption<'_>, curves: &[Curve<'_>], band_hz: [f64; 2], within_db: f64) -> Result<Svg> {
    let lowest = FIRST_OCTAVE_HZ.log2();
    let octave = |hz: f64| hz.log2() - lowest;
    let levels = || curves.iter().flat_map(|curve| curve.points).map(|point| point.1);
    // The range is at least twice the band, so that the band's lines are not the picture's edges.
    let low = levels().fold(-2.0 * within_db, f64::min).floor() - 1.0;
    let high = levels().fold(2.0 * within_db, f64::max).ceil() + 1.0;
    let x = Axis::of_octaves(FREQUENCY, -0.7..6.05, lowest, &OCTAVES_HZ);
    let y = Axis::new(Quantity::new("gain", "dB"), low..high, 9);
    let entries: Vec<(Swatch, &str)> = curves
        .iter()
        .zip(SERIES.into_iter().cycle())
        .map(|(curve, colour)| (Swatch::line(colour), curve.name))
        .collect();
    chart(caption, (720, 400), &entries, (&x, &y), |plot| {
        for level in [-within_db, within_db] {
            let stroke = Stroke {
                dashed: true,
                ..Stroke::solid(INK, 1)
            };
            plot.path(band_hz.map(|hz| (octave(hz), level)).to_vec(), stroke)?;
        }
        for (curve, colour) in curves.iter().zip(SERIES.into_iter().cycle()) {
            let points = curve.points.iter().map(|&(hz, level)| (octave(hz), level));
            plot.curve(curve.name, points, Stroke::solid(colour, 3))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_is_drawn_however_many_there_are() {
        let points = [(20.0, 1.0), (400.0, -1.0)];
        let names: Vec<String> = (0..2 * SERIES.len()).map(|n| format!("curve {n}")).collect();
        let curves: Vec<Curve<'_>> = names.iter().map(|name| Curve { name, points: &points }).collect();
        let caption = Caption::new("Responses", false);
        let picture = responses(&caption, &curves, [20.0, 400.0], 2.0).unwrap();
        let series = &picture.panels()[0].series;
        for name in &names {
            assert!(series.iter().any(|one| one.name == *name), "{name}");
        }
    }
}
