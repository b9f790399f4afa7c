//! Axes of the page to rub, whose curves a script draws while it plays.

use std::ops::Range;

use super::canvas::{Axis, axes, picture};
use super::figure::{ACCELERATION, FREQUENCY, POWER_DENSITY, TIME_MS};
use super::{Caption, Svg};
use crate::support::error::Result;

/// Width of the page's pictures, shown pixels: three stand beside each other under the patch, and one fits a page 420
/// pixels wide without being scaled down.
pub const NARROW: u32 = 388;

/// Height of axes, shown pixels.
const HEIGHT: u32 = 280;

/// Octaves that are written along a spectrum, Hz.
const OCTAVES_HZ: [&str; 6] = ["31.5", "63", "125", "250", "500", "1000"];

/// The first of them, exactly.
const FIRST_OCTAVE_HZ: f64 = 1000.0 / 32.0;

/// Empty axes for the last 100 ms of an acceleration within `peak_m_s2`.
///
/// # Errors
/// A peak that is not positive and finite makes axes that cannot be laid out.
pub fn waveform_axes(caption: &Caption<'_>, peak_m_s2: f64) -> Result<Svg> {
    let x = Axis::new(TIME_MS, -100.0..0.0, 6);
    empty(
        caption,
        &x,
        &Axis::new(ACCELERATION, -peak_m_s2..peak_m_s2, 7),
    )
}

/// Empty axes for the density of power from 20 Hz to 1 kHz, over octaves, between two levels in dB re 1 (m/s²)²/Hz.
///
/// # Errors
/// Levels that are not finite and ascending make axes that cannot be laid out.
pub fn spectrum_axes(caption: &Caption<'_>, levels_db: Range<f64>) -> Result<Svg> {
    let lowest = FIRST_OCTAVE_HZ.log2();
    // From 20 Hz to 1 kHz and a little room.
    let x = Axis::of_octaves(FREQUENCY, -0.65..5.05, lowest, &OCTAVES_HZ);
    empty(caption, &x, &Axis::new(POWER_DENSITY, levels_db, 9))
}

fn empty(caption: &Caption<'_>, x: &Axis<'_>, y: &Axis<'_>) -> Result<Svg> {
    picture(caption, (NARROW, HEIGHT), |area, panels| {
        panels.push(axes(area, "", x, y)?.panel);
        Ok(())
    })
}
