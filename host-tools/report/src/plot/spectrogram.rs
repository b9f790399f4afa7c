//! Spectrograms of a recording and its synthesis, one above the other.

use std::f64::consts::TAU;
use std::ops::Range;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use plotters::prelude::*;
use stylus_dsp::liveliness::kurtosis;
use stylus_dsp::spectrum::dft_amplitude;
use stylus_support::number::fixed;
use stylus_support::{Error, Result};

use super::canvas::{Area, Axis, BAR, Drawn, INK, TEXT, at, axes, centred, colour_bar, picture};
use super::colours::{between, hex};
use super::figure::{Bitmap, FREQUENCY, POWER_DENSITY, Panel, Series, TIME_S};
use super::{Caption, Svg};

/// Length of a window on a steady signal, s. It resolves lines 12 Hz apart.
const LONG_S: f64 = 0.16;

/// Length of a window on an impulsive signal, s. It resolves lines 60 Hz apart, and clicks 16 ms apart.
const SHORT_S: f64 = 0.032;

/// Kurtosis above which a recording is impulsive. Gaussian noise has 3, and 5.8 if its level swings between zero and
/// twice its mean.
const IMPULSIVE: f64 = 7.0;

/// Largest number of windows in a picture.
const COLUMNS: usize = 240;

/// Range of levels shown below the highest, dB.
const RANGE_DB: f64 = 60.0;

/// Returns the top of a scale that shows all finite `levels`, rounded up to a multiple of 10 dB; `None` without levels.
fn top_of(levels: impl Iterator<Item = f64>) -> Option<f64> {
    let highest = levels.filter(|level| level.is_finite()).reduce(f64::max);
    highest.map(|highest| 10.0 * (highest / 10.0).ceil())
}

/// Draws spectrograms of a recording and of its synthesis, m/s², from 0 Hz to `highest_hz`, on one scale. The
/// recording's kurtosis decides the length of the windows of both signals.
pub fn spectrograms(
    caption: &Caption<'_>,
    (recorded, synthesised): (&[f64], &[f64]),
    rate_hz: f64,
    highest_hz: f64,
) -> Result<Svg> {
    // The same duration of both, so that they have one axis of time.
    let len = recorded.len().min(synthesised.len());
    let highest_hz = highest_hz.min(0.5 * rate_hz);
    let signals = [("recorded", recorded), ("synthesised", synthesised)];
    let windows = Windows::of(len, rate_hz, window_s(&recorded[..len]));
    let levels = signals.map(|(_, signal)| levels_db(&signal[..len], windows, highest_hz));
    let Some(top_db) = top_of(levels.iter().flatten().flatten().copied()) else {
        return Err(Error::Request(format!(
            "the spectrogram '{}' is of silence",
            caption.title
        )));
    };
    picture(caption, (960, 640), |area| {
        let mut panels = Vec::new();
        let (panes, bar) = area.split_horizontally(at(960 - BAR));
        for ((half, levels), (name, _)) in panes.split_evenly((2, 1)).iter().zip(&levels).zip(signals) {
            let (heading, below) = half.split_vertically(at(22));
            let middle = (heading.dim_in_pixel().0 as i32 / 2, at(12));
            heading.draw_text(name, &centred(TEXT, INK), middle)?;
            let x = Axis::new(TIME_S, windows.shown_s(), 6);
            let y = Axis::new(FREQUENCY, 0.0..highest_hz, 8);
            let mut own = axes(&below, name, &x, &y)?.panel;
            fill(&mut own, levels, top_db, windows)?;
            panels.push(own);
        }
        let ends = (at(30), bar.dim_in_pixel().1 as i32 - at(52));
        draw_bar(&bar, ends, top_db)?;
        Ok(panels)
    })
}

/// Returns the length of the windows on a `recording` and on its synthesis, s.
fn window_s(recording: &[f64]) -> f64 {
    match kurtosis(recording.iter()) {
        Some(kurtosis) if kurtosis > IMPULSIVE => SHORT_S,
        _ => LONG_S,
    }
}

/// The windows of a spectrogram.
#[derive(Clone, Copy)]
struct Windows {
    /// Length of a window, samples.
    len: usize,
    /// Samples from the beginning of the first window to that of the last.
    spare: usize,
    /// Number of windows.
    count: usize,
    rate_hz: f64,
}

