//! Part of kind 5: lines that are locked to place.

use alloc::vec::Vec;

/// Lines of a texture: sines over the place on the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct LinesSpec {
    /// The lines.
    pub lines: Vec<LineSpec>,
}

/// A line, whose value at the place x is amplitude · sin(2π (x / wavelength + phase)).
#[derive(Clone, Debug, PartialEq)]
pub struct LineSpec {
    /// Wavelength, mm.
    pub wavelength_mm: f32,
    /// Phase at the origin of places, in steps of 2⁻¹⁶ of a turn.
    pub phase: u16,
    /// Amplitude at each node, m/s², speed-major: the peak of the sine.
    pub amplitudes: Vec<f32>,
}
