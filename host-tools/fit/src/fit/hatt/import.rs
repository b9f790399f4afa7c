//! Many files of models as one library.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use model_format::{PlayRate, SAMPLE_RATE_HZ, TextureSpec, limits};
use rayon::prelude::*;
use serde::Serialize;
use stylus_support::bounded_file::Format;
use stylus_support::{Error, Result};

use super::axes::{Bounds, Candidates};
use super::convert::{Converted, ConvertedNode, PlaceError, convert};
use super::read::read;
use super::toolkit::Toolkit;
use crate::fit::encoded;
use crate::fit::options::play_rate;

/// Upper bounds of the bytes of a library without its textures, and of a texture without its name, axes and nodes.
const LIBRARY_BYTES: usize = 32;
const TEXTURE_BYTES: usize = 48;

/// Prefix of the names of HaTT's files.
const FILE_PREFIX: &str = "Models_";

/// A file that was read.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file.
    pub path: PathBuf,
    /// Name of the file's texture.
    pub name: String,
    /// Models of the file.
    pub toolkit: Toolkit,
}

/// Sizes of the grids that are asked for.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Options {
    /// Most speeds of a grid [default: as many as it needs and the slot has room for]
    #[arg(long)]
    pub speeds: Option<usize>,
    /// Most forces of a grid [default: as many as it needs and the slot has room for]
    #[arg(long)]
    pub forces: Option<usize>,
    /// Sample rate of the textures, Hz: 5000, or 10000 from models of that rate
    #[arg(id = "model_rate_hz", long = "model-rate", value_name = "HZ", default_value_t = SAMPLE_RATE_HZ)]
    pub sample_rate_hz: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            speeds: None,
            forces: None,
            sample_rate_hz: SAMPLE_RATE_HZ,
        }
    }
}

/// Lists the files of `paths`. A folder is replaced by all XML files in it, sorted by name.
///
/// # Errors
/// A file or folder that does not exist or cannot be read; a folder without XML files; the same file twice; more files
/// than a library can hold textures.
pub fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let mut found = Vec::new();
        for entry in std::fs::read_dir(path).map_err(Error::io("read", path))? {
            let file = entry.map_err(Error::io("read", path))?.path();
            if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml")) && file.is_file() {
                found.push(file);
            }
        }
        if found.is_empty() {
            return Err(Error::file(
                path,
                "has no XML file; give HaTT's model files or a folder of them",
            ));
        }
        // The order of a folder's entries depends on the file system; that of a library must not.
        found.sort();
        files.extend(found);
    }
    let mut seen: HashMap<PathBuf, &Path> = HashMap::new();
    for file in &files {
        // By real paths, so that a link to a file counts as that file.
        let whole = file.canonicalize().map_err(Error::io("read", file))?;
        if let Some(first) = seen.insert(whole, file) {
            let problem = format!("is given twice, first as {}", first.display());
            return Err(Error::file(file, problem));
        }
    }
    if files.len() > limits::MAX_TEXTURES {
        return Err(Error::Request(format!(
            "{} files are {} more than the {} textures that a library can hold: make several libraries",
            files.len(),
            files.len() - limits::MAX_TEXTURES,
            limits::MAX_TEXTURES
        )));
    }
    Ok(files)
}

/// Reads all `files`, to be played at the sample rate in `options`.
///
/// # Errors
/// A rate that the stylus does not play; the first file that cannot be used, with the number of such files; two files
/// whose textures would have the same name.
pub fn read_all(files: &[PathBuf], options: &Options) -> Result<Vec<Source>> {
    let rate = play_rate(options.sample_rate_hz)?;
    let read = files.par_iter().map(|path| source(path, rate));
    // All files are read before one is refused, so that the error can say how many there are.
    let mut sources = Vec::new();
    let mut refused = Vec::new();
    for source in read.collect::<Vec<_>>() {
        match source {
            Ok(source) => sources.push(source),
            Err(error) => refused.push(error),
        }
    }
    match refused.len() {
        0 => {}
        1 => return Err(refused.swap_remove(0)),
        count => {
            return Err(Error::Request(format!(
                "{count} of {} files cannot be used; the first is {}",
                files.len(),
                refused[0]
            )));
        }
    }
    let mut names: HashMap<&str, &Path> = HashMap::new();
    for source in &sources {
        if let Some(first) = names.insert(&source.name, &source.path) {
            let problem = format!(
                "would be a second texture '{}', beside that of {}: rename one of the files",
                source.name,
                first.display()
            );
            return Err(Error::file(&source.path, problem));
        }
    }
    Ok(sources)
}

