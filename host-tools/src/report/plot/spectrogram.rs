//! Spectrograms of a recording and its synthesis, side by side.

use std::f64::consts::TAU;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use plotters::prelude::*;

use super::canvas::{Area, Axis, Drawn, INK, TEXT, Ticks, at, axes, centred, picture, text};
use super::{Caption, Svg};
use crate::dsp::spectrum::dft_amplitude;
use crate::support::error::{Error, Result};

/// Length of a window, s: lines 12 Hz apart are told apart.
const WINDOW_S: f64 = 0.16;

/// Windows in a picture at most.
const COLUMNS: usize = 240;

/// Levels shown below the highest, dB.
const RANGE_DB: f64 = 60.0;

/// Spectrograms of a recording and of its synthesis, m/s², from 0 Hz to `highest_hz`, in dB to one scale.
///
/// # Errors
/// Signals without power, a rate or highest frequency that is not positive, and that the picture cannot be laid out.
pub fn spectrograms(
    caption: &Caption<'_>,
    recorded: &[f64],
    synthesised: &[f64],
    rate_hz: f64,
    highest_hz: f64,
) -> Result<Svg> {
    if !(rate_hz > 0.0 && highest_hz > 0.0 && highest_hz.is_finite()) {
        return Err(Error::Request(format!(
            "a spectrogram up to {highest_hz} Hz at {rate_hz} Hz cannot be drawn"
        )));
    }
    let len = recorded.len().min(synthesised.len());
    let highest_hz = highest_hz.min(0.5 * rate_hz);
    let panels = [recorded, synthesised]
        .map(|signal| levels_db(&signal[..len], rate_hz, highest_hz, WINDOW_S));
    let top_db = panels
        .iter()
        .flat_map(|panel| panel.iter().flatten())
        .copied()
        .filter(|level| level.is_finite())
        .fold(f64::MIN, f64::max);
    if top_db <= f64::MIN {
        return Err(Error::Request(format!(
            "the spectrogram '{}' is of silence",
            caption.title
        )));
    }
    let mut images = Vec::new();
    let svg = picture(caption, (960, 380), |area| {
        let (panes, bar) = area.split_horizontally(at(880));
        let halves = panes.split_evenly((1, 2));
        let names = ["recorded", "synthesised"];
        for ((half, panel), name) in halves.iter().zip(&panels).zip(names) {
            let place = draw_axes(half, name, len as f64 / rate_hz, highest_hz)?;
            images.push(image(place, &png(panel, top_db)?));
        }
        draw_bar(&bar, top_db)
    })?;
    // In the frames drawn for them.
    Ok(svg.with(&images.concat()))
}

/// One column a window of `window_s`, its levels from the lowest frequency up, dB.
pub(super) fn levels_db(
    signal: &[f64],
    rate_hz: f64,
    highest_hz: f64,
    window_s: f64,
) -> Vec<Vec<f64>> {
    let window = ((window_s * rate_hz) as usize).clamp(2, signal.len().max(2));
    let spare = signal.len().saturating_sub(window);
    let columns = (4 * spare / window + 1).min(COLUMNS);
    let weights: Vec<f64> = (0..window)
        .map(|n| 0.5 - 0.5 * (TAU * (n as f64 + 0.5) / window as f64).cos())
        .collect();
    let bins = (highest_hz * window as f64 / rate_hz) as usize + 1;
    (0..columns)
        .map(|column| {
            let begin = spare * column / columns.max(2).saturating_sub(1).max(1);
            let windowed: Vec<f64> = signal[begin.min(spare)..]
                .iter()
                .zip(&weights)
                .map(|(value, weight)| value * weight)
                .collect();
            let amplitude = dft_amplitude(&windowed);
            amplitude
                .iter()
                .take(bins)
                .map(|a| 20.0 * a.log10())
                .collect()
        })
        .collect()
}

/// Draws the frame of a panel and gives where it is, in drawn pixels: left, top, width, height.
fn draw_axes(
    area: &Area<'_>,
    name: &str,
    seconds: f64,
    highest_hz: f64,
) -> Drawn<(i32, i32, i32, i32)> {
    let (heading, below) = area.split_vertically(at(22));
    let middle = (heading.dim_in_pixel().0 as i32 / 2, at(12));
    heading.draw_text(name, &centred(TEXT, INK), middle)?;
    let x = Axis {
        range: 0.0..seconds.max(1e-3),
        quantity: "time (s)",
        ticks: Ticks::Numbers(6),
    };
    let y = Axis {
        range: 0.0..highest_hz,
        quantity: "frequency (Hz)",
        ticks: Ticks::Numbers(8),
    };
    let chart = axes(&below, &x, &y)?;
    let (columns, rows) = chart.plotting_area().get_pixel_range();
    Ok((
        columns.start,
        rows.start,
        columns.end - columns.start,
        rows.end - rows.start,
    ))
}

