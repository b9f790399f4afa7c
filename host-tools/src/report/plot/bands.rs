//! The error of a synthesis by third-octave band.

use plotters::prelude::*;

use super::canvas::{
    Axis, BLUE, INK, Mark, Stroke, Swatch, TEXT, VERMILION, at, axes, centred, legend, line,
    picture, range_around_zero,
};
use super::colours::SHADE;
use super::figure::{Kind, Quantity, Series};
use super::{Caption, Svg};
use crate::dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT, BAND_LABELS_HZ};
use crate::support::decimal::signed;
use crate::support::error::Result;

/// Bars of the level of a synthesis over that of its recording in each third-octave band, dB
/// ([`crate::dsp::spectrum::band_errors_db`]), with the range shaded in which skin tells no difference.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn band_error_chart(
    caption: &Caption<'_>,
    errors_db: &[Option<f64>; BAND_COUNT],
) -> Result<Svg> {
    let errors_db = errors_db.map(|error| error.filter(|error| error.is_finite()));
    // Room for the number at the end of the longest bar.
    let ends = errors_db.iter().flatten().map(|error| 1.15 * error);
    let range = range_around_zero(ends.chain([3.0 * AMPLITUDE_JND_DB]));
    let bands = -0.6..BAND_COUNT as f64 - 0.4;
    let (left, right) = (bands.start, bands.end);
    let x = Axis::of_names(
        Quantity::new("third-octave band", "Hz"),
        bands,
        &BAND_LABELS_HZ,
    );
    let y = Axis::new(
        Quantity::new("level, synthesised over recorded", "dB"),
        range,
        9,
    );
    let within = format!("±{AMPLITUDE_JND_DB} dB, the just noticeable difference");
    let mut entries = vec![(Swatch::Box(SHADE), within.as_str())];
    let is_within = |error: &f64| error.abs() <= AMPLITUDE_JND_DB;
    let mut errors = errors_db.iter().flatten();
    if errors.clone().any(is_within) {
        entries.push((Swatch::Box(BLUE), "error within"));
    }
    if errors.any(|error| !is_within(error)) {
        entries.push((Swatch::Box(VERMILION), "error beyond"));
    }
    if errors_db.contains(&None) {
        entries.push((Swatch::Mark(Mark::Cross), "no power in the band"));
    }
    picture(caption, (960, 400), |area, panels| {
        let mut plot = axes(&legend(area, &entries)?, "", &x, &y)?;
        let shade = [(left, -AMPLITUDE_JND_DB), (right, AMPLITUDE_JND_DB)];
        plot.chart
            .draw_series([Rectangle::new(shade, SHADE.filled())])?;
        plot.path(vec![(left, 0.0), (right, 0.0)], Stroke::solid(INK, 2))?;
        for (band, error) in errors_db.iter().enumerate() {
            let centre = band as f64;
            let Some(error) = *error else {
                let cross = Cross::new((centre, 0.0), at(4), line(INK, 3));
                plot.chart.draw_series([cross])?;
                continue;
            };
            let colour = if is_within(&error) { BLUE } else { VERMILION };
            let bar = [
                (centre - 0.3, error.max(0.0)),
                (centre + 0.3, error.min(0.0)),
            ];
            plot.chart
                .draw_series([Rectangle::new(bar, colour.filled())])?;
            let above = if error < 0.0 { at(9) } else { -at(9) };
            let written = signed(error, usize::from(error.abs() < 99.5));
            let number = EmptyElement::at((centre, error))
                + Text::new(written, (0, above), centred(TEXT - 2, INK));
            plot.chart.draw_series([number])?;
        }
        let points: Vec<(f64, f64)> = (0..)
            .map(f64::from)
            .zip(errors_db.map(|error| error.unwrap_or(f64::NAN)))
            .collect();
        let series = Series::new("error", Kind::Bars, BLUE, &points);
        plot.panel.series.push(series);
        panels.push(plot.panel);
        Ok(())
    })
}
