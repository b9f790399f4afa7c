//! From a scene's text to the scene, with errors that name the line.

use std::path::{Path, PathBuf};

use model_format::Library;
use model_format::scene::limits::{MAX_REGIONS, MAX_SECTIONS, MAX_SURFACES};
use model_format::scene::{
    Biquad, MotionOfScene, Region, Scene, SceneError, SceneName, ScenePlace, SceneProblem,
    StickSlip, Surface, Tap,
};

use super::description::{Description, SurfaceDescription};
use super::equaliser::{self, Design, Response, Section};
use crate::support::error::{Error, Result};
use crate::support::toml_field::{Field, from_toml, line_of};

/// The text of a scene, read but not yet looked up in a library.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    path: PathBuf,
    text: String,
    description: Description,
}

/// A scene that its library can play.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// The scene.
    pub scene: Scene,
    /// What its surfaces are called, in their order.
    pub surface_names: Vec<String>,
    /// How the equaliser was found, if it is the inverse of a response.
    pub design: Option<Design>,
}

impl SceneFile {
    /// Reads a scene's text.
    ///
    /// # Errors
    /// A file that cannot be read, and what [`SceneFile::from_toml`] refuses.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(Error::io("read", path))?;
        Self::from_toml(path, &text)
    }

    /// Takes a scene from TOML `text`; files that it names are looked for beside `path`.
    ///
    /// # Errors
    /// [`Error::Line`]: text that is not TOML, a key that is unknown, missing, or of the wrong type.
    pub fn from_toml(path: &Path, text: &str) -> Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            text: text.to_owned(),
            description: from_toml(path, text)?,
        })
    }

    /// What the text says.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Looks everything up in `library`, designs the equaliser if a response is given, and checks the whole.
    ///
    /// # Errors
    /// [`Error::Line`] with the line of what [`Scene::validate`] finds, of a name that the library or the scene does not have,
    /// and of too many of something; and what is wrong with the file of a response.
    pub fn compile(&self, library: &Library<'_>) -> Result<Compiled> {
        let root = Field::default();
        let surface_names = self.surface_names()?;
        let name = self.name(&root.key("name"))?;
        let surfaces = self.surfaces(&root.key("surface"), library)?;
        let (regions, order) = self.regions(&root.key("region"), &surface_names)?;
        let (equaliser, design) = self.equaliser(&root.key("equaliser"))?;
        let scene = Scene {
            name,
            sample_rate_hz: self.description.sample_rate_hz,
            surfaces,
            regions,
            transition_mm: self.description.transition_mm,
            motion: match &self.description.constant_motion {
                None => MotionOfScene::Followed,
                Some(motion) => MotionOfScene::Constant {
                    speed_mm_s: motion.speed_mm_s,
                    force_n: motion.force_n,
                },
            },
            equaliser,
        };
        scene
            .validate(library)
            .map_err(|error| self.located(&error, &order))?;
        Ok(Compiled {
            scene,
            surface_names,
            design,
        })
    }

    fn error(&self, place: &Field, problem: impl std::fmt::Display) -> Error {
        place.error(&self.path, &self.text, problem)
    }

    fn name(&self, place: &Field) -> Result<SceneName> {
        let name = self.description.name.as_str();
        SceneName::try_from(name).map_err(|_| {
            let problem = format!(
                "has {} bytes; it must have 1 to {}",
                name.len(),
                model_format::limits::MAX_NAME_BYTES
            );
            self.error(place, problem)
        })
    }

    /// What surfaces are called; no two are called the same.
    fn surface_names(&self) -> Result<Vec<String>> {
        let mut names: Vec<String> = Vec::new();
        for (index, surface) in self.description.surfaces.iter().enumerate() {
            let place = Field::default().key("surface").item(index);
            let name = match surface.name() {
                Some(name) => name.to_owned(),
                // What no region can call needs no name.
                None => format!("surface {}", index + 1),
            };
            if let Some(other) = names.iter().position(|other| *other == name) {
                let key = if surface.name.is_some() {
                    "name"
                } else {
                    "texture"
                };
                let problem = format!(
                    "surface {} is called '{name}' already; give each a name of its own",
                    other + 1
                );
                return Err(self.error(&place.key(key), problem));
            }
            names.push(name);
        }
        Ok(names)
    }

    fn surfaces(
        &self,
        place: &Field,
        library: &Library<'_>,
    ) -> Result<heapless::Vec<Surface, MAX_SURFACES>> {
        let mut surfaces = heapless_vec();
        for (index, surface) in self.description.surfaces.iter().enumerate() {
            let place = place.item(index);
            let surface = self.surface(&place, surface, library)?;
            surfaces.push(surface).map_err(|_| {
                let problem = format!("a scene has at most {MAX_SURFACES} surfaces");
                self.error(&place, problem)
            })?;
        }
        Ok(surfaces)
    }

    fn surface(
        &self,
        place: &Field,
        surface: &SurfaceDescription,
        library: &Library<'_>,
    ) -> Result<Surface> {
        let texture = surface.texture.as_deref().map(|name| {
            let found = library
                .textures()
                .position(|texture| texture.name() == name);
            found.map(|index| index as u8).ok_or_else(|| {
                let known: Vec<&str> = library.textures().map(|texture| texture.name()).collect();
                let problem = format!(
                    "the library has no texture '{name}'; it has {}",
                    known.join(", ")
                );
                self.error(&place.key("texture"), problem)
            })
        });
        Ok(Surface {
            texture: texture.transpose()?,
            gain: surface.gain,
            tap: surface.tap.as_ref().map(|tap| Tap {
                frequency_hz: tap.frequency_hz,
                decay_s: tap.decay_s,
                gain_m_s2_per_n_s: tap.gain_m_s2_per_n_s,
                limit_m_s2: tap.limit_m_s2,
            }),
            stick_slip: surface.stick_slip.as_ref().map(|stick_slip| StickSlip {
                period_mm: stick_slip.period_mm,
                duty: stick_slip.duty,
                depth: stick_slip.depth,
                below_mm_s: stick_slip.below_mm_s,
                above_n: stick_slip.above_n,
            }),
        })
    }

    /// The regions along the path, and which of the text's each of them is.
    fn regions(
        &self,
        place: &Field,
        surface_names: &[String],
    ) -> Result<(heapless::Vec<Region, MAX_REGIONS>, Vec<usize>)> {
        let described = &self.description.regions;
        let mut order: Vec<usize> = (0..described.len()).collect();
        order.sort_by(|&a, &b| described[a].start_mm.total_cmp(&described[b].start_mm));
        let mut regions = heapless_vec();
        for &index in &order {
            let (region, place) = (&described[index], place.item(index));
            let surface = surface_names
                .iter()
                .position(|name| *name == region.surface);
            let Some(surface) = surface else {
                let problem = format!(
                    "the scene has no surface '{}'; it has {}",
                    region.surface,
                    surface_names.join(", ")
                );
                return Err(self.error(&place.key("surface"), problem));
            };
            let region = Region {
                start_mm: region.start_mm,
                end_mm: region.end_mm,
                // Above what a byte holds there are too many surfaces, which is said where they are.
                surface: u8::try_from(surface).unwrap_or(u8::MAX),
            };
            regions.push(region).map_err(|_| {
                let problem = format!("a scene has at most {MAX_REGIONS} regions");
                self.error(&place, problem)
            })?;
        }
        Ok((regions, order))
    }

    fn equaliser(
        &self,
        place: &Field,
    ) -> Result<(heapless::Vec<Biquad, MAX_SECTIONS>, Option<Design>)> {
        let Some(described) = &self.description.equaliser else {
            return Ok((heapless_vec(), None));
        };
        let rate_hz = f64::from(self.description.sample_rate_hz);
        let mut stored = heapless_vec();
        if let Some(response) = &described.response {
            if !described.sections.is_empty() {
                let problem = "there is a response to be undone already; give one or the other";
                return Err(self.error(&place.key("section"), problem));
            }
            let beside = self.path.parent().unwrap_or(Path::new(""));
            let response = Response::read(&beside.join(response))?;
            let request = equaliser::Request {
                max_gain_db: described
                    .max_gain_db
                    .unwrap_or(equaliser::DEFAULT_MAX_GAIN_DB),
                max_sections: described.max_sections.unwrap_or(MAX_SECTIONS),
                lowest_hz: described.lowest_hz,
                highest_hz: described.highest_hz,
            };
            let design = equaliser::design(&response, rate_hz, &request)
                .map_err(|fault| self.error(&place.key(fault.key), fault.problem))?;
            stored.extend(design.biquads.iter().copied());
            return Ok((stored, Some(design)));
        }
        for (key, given) in [
            ("max_gain_db", described.max_gain_db.is_some()),
            ("max_sections", described.max_sections.is_some()),
            ("lowest_hz", described.lowest_hz.is_some()),
            ("highest_hz", described.highest_hz.is_some()),
        ] {
            if given {
                let problem = "goes with a response, and there is none";
                return Err(self.error(&place.key(key), problem));
            }
        }
        if described.sections.is_empty() {
            let problem = "needs a response, or sections as [[equaliser.section]]";
            return Err(self.error(place, problem));
        }
        for (index, section) in described.sections.iter().enumerate() {
            let place = place.key("section").item(index);
            let section = Section {
                kind: section.kind,
                frequency_hz: section.frequency_hz,
                q: section.q,
                gain_db: section.gain_db,
            };
            let biquad = section
                .biquad(rate_hz)
                .map_err(|fault| self.error(&place.key(fault.key), fault.problem))?;
            stored.push(biquad).map_err(|_| {
                let problem = format!("an equaliser has at most {MAX_SECTIONS} sections");
                self.error(&place, problem)
            })?;
        }
        Ok((stored, None))
    }

    /// What the shared check found, at its line. `order` tells which of the text's regions the scene's are.
    fn located(&self, error: &SceneError, order: &[usize]) -> Error {
        let region = |index: usize| {
            let index = order.get(index).copied().unwrap_or(index);
            Field::default().key("region").item(index)
        };
        let place = place_of(error, region);
        if let SceneProblem::RegionOverlap {
            start_mm,
            before,
            end_mm,
        } = error.problem
        {
            let line = line_of(&self.text, &region(before));
            let problem = format!(
                "it begins at {start_mm} mm, before the region in line {line} ends at {end_mm} mm"
            );
            return self.error(&place, problem);
        }
        self.error(&place, error.problem)
    }
}