impl Windows {
    /// Creates the windows of `window_s` over a signal of `samples` samples.
    fn of(samples: usize, rate_hz: f64, window_s: f64) -> Self {
        let len = ((window_s * rate_hz) as usize).clamp(2, samples.max(2));
        let spare = samples.saturating_sub(len);
        Self {
            len,
            spare,
            // Windows are a quarter of their length apart, so that a click is within an eighth of the middle of some
            // window, where the weight is at least 0.85. Over a long signal they are farther apart.
            count: (4 * spare / len + 1).min(COLUMNS),
            rate_hz,
        }
    }

    /// Returns the first sample of a window.
    fn begin(&self, window: usize) -> usize {
        // A step rounded to whole samples would leave the signal's end out.
        self.spare * window / (self.count - 1).max(1)
    }

    /// Returns the time at the middle of a window, s.
    fn middle_s(&self, window: usize) -> f64 {
        (self.begin(window) as f64 + 0.5 * self.len as f64) / self.rate_hz
    }

    /// Returns the range of times shown, s. Each window is drawn around its middle, half a step to each side.
    fn shown_s(&self) -> Range<f64> {
        let half_s = 0.5 * self.step_s();
        self.middle_s(0) - half_s..self.middle_s(self.count - 1) + half_s
    }

    /// Returns the frequency step from bin to bin, Hz.
    fn bin_hz(&self) -> f64 {
        self.rate_hz / self.len as f64
    }

    /// Returns the time step from window to window, s; for a single window, its length.
    fn step_s(&self) -> f64 {
        let (steps, samples) = if self.count > 1 {
            (self.count - 1, self.spare)
        } else {
            (1, self.len)
        };
        samples as f64 / steps as f64 / self.rate_hz
    }
}

/// Puts levels into a panel, as the bitmap that fills its frame.
fn fill(panel: &mut Panel, levels: &[Vec<f64>], top_db: f64, windows: Windows) -> Drawn {
    panel.series.push(Series::levels(POWER_DENSITY));
    panel.bitmap = Some(Bitmap {
        png: STANDARD.encode(png(levels, top_db)?),
        from: top_db - RANGE_DB,
        to: top_db,
        palette: palette().map(hex).collect::<String>().replace('#', ""),
        x: [windows.middle_s(0), windows.step_s()],
        y: [0.0, windows.bin_hz()],
    });
    Ok(())
}

/// All colours of the scale.
fn palette() -> impl Iterator<Item = RGBColor> {
    (0..=u8::MAX).map(|index| colour(f64::from(index) / f64::from(u8::MAX)))
}

/// Returns one column per window: the one-sided power spectral densities from the lowest frequency up, in dB re 1
/// (m/s²)²/Hz.
fn levels_db(signal: &[f64], windows: Windows, highest_hz: f64) -> Vec<Vec<f64>> {
    let Windows {
        len: window, rate_hz, ..
    } = windows;
    let weights: Vec<f64> = (0..window)
        .map(|n| 0.5 - 0.5 * (TAU * (n as f64 + 0.5) / window as f64).cos())
        .collect();
    let bins = (highest_hz * window as f64 / rate_hz) as usize + 1;
    let energy: f64 = weights.iter().map(|weight| weight * weight).sum();
    // One-sided, normalised by the sum of the squared weights: Heinzel, Rüdiger and Schilling (2002), equation 23.
    let scale_db = 10.0 * (2.0 / (rate_hz * energy)).log10();
    (0..windows.count)
        .map(|column| {
            let windowed: Vec<f64> = signal[windows.begin(column)..]
                .iter()
                .zip(&weights)
                .map(|(value, weight)| value * weight)
                .collect();
            dft_amplitude(&windowed)
                .iter()
                .take(bins)
                // Silence is minus infinity here, and gets the lowest colour.
                .map(|a| 20.0 * a.log10() + scale_db)
                .collect()
        })
        .collect()
}

/// Draws the bar that shows which level each colour of a spectrogram stands for.
fn draw_bar(area: &Area<'_>, ends: (i32, i32), top_db: f64) -> Drawn {
    let values = [0.0, 20.0, 40.0, 60.0].map(|below| (1.0 - below / RANGE_DB, fixed(top_db - below, 0)));
    colour_bar(area, ends, colour, &values, POWER_DENSITY)
}

