//! The error of a synthesis by third-octave band.

use plotters::prelude::*;

use super::canvas::{
    Axis, BLUE, INK, Mark, Quantity, Swatch, TEXT, Ticks, VERMILION, at, axes, centred, highest_of,
    legend, line, picture,
};
use super::colours::SHADE;
use super::figure::{Kind, Series};
use super::{Caption, Svg};
use crate::dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT, BAND_LABELS_HZ};
use crate::support::decimal::signed;
use crate::support::error::Result;

/// Level of a synthesis over its recording's.
const LEVEL_ERROR: Quantity<'static> = Quantity::new("level, synthesised over recorded", "dB");

/// Bars of the level of a synthesis over that of its recording in each third-octave band, dB
/// ([`crate::dsp::spectrum::band_errors_db`]), with the range shaded in which skin tells no difference. The
/// axis reaches to `largest_db` where pictures are compared.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn band_error_chart(
    caption: &Caption<'_>,
    errors_db: &[Option<f64>; BAND_COUNT],
    largest_db: Option<f64>,
) -> Result<Svg> {
    let errors_db = errors_db.map(|error| error.filter(|error| error.is_finite()));
    let own = highest_of(errors_db.iter().flatten().copied());
    let largest = largest_db.or(own).unwrap_or(0.0);
    // Room for the number at the end of the longest bar.
    let highest = (1.2 * largest).max(3.0 * AMPLITUDE_JND_DB);
    let x = Axis {
        range: -0.6..BAND_COUNT as f64 - 0.4,
        quantity: Quantity::new("third-octave band", "Hz"),
        ticks: Ticks::Names(&BAND_LABELS_HZ),
    };
    let y = Axis {
        range: -highest..highest,
        quantity: LEVEL_ERROR,
        ticks: Ticks::Numbers(9),
    };
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
        let below = legend(area, &entries)?;
        let mut plot = axes(&below, "", &x, &y)?;
        let chart = &mut plot.chart;
        let shade = [
            (x.range.start, -AMPLITUDE_JND_DB),
            (x.range.end, AMPLITUDE_JND_DB),
        ];
        chart.draw_series([Rectangle::new(shade, SHADE.filled())])?;
        chart.draw_series([PathElement::new(
            [(x.range.start, 0.0), (x.range.end, 0.0)],
            line(INK, 2),
        )])?;
        for (band, error) in errors_db.iter().enumerate() {
            let centre = band as f64;
            let Some(error) = *error else {
                chart.draw_series([Cross::new((centre, 0.0), at(4), line(INK, 3))])?;
                continue;
            };
            let colour = if is_within(&error) { BLUE } else { VERMILION };
            let bar = [
                (centre - 0.3, error.max(0.0)),
                (centre + 0.3, error.min(0.0)),
            ];
            chart.draw_series([Rectangle::new(bar, colour.filled())])?;
            let above = if error < 0.0 { at(9) } else { -at(9) };
            let decimals = usize::from(error.abs() < 99.5);
            let written = signed(error, decimals);
            let number = EmptyElement::at((centre, error))
                + Text::new(written, (0, above), centred(TEXT - 2, INK));
            chart.draw_series([number])?;
        }
        let points: Vec<(f64, f64)> = errors_db
            .iter()
            .enumerate()
            .map(|(band, error)| (band as f64, error.unwrap_or(f64::NAN)))
            .collect();
        let series = Series::new("error", Kind::Bars, BLUE, &points);
        plot.panel.series.push(series);
        panels.push(plot.panel);
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;

    fn chart(errors_db: &[Option<f64>; BAND_COUNT]) -> Svg {
        band_error_chart(
            &Caption {
                title: "test",
                simulated: false,
            },
            errors_db,
            None,
        )
        .unwrap()
    }

    fn count(svg: &Svg, colour: RGBColor) -> usize {
        let RGBColor(red, green, blue) = colour;
        // The same colour once more in the legend.
        svg.as_str()
            .matches(&format!("fill=\"#{red:02X}{green:02X}{blue:02X}\""))
            .count()
            - 1
    }

    #[test]
    fn every_band_is_named_and_coloured_by_what_is_felt() {
        let mut errors_db = [Some(1.0); BAND_COUNT];
        errors_db[3] = Some(AMPLITUDE_JND_DB + 0.01);
        errors_db[4] = Some(-30.0);
        errors_db[5] = None;
        let svg = chart(&errors_db);
        assert_drawn_within(&svg, 960, 400);
        assert_eq!(
            (count(&svg, BLUE), count(&svg, VERMILION)),
            (BAND_COUNT - 3, 2)
        );
        assert!(svg.as_str().contains("no power in the band"));
        for label in BAND_LABELS_HZ {
            assert!(svg.as_str().contains(&format!(">\n{label}\n<")), "{label}");
        }
    }

    #[test]
    fn a_chart_of_nothing_and_of_what_is_not_a_number_can_be_drawn() {
        for error in [
            None,
            Some(0.0),
            Some(f64::NAN),
            Some(f64::NEG_INFINITY),
            Some(1e9),
        ] {
            assert_drawn_within(&chart(&[error; BAND_COUNT]), 960, 400);
        }
    }
}
