//! Many files of models as one library.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use model_format::{TextureSpec, encode, limits};
use rayon::prelude::*;
use serde::Serialize;

use super::axes::{Bounds, Candidates, node_bytes};
use super::between;
use super::comparison::PlaceError;
use super::convert::{Converted, ConvertedNode, convert};
use super::elements::MODEL_FILE;
use super::read::read;
use super::toolkit::Toolkit;
use crate::support::error::{Error, Result};

/// Bytes of a library without its textures, and of a texture without its name, axes and nodes; not fewer than these.
const LIBRARY_BYTES: usize = 32;
const TEXTURE_BYTES: usize = 48;

/// Prefix of the names of HaTT's files.
const FILE_PREFIX: &str = "Models_";

/// A file that was read.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file.
    pub path: PathBuf,
    /// Name of its texture.
    pub name: String,
    /// Its models.
    pub toolkit: Toolkit,
}

/// Sizes of the grids that are asked for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Most speeds of a grid; as many as the slot has room for if none.
    pub speeds: Option<usize>,
    /// Most forces of a grid; as many as the slot has room for if none.
    pub forces: Option<usize>,
}

/// Bounds of every texture, and what they will take.
#[derive(Clone, Debug)]
pub struct Plan {
    bounds: Vec<Bounds>,
    /// Bytes of a library whose grids hold all speeds and forces, or as many as were asked for. An estimate.
    pub wanted_bytes: usize,
    /// Bytes of the library as it is planned. An estimate.
    pub planned_bytes: usize,
}