/// Returns a colour of a scale whose lightness rises throughout, from dark blue through green to yellow.
fn colour(share: f64) -> RGBColor {
    const STOPS: [RGBColor; 5] = [
        RGBColor(20, 16, 60),
        RGBColor(60, 70, 140),
        RGBColor(30, 140, 140),
        RGBColor(110, 200, 90),
        RGBColor(250, 235, 60),
    ];
    between(&STOPS, share)
}

/// Encodes the panel as a PNG with a pixel per window and bin, in indices of the palette.
fn png(panel: &[Vec<f64>], top_db: f64) -> Drawn<Vec<u8>> {
    let (width, height) = (panel.len(), panel[0].len());
    let mut pixels = Vec::with_capacity(width * height);
    // A bitmap begins with its top row, the highest frequency.
    for bin in (0..height).rev() {
        for column in panel {
            let share = (column[bin] - top_db + RANGE_DB) / RANGE_DB;
            // NaN becomes zero.
            pixels.push((255.0 * share.clamp(0.0, 1.0)).round() as u8);
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    let palette = palette().flat_map(|RGBColor(r, g, b)| [r, g, b]);
    encoder.set_palette(palette.collect::<Vec<u8>>());
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::{near, noise};

    #[test]
    fn a_line_is_brightest_where_it_sounds() {
        let line: Vec<f64> = (0..10_000)
            .map(|n| (TAU * 300.0 * f64::from(n) / 5000.0).sin())
            .collect();
        let windows = Windows::of(line.len(), 5000.0, window_s(&line));
        for column in levels_db(&line, windows, 1000.0) {
            let peak = (0..column.len())
                .max_by(|a, b| column[*a].total_cmp(&column[*b]))
                .unwrap();
            near(peak as f64 / LONG_S, 300.0, 7.0);
        }
    }

    #[test]
    fn the_level_of_white_noise_is_its_power_over_the_band() {
        let noise: Vec<f64> = noise(7, 50_000).iter().map(|x| 3.0 * x).collect();
        let windows = Windows::of(noise.len(), 5000.0, window_s(&noise));
        let levels = levels_db(&noise, windows, 2000.0);
        let powers = || {
            levels
                .iter()
                .flat_map(|column| &column[5..])
                .map(|level| 10f64.powf(level / 10.0))
        };
        let mean = powers().sum::<f64>() / powers().count() as f64;
        // 9 (m/s²)² spread over 2500 Hz.
        near(mean / (9.0 / 2500.0), 1.0, 0.05);
    }

    /// Clicks of 2 ms, ten per second, in noise 40 dB below them; and noise whose level swings four times per second.
    #[test]
    fn a_click_is_as_short_as_a_short_window_and_a_swell_keeps_the_long_one() {
        let noise = noise(3, 10_000);
        let swell = |n: usize| 1.0 + (TAU * 4.0 * n as f64 / 5000.0).sin();
        let swelling: Vec<f64> = noise.iter().enumerate().map(|(n, x)| swell(n) * x).collect();
        assert!([&noise, &swelling].iter().all(|signal| window_s(signal) == LONG_S));
        let gain = |n: usize| if n % 500 < 10 { 1.0 } else { 0.01 };
        let clicks: Vec<f64> = noise.iter().enumerate().map(|(n, x)| gain(n) * x).collect();
        let windows = Windows::of(clicks.len(), 5000.0, window_s(&clicks));
        let levels = levels_db(&clicks, windows, 1000.0);
        let middle: Vec<f64> = levels.iter().map(|column| column[10]).collect();
        let highest = middle.iter().copied().fold(f64::MIN, f64::max);
        let loud = middle.iter().filter(|level| **level > highest - 25.0).count();
        assert!(3 * loud < middle.len(), "{loud} of {}", middle.len());
    }

    #[test]
    fn silence_is_refused_and_next_to_nothing_is_drawn() {
        let caption = Caption::new("test", true);
        let draw = |signal: &[f64]| spectrograms(&caption, (signal, signal), 5000.0, 1000.0);
        assert!(draw(&[0.0; 900]).is_err() && draw(&[]).is_err());
        assert!(draw(&[1.0, -1.0, 0.5]).is_ok());
    }
}