fn source(path: &Path, rate: PlayRate) -> Result<Source> {
    let text = Format::Hatt.read_text(path)?;
    let toolkit = Toolkit {
        play_rate: rate,
        ..read(path, &text)?
    };
    // Whoever asks for a higher rate expects content up to half of it. Here a part of that would be roll-off alone.
    if rate != PlayRate::default() && toolkit.highest_hz() < 0.5 * toolkit.play_rate_hz() {
        let problem = format!(
            "has models of {} Hz, which say nothing above half of it: leave out --model-rate",
            toolkit.sample_rate_hz
        );
        return Err(Error::file(path, problem));
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = stem.strip_prefix(FILE_PREFIX).unwrap_or(&stem).to_owned();
    if name.is_empty() || name.len() > limits::MAX_NAME_BYTES {
        let most = limits::MAX_NAME_BYTES;
        let problem = format!(
            "makes a texture's name of {} bytes, where 1 to {most} can be: rename it",
            name.len()
        );
        return Err(Error::file(path, problem));
    }
    Ok(Source {
        path: path.to_owned(),
        name,
        toolkit,
    })
}

/// Decides how many bytes the grid of every texture may take. The slot is shared in proportion to the numbers of
/// different speeds and forces in the files.
pub fn plan(sources: &[Source], options: &Options) -> Result<Vec<Bounds>> {
    for (what, count) in [("speeds", options.speeds), ("forces", options.forces)] {
        if count.is_some_and(|count| !(1..=limits::MAX_AXIS_LEN).contains(&count)) {
            let most = limits::MAX_AXIS_LEN;
            return Err(Error::Request(format!("--{what} can be 1 to {most}")));
        }
    }
    let names: usize = sources.iter().map(|source| source.name.len()).sum();
    let fixed = LIBRARY_BYTES + TEXTURE_BYTES * sources.len() + names;
    let room = limits::MAX_LIBRARY_BYTES.saturating_sub(fixed);
    let own = sources.iter().map(|source| Candidates::of(&source.toolkit).own());
    let own: Vec<usize> = own.collect();
    let all: usize = own.iter().sum();
    let bounds = own.into_iter().map(|own| Bounds {
        speeds: options.speeds.unwrap_or(limits::MAX_AXIS_LEN),
        forces: options.forces.unwrap_or(limits::MAX_AXIS_LEN),
        bytes: room * own / all.max(1),
    });
    Ok(bounds.collect())
}

/// The report on one texture.
#[derive(Clone, Debug, Serialize)]
pub struct ImportReport {
    /// Name of the texture.
    pub texture: String,
    /// Notes on the texture's file.
    pub warnings: Vec<String>,
    /// Values of the speed axis, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// Values of the force axis, N.
    pub forces_n: Vec<f32>,
    /// Nodes of the texture.
    pub nodes: Vec<ConvertedNode>,
    /// Errors at the models' own positions.
    pub own_places: Vec<PlaceError>,
    /// Errors between the models.
    pub between: Vec<PlaceError>,
}

impl ImportReport {
    /// Returns the report on the texture that was `converted` from `source`.
    pub fn of((source, converted): (Source, Converted)) -> Self {
        Self {
            texture: source.name,
            warnings: source.toolkit.warnings,
            speeds_mm_s: converted.spec.speed_axis_mm_s,
            forces_n: converted.spec.force_axis_n,
            nodes: converted.nodes,
            own_places: converted.own,
            between: converted.between,
        }
    }
}

/// Converts all `sources` within their `bounds`, and calls `progress` after each file.
///
/// # Errors
/// A model that the library cannot hold, with its file; textures that a library cannot hold.
pub fn import(
    sources: &[Source],
    bounds: &[Bounds],
    progress: &(impl Fn() + Sync),
) -> Result<(Vec<Converted>, Vec<u8>)> {
    let converted: Vec<Converted> = sources
        .par_iter()
        .zip(bounds)
        .map(|(source, bounds)| {
            let converted = convert(&source.name, &source.toolkit, *bounds)
                .map_err(|failure| Error::file(&source.path, failure.to_string()));
            progress();
            converted
        })
        .collect::<Result<_>>()?;
    let specs: Vec<TextureSpec> = converted.iter().map(|texture| texture.spec.clone()).collect();
    let bytes = encoded(&specs)?;
    Ok((converted, bytes))
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    fn sources(count: usize, text: &str) -> Vec<Source> {
        let path = Path::new("felt.xml");
        let source = Source {
            path: path.to_owned(),
            name: "felt".into(),
            toolkit: read(path, text).unwrap(),
        };
        vec![source; count]
    }

    #[test]
    fn grids_are_made_to_fit_the_slot_before_the_work() {
        let sources = sources(8, &fixture::scattered(62));
        let asked = Options {
            speeds: Some(62),
            forces: Some(62),
            ..Options::default()
        };
        for options in [asked, Options::default()] {
            let plan = plan(&sources, &options).unwrap();
            let bytes: usize = plan.iter().map(|bounds| bounds.bytes).sum();
            assert!(bytes < limits::MAX_LIBRARY_BYTES && bytes > limits::MAX_LIBRARY_BYTES * 9 / 10);
        }
        let speeds = Some(65);
        assert!(plan(&sources, &Options { speeds, ..asked }).is_err());
    }
}