/// Lists the files of `paths`: folders stand for all XML files in them, by name.
///
/// # Errors
/// A folder without XML files; the same file twice; more files than a library can hold textures.
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
            if file
                .extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("xml"))
                && file.is_file()
            {
                found.push(file);
            }
        }
        if found.is_empty() {
            return Err(Error::file(
                path,
                "has no XML file; give HaTT's model files or a folder of them",
            ));
        }
        found.sort();
        files.extend(found);
    }
    let mut seen: HashMap<PathBuf, &Path> = HashMap::new();
    for file in &files {
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

/// Reads all `files`.
///
/// # Errors
/// The first file that cannot be used; two files whose textures would have one name.
pub fn read_all(files: &[PathBuf]) -> Result<Vec<Source>> {
    let sources = files.par_iter().map(|path| source(path));
    let sources = sources.collect::<Result<Vec<Source>>>()?;
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

fn source(path: &Path) -> Result<Source> {
    let text = MODEL_FILE.read_text(path)?;
    let toolkit = read(path, &text)?;
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

/// Bytes that one texture would take, and its bounds.
struct Need {
    /// Bytes of its grid as it is wanted.
    bytes: f64,
    /// Number of the models' own places, by which the slot is shared.
    places: f64,
    bounds: Bounds,
}

/// Decides what every texture may take, before any of the work is done.
///
/// The slot is shared in proportion to the files' numbers of different speeds and
/// forces; what a texture does not need goes to the others.
///
/// # Errors
/// Sizes that no grid can have.
pub fn plan(sources: &[Source], options: &Options) -> Result<Plan> {
    for (what, count) in [("speeds", options.speeds), ("forces", options.forces)] {
        if count.is_some_and(|count| !(1..=limits::MAX_AXIS_LEN).contains(&count)) {
            let most = limits::MAX_AXIS_LEN;
            return Err(Error::Request(format!("--{what} can be 1 to {most}")));
        }
    }
    let needs: Vec<Need> = sources
        .par_iter()
        .map(|source| need(source, options))
        .collect();
    let fixed = LIBRARY_BYTES
        + sources
            .iter()
            .map(|source| TEXTURE_BYTES + source.name.len())
            .sum::<usize>();
    let room = limits::MAX_LIBRARY_BYTES.saturating_sub(fixed) as f64;
    let wanted_bytes = fixed + needs.iter().map(|need| need.bytes).sum::<f64>() as usize;
    let shares = shares(&needs, room);
    let planned = needs
        .iter()
        .zip(&shares)
        .map(|(need, share)| need.bytes.min(*share))
        .sum::<f64>();
    let bounds = needs.iter().zip(&shares).map(|(need, share)| Bounds {
        bytes: *share as usize,
        ..need.bounds
    });
    Ok(Plan {
        bounds: bounds.collect(),
        wanted_bytes,
        planned_bytes: fixed + planned as usize,
    })
}

fn need(source: &Source, options: &Options) -> Need {
    let candidates = Candidates::of(&source.toolkit);
    let speeds = candidates
        .speeds_mm_s
        .len()
        .min(options.speeds.unwrap_or(usize::MAX));
    let forces = candidates
        .forces_n
        .len()
        .min(options.forces.unwrap_or(usize::MAX));
    let sounding = source.toolkit.models.iter().filter(|model| model.sounds());
    let sizes: Vec<usize> = sounding
        .map(|model| {
            node_bytes(&between::model(
                &source.toolkit,
                (model.speed_mm_s, model.force_n),
            ))
        })
        .collect();
    let mean = sizes.iter().sum::<usize>() as f64 / sizes.len().max(1) as f64;
    Need {
        bytes: mean * (speeds * forces) as f64 + (size_of::<f32>() * (speeds + forces)) as f64,
        places: (candidates.speeds_mm_s.len() + candidates.forces_n.len()) as f64,
        bounds: Bounds {
            speeds,
            forces,
            bytes: usize::MAX,
        },
    }
}

/// Shares of `room` bytes in proportion to the numbers of places. A texture that needs less has a little more than
/// that, because needs are estimates, and the others share the rest.
fn shares(needs: &[Need], room: f64) -> Vec<f64> {
    const MARGIN: f64 = 1.2;
    let mut shares = vec![None; needs.len()];
    loop {
        let given: f64 = shares.iter().flatten().sum();
        let open = || (0..needs.len()).filter(|&index| shares[index].is_none());
        let places: f64 = open().map(|index| needs[index].places).sum();
        let share = |index: usize| (room - given) * needs[index].places / places;
        let content: Vec<usize> = open()
            .filter(|&index| MARGIN * needs[index].bytes <= share(index))
            .collect();
        if content.is_empty() {
            return (0..needs.len())
                .map(|index| shares[index].unwrap_or_else(|| share(index)))
                .collect();
        }
        for index in content {
            shares[index] = Some(MARGIN * needs[index].bytes);
        }
    }
}

/// Bytes in words: KB of 1024 bytes, rounded up.
fn kilobytes(bytes: usize) -> usize {
    bytes.div_ceil(1024)
}

impl Plan {
    /// Returns one line on what `textures` textures will take.
    pub fn in_words(&self, textures: usize) -> String {
        let (planned, slot) = (kilobytes(self.planned_bytes), kilobytes(limits::SLOT_BYTES));
        let noun = if textures == 1 {
            "texture needs"
        } else {
            "textures need"
        };
        let mut line = format!("{textures} {noun} about {planned} KB of {slot}");
        if self.wanted_bytes > limits::MAX_LIBRARY_BYTES {
            let wanted = kilobytes(self.wanted_bytes);
            line.push_str(&format!(
                "; grids are chosen for that, whole ones would need {wanted} KB"
            ));
        }
        line
    }
}

/// The account of one texture.
#[derive(Clone, Debug, Serialize)]
pub struct ImportReport {
    /// Name of the texture.
    pub texture: String,
    /// Notes on its file.
    pub warnings: Vec<String>,
    /// Values of the speed axis, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// Values of the force axis, N.
    pub forces_n: Vec<f32>,
    /// Its nodes.
    pub nodes: Vec<ConvertedNode>,
    /// Errors at the models' own places.
    pub own_places: Vec<PlaceError>,
    /// Errors between them.
    pub between: Vec<PlaceError>,
}

impl ImportReport {
    /// The account of what was `converted` from `source`.
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

/// Converts all `sources` as `plan` says, and calls `progress` after each file.
///
/// # Errors
/// A model that the library cannot hold, with its file; a library that does not fit in a slot.
pub fn import(
    sources: &[Source],
    plan: &Plan,
    progress: &(impl Fn() + Sync),
) -> Result<(Vec<Converted>, Vec<u8>)> {
    let converted: Vec<Converted> = sources
        .par_iter()
        .zip(&plan.bounds)
        .map(|(source, bounds)| {
            let converted = convert(&source.name, &source.toolkit, *bounds)
                .map_err(|failure| Error::file(&source.path, failure.to_string()));
            progress();
            converted
        })
        .collect::<Result<_>>()?;
    let specs: Vec<TextureSpec> = converted
        .iter()
        .map(|texture| texture.spec.clone())
        .collect();
    let bytes = encode(&specs).map_err(|failure| {
        Error::Model(format!("the textures do not make a library: {failure}"))
    })?;
    if bytes.len() > limits::MAX_LIBRARY_BYTES {
        return Err(Error::Request(format!(
            "{} textures take {} KB of a slot's {}: ask for fewer --speeds or --forces",
            sources.len(),
            kilobytes(bytes.len()),
            kilobytes(limits::SLOT_BYTES)
        )));
    }
    Ok((converted, bytes))
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;
    use proptest::prelude::*;

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
        };
        for options in [asked, Options::default()] {
            let plan = plan(&sources, &options).unwrap();
            let bytes: usize = plan.bounds.iter().map(|bounds| bounds.bytes).sum();
            assert!(
                bytes < limits::MAX_LIBRARY_BYTES && bytes > limits::MAX_LIBRARY_BYTES * 9 / 10
            );
            assert!(plan.planned_bytes <= limits::MAX_LIBRARY_BYTES);
            assert!(plan.in_words(8).contains("of 512"), "{}", plan.in_words(8));
        }
        let speeds = Some(65);
        assert!(plan(&sources, &Options { speeds, ..asked }).is_err());
    }

    proptest! {
        #[test]
        fn shares_fill_the_room_and_no_more_than_it(
            wanted in prop::collection::vec((1.0f64..1e6, 1.0f64..80.0), 1..40), room in 1e3f64..1e6,
        ) {
            let bounds = Bounds { speeds: 1, forces: 1, bytes: 0 };
            let needs: Vec<Need> =
                wanted.into_iter().map(|(bytes, places)| Need { bytes, places, bounds }).collect();
            let shares = shares(&needs, room);
            let sum: f64 = shares.iter().sum();
            prop_assert!(sum <= room * (1.0 + 1e-9));
            // What is not given away nobody needs.
            let content = needs.iter().zip(&shares).all(|(need, share)| need.bytes <= *share);
            prop_assert!(content || sum >= room * (1.0 - 1e-9), "{} of {}", sum, room);
        }
    }
}
