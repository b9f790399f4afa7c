//! Library entries from a texture's grid.

use std::path::Path;

use model_format::{Library, NodeSpec, Provenance, SAMPLE_RATE_HZ, Texture, TextureSpec, encode};
use stylus_support::bounded_file::Format;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::grid::Grid;
use super::{quantise, theta};

/// Returns the library's entry for texture `name` at `sample_rate_hz`: the stored `nodes` of `grid`, and its parts.
pub(crate) fn spec_of(
    name: &str,
    sample_rate_hz: u32,
    provenance: Provenance,
    grid: &Grid,
    nodes: Vec<NodeSpec>,
) -> TextureSpec {
    TextureSpec {
        name: name.to_owned(),
        sample_rate_hz,
        provenance,
        laws: grid.laws,
        parts: grid.parts.clone(),
        speed_axis_mm_s: grid.speeds_mm_s.clone(),
        force_axis_n: grid.forces_n.clone(),
        nodes,
    }
}

/// Returns the library's entry for texture `name`, with the nodes of `grid` quantised.
pub fn texture_spec(name: &str, provenance: Provenance, grid: &Grid) -> Result<TextureSpec> {
    let nodes = quantise::nodes(name, grid)?;
    Ok(spec_of(name, SAMPLE_RATE_HZ, provenance, grid, nodes))
}

/// Returns the stored nodes of `grid`, whose models are at `sample_rate_hz`. θ takes the fewest bytes that preserve
/// every node's spectrum.
pub(crate) fn stored_nodes(name: &str, grid: &Grid, sample_rate_hz: u32) -> Result<Vec<NodeSpec>> {
    Ok(theta::store(grid, quantise::nodes(name, grid)?, sample_rate_hz))
}

/// Returns the bytes of a library with one texture, to judge a model. They never go to a file.
pub fn library_of(name: &str, grid: &Grid) -> Result<Vec<u8>> {
    // The bytes are not kept, so the weakest claim of provenance is enough.
    let spec = texture_spec(name, Provenance::Simulated, grid)?;
    encode(&[spec]).map_err(|failure| Error::Model(failure.to_string()))
}

/// Decodes the bytes of a library that was made in this run.
///
/// # Errors
/// Bytes that are not a valid library. [`encode`] makes none.
pub fn decoded(bytes: &[u8]) -> Result<Library<'_>> {
    Library::decode(bytes).map_err(|failure| Error::Model(failure.to_string()))
}

/// Returns in words that the level of some of `textures` is not known, if it is so.
pub fn unknown_levels<'a>(textures: impl IntoIterator<Item = Texture<'a>>) -> Option<String> {
    let names: Vec<&str> = textures
        .into_iter()
        .filter(|own| own.provenance() == Provenance::Unscaled)
        .map(|own| own.name())
        .collect();
    let which = match names[..] {
        [] => return None,
        [_] | [_, _] | [_, _, _] => names.join(", "),
        _ => counted(names.len(), "texture"),
    };
    Some(format!(
        "level of {which} is not known, because nothing stated the unit of its recordings: to know it, fit them \
         with --scale"
    ))
}

/// Reads a library's bytes.
pub fn read_library(path: &Path) -> Result<Vec<u8>> {
    Format::Library.read(path)
}

/// Decodes a library; `path` is only named in errors.
pub fn decode_library<'a>(path: &Path, bytes: &'a [u8]) -> Result<Library<'a>> {
    Library::decode(bytes).map_err(|source| Error::Library {
        path: path.to_owned(),
        source,
    })
}