fn draw_bar(area: &Area<'_>, top_db: f64) -> Drawn {
    const STEPS: i32 = 40;
    let (top, bottom) = (at(30), area.dim_in_pixel().1 as i32 - at(52));
    for step in 0..STEPS {
        let y = |step: i32| bottom - (bottom - top) * step / STEPS;
        let [r, g, b] = colour((f64::from(step) + 0.5) / f64::from(STEPS));
        // Each reaches into the one below, so that no light shows between them.
        let cell = [
            (at(4), y(step + 1)),
            (at(18), (y(step) + at(1)).min(bottom)),
        ];
        area.draw(&Rectangle::new(cell, RGBColor(r, g, b).filled()))?;
    }
    for (level, y) in [(top_db, top), (top_db - RANGE_DB, bottom)] {
        area.draw_text(
            &format!("{:.0}", level - top_db),
            &text(TEXT, INK),
            (at(24), y),
        )?;
    }
    let style = text(TEXT, INK);
    area.draw_text("dB", &style, (at(24), i32::midpoint(top, bottom)))?;
    Ok(())
}

/// A colour of a scale that rises in lightness throughout, from dark blue by green to yellow.
fn colour(share: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 5] = [
        [20.0, 16.0, 60.0],
        [60.0, 70.0, 140.0],
        [30.0, 140.0, 140.0],
        [110.0, 200.0, 90.0],
        [250.0, 235.0, 60.0],
    ];
    let place = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let below = (place as usize).min(STOPS.len() - 2);
    let fraction = place - below as f64;
    std::array::from_fn(|i| {
        (STOPS[below][i] + (STOPS[below + 1][i] - STOPS[below][i]) * fraction) as u8
    })
}

/// The panel as a PNG, a pixel a window and bin.
pub(super) fn png(panel: &[Vec<f64>], top_db: f64) -> Drawn<Vec<u8>> {
    let (width, height) = (panel.len(), panel[0].len());
    let mut pixels = Vec::with_capacity(3 * width * height);
    for bin in (0..height).rev() {
        for column in panel {
            let level = column[bin];
            let share = (level - top_db + RANGE_DB) / RANGE_DB;
            pixels.extend(colour(if share.is_nan() { 0.0 } else { share }));
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(bytes)
}

/// The element that shows a PNG in a frame: left, top, width, height in drawn pixels.
pub(super) fn image((x, y, width, height): (i32, i32, i32, i32), png: &[u8]) -> String {
    format!(
        "<image x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" preserveAspectRatio=\"none\" \
         href=\"data:image/png;base64,{}\"/>\n",
        STANDARD.encode(png)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAPTION: Caption<'_> = Caption {
        title: "test",
        simulated: true,
    };

    fn chirp(len: usize) -> Vec<f64> {
        (0..len)
            .map(|n| (TAU * (100.0 + 0.02 * n as f64) * n as f64 / 5000.0).sin())
            .collect()
    }

    #[test]
    fn both_signals_are_pictures_within_the_picture() {
        let svg = spectrograms(&CAPTION, &chirp(10_000), &chirp(12_000), 5000.0, 1000.0).unwrap();
        assert_eq!(svg.as_str().matches("<image").count(), 2);
        assert!(svg.as_str().trim_end().ends_with("</svg>"));
        assert!(svg.as_str().contains("SIMULATED"));
        assert!(svg.as_str().len() < 250_000, "{}", svg.as_str().len());
    }

    #[test]
    fn a_line_is_brightest_where_it_sounds() {
        let line: Vec<f64> = (0..10_000)
            .map(|n| (TAU * 300.0 * f64::from(n) / 5000.0).sin())
            .collect();
        for column in levels_db(&line, 5000.0, 1000.0, WINDOW_S) {
            let peak = (0..column.len())
                .max_by(|a, b| column[*a].total_cmp(&column[*b]))
                .unwrap();
            assert!((peak as f64 / WINDOW_S - 300.0).abs() < 7.0, "{peak}");
        }
    }

    #[test]
    fn silence_and_next_to_nothing_do_not_fail_otherwise_than_by_an_error() {
        assert!(spectrograms(&CAPTION, &[0.0; 900], &[0.0; 900], 5000.0, 1000.0).is_err());
        assert!(spectrograms(&CAPTION, &[], &[], 5000.0, 1000.0).is_err());
        assert!(spectrograms(&CAPTION, &chirp(10), &chirp(10), 5000.0, 0.0).is_err());
        assert!(spectrograms(&CAPTION, &chirp(10), &chirp(10), 5000.0, 1000.0).is_ok());
    }
}