fn heapless_vec<T, const N: usize>() -> heapless::Vec<T, N> {
    heapless::Vec::new()
}

/// The place in the text of what is wrong with the scene.
fn place_of(error: &SceneError, region: impl Fn(usize) -> Field) -> Field {
    let root = Field::default();
    let surface = |index: usize| root.key("surface").item(index);
    let (place, own): (Field, Option<&'static str>) = match error.place {
        ScenePlace::Scene => (root, None),
        ScenePlace::Surface(index) => (surface(index), Some("gain")),
        ScenePlace::Tap(index) => (surface(index).key("tap"), Some("gain_m_s2_per_n_s")),
        ScenePlace::StickSlip(index) => (surface(index).key("stick_slip"), None),
        ScenePlace::Region(index) => (region(index), None),
        ScenePlace::Motion => (root.key("constant_motion"), None),
        ScenePlace::Section(index) => {
            let sections = root.key("equaliser").key("section");
            return sections.item(index);
        }
    };
    let key = match error.problem {
        SceneProblem::Range { field, .. } => match field {
            "gain" => own,
            "transition" => Some("transition_mm"),
            "frequency" => Some("frequency_hz"),
            "decay" => Some("decay_s"),
            "limit" => Some("limit_m_s2"),
            "period" => Some("period_mm"),
            "duty" => Some("duty"),
            "depth" => Some("depth"),
            "below" => Some("below_mm_s"),
            "above" => Some("above_n"),
            "start" => Some("start_mm"),
            "end" => Some("end_mm"),
            "speed" => Some("speed_mm_s"),
            "force" => Some("force_n"),
            _ => None,
        },
        SceneProblem::NameLength | SceneProblem::NameCharacter => Some("name"),
        SceneProblem::SampleRate(_) => Some("sample_rate_hz"),
        SceneProblem::RegionEnd { .. } => Some("end_mm"),
        SceneProblem::RegionOverlap { .. } => Some("start_mm"),
        SceneProblem::NoSurface | SceneProblem::UnknownSurface { .. } => Some("surface"),
        SceneProblem::UnknownTexture { .. } | SceneProblem::TextureRate { .. } => Some("texture"),
        SceneProblem::TooLoud { .. } => Some("gain"),
        _ => None,
    };
    match key {
        Some(key) => place.key(key),
        None => place,
    }
}
