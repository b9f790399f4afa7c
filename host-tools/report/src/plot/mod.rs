//! Pictures for reports, as SVG. Making them needs no font and no display; spectrograms embed PNG images.
//!
//! Invariant: every axis has a quantity and a unit, and every map a bar of its colours. Colours differ for any colour
//! vision and on light and dark screens. No label covers another. Curves are thinned to the picture's width, so that a
//! picture stays small whatever the length of a recording. A picture of simulated data says SIMULATED.

mod canvas;
mod curves;
mod figure;
mod grid;
#[cfg(test)]
pub(super) mod properties;
mod responses;
mod spectrogram;
mod waveforms;

use std::path::Path;

use stylus_pages::colours;
use stylus_support::Result;
use stylus_support::atomic_file;

pub(crate) use curves::{FrontPoint, FrontSeries, front_chart, spectra, spectrum_axes, waveform_axes};
pub use figure::Panel;
pub(crate) use figure::{COST, Quantity};
pub(crate) use grid::{GridCell, GridMap, Scale, WIDE, grid_map, map_axes};
pub use responses::{Curve, densities, responses};
pub(crate) use spectrogram::spectrograms;
pub(crate) use waveforms::waveforms;

/// The heading of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caption<'a> {
    /// Title of the picture.
    pub title: &'a str,
    /// True if any of its data comes from the rig simulator; the picture then says so in its corner.
    pub simulated: bool,
}

impl<'a> Caption<'a> {
    /// Creates a heading. It says SIMULATED if any of the picture's data comes from the rig simulator.
    pub const fn new(title: &'a str, simulated: bool) -> Self {
        Self { title, simulated }
    }
}

/// A picture: one `<svg>` element, which can be a file or part of a page, and the data that it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Svg {
    text: String,
    panels: Vec<Panel>,
}

impl Svg {
    /// Returns the element's text.
    pub fn as_str(&self) -> &str {
        &self.text
    }

    /// Returns the data of the picture: its pairs of axes, in the order in which they were drawn.
    pub fn panels(&self) -> &[Panel] {
        &self.panels
    }

    /// Writes the picture into a file. The file is written completely or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic_file::write(path, self.text.as_bytes())
    }
}
