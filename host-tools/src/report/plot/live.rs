//! Pictures of the page to rub: axes whose curves a script draws while it plays, and maps under a point that moves.
//!
//! They are narrow, so that three stand beside each other under the patch, and one fits a page 420 pixels wide without
//! being scaled down.

use super::canvas::{ACCELERATION, Axis, FREQUENCY, POWER_DENSITY, TIME_MS, Ticks, axes, picture};
use super::grid::{GridMap, grid_map_of_width};
use super::{Caption, Svg};
use crate::support::error::Result;

/// Their width, shown pixels.
const WIDTH: u32 = 388;

/// Height of axes, shown pixels.
const HEIGHT: u32 = 280;

/// Time that the waveform spans, ms.
const SPAN_MS: f64 = 100.0;

/// Octaves that are written along a spectrum, Hz.
const OCTAVES_HZ: [&str; 6] = ["31.5", "63", "125", "250", "500", "1000"];

/// The first of them, exactly.
const FIRST_OCTAVE_HZ: f64 = 1000.0 / 32.0;

/// The ends of a spectrum, Hz, as octaves from the first one of [`OCTAVES_HZ`]: from 20 Hz to 1 kHz and a little room.
const SPECTRUM_OCTAVES: (f64, f64) = (-0.65, 5.05);

/// Empty axes for the last 100 ms of an acceleration within `peak_m_s2`.
///
/// # Errors
/// A peak that is not positive and finite makes axes that cannot be laid out.
pub fn waveform_axes(caption: &Caption<'_>, peak_m_s2: f64) -> Result<Svg> {
    let y = Axis {
        range: -peak_m_s2..peak_m_s2,
        quantity: ACCELERATION,
        ticks: Ticks::Numbers(7),
    };
    let x = Axis {
        range: -SPAN_MS..0.0,
        quantity: TIME_MS,
        ticks: Ticks::Numbers(6),
    };
    picture(caption, (WIDTH, HEIGHT), |area, panels| {
        panels.push(axes(area, "", &x, &y)?.panel);
        Ok(())
    })
}

/// Empty axes for the density of power from 20 Hz to 1 kHz, over octaves, between two levels in dB re 1 (m/s²)²/Hz.
///
/// # Errors
/// Levels that are not finite and ascending make axes that cannot be laid out.
pub fn spectrum_axes(caption: &Caption<'_>, (lowest_db, highest_db): (f64, f64)) -> Result<Svg> {
    let y = Axis {
        range: lowest_db..highest_db,
        quantity: POWER_DENSITY,
        ticks: Ticks::Numbers(9),
    };
    let x = Axis {
        range: SPECTRUM_OCTAVES.0..SPECTRUM_OCTAVES.1,
        quantity: FREQUENCY,
        ticks: Ticks::Octaves {
            lowest: FIRST_OCTAVE_HZ.log2(),
            names: &OCTAVES_HZ,
        },
    };
    picture(caption, (WIDTH, HEIGHT), |area, panels| {
        panels.push(axes(area, "", &x, &y)?.panel);
        Ok(())
    })
}

/// A map over a grid.
///
/// # Errors
/// As [`grid_map`](super::grid_map).
pub fn live_map(caption: &Caption<'_>, map: &GridMap<'_>) -> Result<Svg> {
    grid_map_of_width(caption, map, WIDTH)
}
