//! Pictures for reports, as SVG. Making them needs no font and no display; spectrograms embed PNG images.
//!
//! Invariant: axes have a quantity and a unit, maps a bar of their colours, colours differ for any colour vision and on
//! light and dark screens, no label covers another, curves are thinned to the picture's width so that a picture stays
//! small whatever the length of a recording, and a picture of simulated data says SIMULATED.

mod canvas;
pub(super) mod colours;
mod curves;
pub mod figure;
mod grid;
#[cfg(test)]
pub(super) mod properties;
mod responses;
mod spectrogram;
mod waveforms;

use std::path::Path;

use crate::support::atomic_file;
use crate::support::error::Result;

pub use curves::{
    FrontPoint, FrontSeries, NARROW, front_chart, spectra, spectrum_axes, waveform_axes,
};
pub use figure::{COST, Panel, Quantity};
pub use grid::{GridCell, GridMap, Scale, WIDE, grid_map, map_axes};
pub use responses::{Curve, responses};
pub use spectrogram::spectrograms;
pub use waveforms::waveforms;

/// The heading of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caption<'a> {
    /// Title of the picture.
    pub title: &'a str,
    /// True if anything in it comes from the rig simulator; the picture then says so in its corner.
    pub simulated: bool,
}

impl<'a> Caption<'a> {
    /// A heading, which says SIMULATED if anything in the picture comes from the rig simulator.
    pub const fn new(title: &'a str, simulated: bool) -> Self {
        Self { title, simulated }
    }
}

/// A picture: one `<svg>` element, which is a file of its own as well as a part of a page, and the data that it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Svg {
    text: String,
    panels: Vec<Panel>,
}

impl Svg {
    /// The element's text.
    pub fn as_str(&self) -> &str {
        &self.text
    }

    /// The data of the picture: pairs of axes, in the order in which they were drawn.
    pub fn panels(&self) -> &[Panel] {
        &self.panels
    }

    /// Writes the picture into a file, whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic_file::write(path, self.text.as_bytes())
    }
}
