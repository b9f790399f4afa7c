//! Measured levels over frequency.

use stylus_support::Result;

use super::canvas::{Axis, Drawn, INK, Plot, SERIES, Stroke, Swatch, chart};
use super::curves::{FIRST_OCTAVE_HZ, OCTAVES_HZ};
use super::figure::{FREQUENCY, POWER_DENSITY};
use super::{Caption, Quantity, Svg};

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
    let levels = || curves.iter().flat_map(|curve| curve.points).map(|point| point.1);
    // The range is at least twice the band, so that the band's lines are not the picture's edges.
    let low = levels().fold(-2.0 * within_db, f64::min).floor() - 1.0;
    let high = levels().fold(2.0 * within_db, f64::max).ceil() + 1.0;
    let y = Axis::new(Quantity::new("gain", "dB"), low..high, 9);
    over_octaves(caption, -0.7, &y, curves, |plot| {
        for level in [-within_db, within_db] {
            let stroke = Stroke {
                dashed: true,
                ..Stroke::solid(INK, 1)
            };
            plot.path(band_hz.map(|hz| (octave(hz), level)).to_vec(), stroke)?;
        }
        Ok(())
    })
}

/// Draws power spectral densities, dB re 1 (m/s²)²/Hz, over octaves, within 80 dB of the highest.
pub fn densities(caption: &Caption<'_>, curves: &[Curve<'_>]) -> Result<Svg> {
    let levels = || curves.iter().flat_map(|curve| curve.points).map(|point| point.1);
    let finite = || levels().filter(|level| level.is_finite());
    let high = finite().reduce(f64::max).unwrap_or(0.0).ceil() + 1.0;
    let low = finite()
        .reduce(f64::min)
        .unwrap_or(0.0)
        .floor()
        .clamp(high - 80.0, high - 20.0);
    let kept: Vec<Vec<(f64, f64)>> = curves
        .iter()
        .map(|curve| {
            (curve.points.iter().copied())
                .filter(|point| point.1 >= low && point.1 <= high)
                .collect()
        })
        .collect();
    let drawn: Vec<Curve<'_>> = curves
        .iter()
        .zip(&kept)
        .map(|(curve, points)| Curve { points, ..*curve })
        .collect();
    over_octaves(
        caption,
        0.0,
        &Axis::new(POWER_DENSITY, low..high, 9),
        &drawn,
        |_| Ok(()),
    )
}

/// Octaves from the first that is written to `hz`.
fn octave(hz: f64) -> f64 {
    (hz / FIRST_OCTAVE_HZ).log2()
}

/// Draws curves over frequency, from the octave `first` to 1 kHz, above what `below` draws.
fn over_octaves(
    caption: &Caption<'_>,
    first: f64,
    y: &Axis<'_>,
    curves: &[Curve<'_>],
    below: impl FnOnce(&mut Plot<'_>) -> Drawn,
) -> Result<Svg> {
    let x = Axis::of_octaves(FREQUENCY, first..6.05, FIRST_OCTAVE_HZ.log2(), &OCTAVES_HZ);
    let entries: Vec<(Swatch, &str)> = curves
        .iter()
        .zip(SERIES.into_iter().cycle())
        .map(|(curve, colour)| (Swatch::line(colour), curve.name))
        .collect();
    chart(caption, (720, 400), &entries, (&x, y), |plot| {
        below(plot)?;
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
