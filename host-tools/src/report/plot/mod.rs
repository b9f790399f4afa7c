//! Pictures for reports, as SVG. Making them needs no font and no display; spectrograms embed PNG images.
//!
//! Invariant: axes have units, colours differ for any colour vision, curves are thinned to the picture's width so that
//! a picture stays small whatever the length of a recording, and a picture of simulated data says SIMULATED.

mod bands;
mod canvas;
mod certificate;
mod frontier;
mod grid;
mod orders;
#[cfg(feature = "spectrograms")]
mod paper;
#[cfg(feature = "spectrograms")]
mod scene;
mod spectra;
#[cfg(feature = "spectrograms")]
mod spectrogram;
mod waveforms;

use std::path::Path;

use crate::support::atomic_file;
use crate::support::error::Result;

pub use bands::band_error_chart;
pub use certificate::certificate_map;
pub use frontier::{FrontPoint, FrontSeries, Quantity, front_chart};
pub use grid::{GridCell, GridMap, grid_map};
pub use orders::{OrderSeries, order_against_cost};
#[cfg(feature = "spectrograms")]
pub use paper::{forward_prediction, grid_and_motion};
#[cfg(feature = "spectrograms")]
pub use scene::{SceneRegion, SceneView, scene};
pub use spectra::{SpectraView, time_and_frequency};
#[cfg(feature = "spectrograms")]
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

/// A picture: one `<svg>` element, which is a file of its own as well as a part of a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Svg(String);

impl Svg {
    /// The element's text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The picture with `elements` over it: what plotters does not draw into an SVG, such as bitmaps.
    #[cfg(feature = "spectrograms")]
    fn with(&self, elements: &str) -> Self {
        let text = self.as_str();
        let (before, after) = text.split_at(text.rfind("</svg>").unwrap_or(text.len()));
        Self(format!("{before}{elements}{after}"))
    }

    /// Writes the picture into a file, whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic_file::write(path, self.0.as_bytes())
    }
}
