//! The data of the page's pictures as files: the maps, and the spectra that stand beside each other at a node.

use std::path::Path;

use super::data::{Data, TextureData};
use super::pictures::{maps, spectrum};
use crate::report::figures::Folder;
use crate::report::plot::Figure;
use crate::report::plot::colours::{BLUE, VERMILION};
use crate::report::plot::figure::{Kind, Series};
use crate::support::error::Result;
use crate::support::file_name::Stems;

/// Writes the data of the page's pictures into `folder`.
///
/// # Errors
/// A file that cannot be written.
pub fn write(data: &Data, folder: &Path) -> Result<()> {
    let mut files = Folder::new(folder)?;
    let mut stems = Stems::default();
    for (texture, map) in data.textures.iter().zip(maps(data)?) {
        let stem = stems.of(&texture.name).clone();
        files.add(&format!("{stem}-map"), &map)?;
        files.add_figure(&format!("{stem}-spectra"), &spectra(data, texture)?)?;
    }
    files.finish()
}

/// The spectra of all nodes of a texture, of the recordings and of the models, in the steps that the page keeps.
fn spectra(data: &Data, texture: &TextureData) -> Result<Figure> {
    let mut figure = spectrum(data)?.figure().clone();
    figure.title = format!("Spectra of {}", texture.name);
    let Some(panel) = figure.panels.first_mut() else {
        return Ok(figure);
    };
    for (what, colour, levels) in [
        ("recorded", BLUE, texture.recorded_db()),
        ("model", VERMILION, texture.model_db()),
    ] {
        for (node, levels) in texture.nodes.iter().zip(levels) {
            let points = data.frequencies_hz.iter().copied().zip(levels);
            let points: Vec<(f64, f64)> = points.collect();
            let name = format!("{what}, {} mm/s, {} N", node.speed_mm_s, node.force_n);
            panel
                .series
                .push(Series::new(&name, Kind::Line, colour, &points));
        }
    }
    Ok(figure)
}
