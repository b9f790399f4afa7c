//! Compilation of a scene's description to the wire form in which a library holds it.

use model_format::scene::limits::{MAX_REGIONS, MAX_SECTIONS, MAX_SURFACES};
use model_format::scene::{
    Biquad, MotionOfScene, Region, Scene, SceneError, SceneName, ScenePlace, SceneProblem, StickSlip, Surface, Tap,
};
use model_format::{Library, Provenance};
use stylus_dsp::equaliser::Section;
use stylus_kernel::scene::Plan;
use stylus_support::names::listed;
use stylus_support::number::{force_fault, speed_fault};
use stylus_support::toml_field::{Field, line_of};
use stylus_support::{Error, Result};

use super::description::{ConstantMotion, SceneFile, SurfaceDescription};

/// A scene in its wire form, checked against the library that plays it.
#[derive(Clone, Debug)]
pub struct CompiledScene {
    /// The wire form.
    pub scene: Scene,
    /// Names of the surfaces, in the scene's order.
    pub surface_names: Vec<String>,
}

impl CompiledScene {
    /// Returns the stages that the kernel runs.
    pub fn plan<'a>(&self, library: &Library<'a>) -> Result<Plan<'a>> {
        Plan::new(&self.scene, library).map_err(|error| Error::Request(format!("scene '{}': {error}", self.scene.name)))
    }

    /// Returns the provenance of the scene in `library`, which is that of all its textures.
    pub fn provenance(&self, library: &Library<'_>) -> Provenance {
        let textures = self.scene.surfaces.iter().filter_map(|surface| {
            let texture = usize::from(surface.texture?);
            library.textures().nth(texture)
        });
        Provenance::of_all(textures.map(|texture| texture.provenance()))
    }
}

impl SceneFile {
    /// Looks up the textures in `library`, and checks the whole scene.
    ///
    /// # Errors
    /// [`Error::Line`] at the line of a value that is out of range or that [`Scene::validate`] refuses, of a name that
    /// the library or the scene does not have or that two surfaces have, or of the first item above the allowed number.
    pub fn compile(&self, library: &Library<'_>) -> Result<CompiledScene> {
        let root = Field::default();
        // Names are resolved first, because `validate` sees only indices and could not name them.
        let surface_names = self.surface_names()?;
        let name = self.name(&root.key("name"))?;
        let surfaces = self.surfaces(&root.key("surface"), library)?;
        let (regions, order) = self.regions(&root.key("region"), &surface_names)?;
        let equaliser = self.equaliser(&root.key("equaliser"))?;
        let scene = Scene {
            name,
            sample_rate_hz: self.description.sample_rate_hz,
            surfaces,
            regions,
            transition_mm: self.description.transition_mm,
            motion: match &self.description.constant_motion {
                None => MotionOfScene::Followed,
                Some(motion) => self.constant_motion(&root.key("constant_motion"), motion)?,
            },
            equaliser,
        };
        scene.validate(library).map_err(|error| self.located(&error, &order))?;
        Ok(CompiledScene { scene, surface_names })
    }

    /// Returns the constant motion. The sign of its speed is ignored, and a negative force means no contact, as in
    /// every motion.
    fn constant_motion(&self, place: &Field, motion: &ConstantMotion) -> Result<MotionOfScene> {
        let (speed_mm_s, force_n) = (motion.speed_mm_s, motion.force_n);
        for (key, fault) in [
            ("speed_mm_s", speed_fault(speed_mm_s.into())),
            ("force_n", force_fault(force_n.into())),
        ] {
            if let Some(fault) = fault {
                return Err(self.error(&place.key(key), fault));
            }
        }
        Ok(MotionOfScene::Constant {
            speed_mm_s: speed_mm_s.abs(),
            force_n: force_n.max(0.0),
        })
    }

    fn name(&self, place: &Field) -> Result<SceneName> {
        let name = self.description.name.as_str();
        // Only the length can fail here. `validate` checks the characters.
        SceneName::try_from(name).map_err(|_| {
            let problem = format!(
                "has {} bytes; it must have 1 to {}",
                name.len(),
                model_format::limits::MAX_NAME_BYTES
            );
            self.error(place, problem)
        })
    }

    /// Returns the names of as many surfaces as a scene may have, all different.
    fn surface_names(&self) -> Result<Vec<String>> {
        let mut names: Vec<String> = Vec::new();
        for (index, surface) in self.description.surfaces.iter().take(MAX_SURFACES).enumerate() {
            let place = Field::default().key("surface").item(index);
            let name = match surface.name() {
                Some(name) => name.to_owned(),
                // A smooth surface without a name gets one by its number, which regions may use.
                None => format!("surface {}", index + 1),
            };
            if let Some(other) = names.iter().position(|other| *other == name) {
                let given = match (&surface.name, &surface.texture) {
                    (Some(_), _) => place.key("name"),
                    (None, Some(_)) => place.key("texture"),
                    (None, None) => place,
                };
                let problem = format!(
                    "surface {} is called '{name}' already; give each a name of its own",
                    other + 1
                );
                return Err(self.error(&given, problem));
            }
            names.push(name);
        }
        Ok(names)
    }

    fn surfaces(&self, place: &Field, library: &Library<'_>) -> Result<heapless::Vec<Surface, MAX_SURFACES>> {
        let mut surfaces = heapless::Vec::new();
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

    fn surface(&self, place: &Field, surface: &SurfaceDescription, library: &Library<'_>) -> Result<Surface> {
        let texture = surface.texture.as_deref().map(|name| {
            let found = library.textures().position(|texture| texture.name() == name);
            // A library has at most 256 textures, so the index fits into a byte.
            found.map(|index| index as u8).ok_or_else(|| {
                let known: Vec<&str> = library.textures().map(|texture| texture.name()).collect();
                let problem = format!("the library has no texture '{name}'; it has {}", listed(name, &known));
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

    /// Returns the regions in their order along the path, and the index of each in the text.
    fn regions(
        &self,
        place: &Field,
        surface_names: &[String],
    ) -> Result<(heapless::Vec<Region, MAX_REGIONS>, Vec<usize>)> {
        let described = &self.description.regions;
        // The wire form has regions in the order of the path; the text may have them in any order.
        let mut order: Vec<usize> = (0..described.len()).collect();
        order.sort_by(|&a, &b| described[a].start_mm.total_cmp(&described[b].start_mm));
        let mut regions = heapless::Vec::new();
        for &index in &order {
            let (region, place) = (&described[index], place.item(index));
            let surface = surface_names.iter().position(|name| *name == region.surface);
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
                // More surfaces than a byte can count are refused elsewhere, at the surfaces.
                surface: u8::try_from(surface).unwrap_or(u8::MAX),
            };
            regions.push(region).map_err(|_| {
                let problem = format!("a scene has at most {MAX_REGIONS} regions");
                self.error(&place, problem)
            })?;
        }
        Ok((regions, order))
    }

    fn equaliser(&self, place: &Field) -> Result<heapless::Vec<Biquad, MAX_SECTIONS>> {
        let mut stored = heapless::Vec::new();
        let Some(described) = &self.description.equaliser else {
            return Ok(stored);
        };
        if described.sections.is_empty() {
            let problem = "needs sections, as [[equaliser.section]]";
            return Err(self.error(place, problem));
        }
        let rate_hz = f64::from(self.description.sample_rate_hz);
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
        Ok(stored)
    }

    /// Returns the error of [`Scene::validate`] at its line. `order` holds the index in the text of each region of the
    /// scene.
    fn located(&self, error: &SceneError, order: &[usize]) -> Error {
        let region = |index: usize| {
            let index = order.get(index).copied().unwrap_or(index);
            Field::default().key("region").item(index)
        };
        let place = place_of(error, region);
        // The other region is named by its line, because its index is that of the sorted order.
        if let SceneProblem::RegionOverlap {
            start_mm,
            before,
            end_mm,
        } = error.problem
        {
            let line = line_of(&self.text, &region(before));
            let problem = format!("it begins at {start_mm} mm, before the region in line {line} ends at {end_mm} mm");
            return self.error(&place, problem);
        }
        self.error(&place, error.problem)
    }
}

/// Returns the key in the text that holds the value that `error` is about; `region` maps a region of the scene to its
/// key.
pub(super) fn place_of(error: &SceneError, region: impl Fn(usize) -> Field) -> Field {
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
            // The wire form has coefficients, which are no keys of the text.
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn a_given_name_that_is_another_surfaces_number_is_refused_at_that_surface() {
        let text = "name = 'two'\n[[surface]]\nname = 'surface 2'\n[[surface]]\ngain = 0.5\n";
        let scene = SceneFile::from_toml(Path::new("two.toml"), text).unwrap();
        let failure = scene.surface_names().unwrap_err().to_string();
        test_helpers::holds(&failure, &["4", "surface[2]: surface 1 is called 'surface 2'"]);
    }

    #[test]
    fn surfaces_above_the_allowed_number_are_compared_with_none() {
        let text = "name = 'many'\n".to_owned() + &"[[surface]]\n".repeat(3 * MAX_SURFACES);
        let scene = SceneFile::from_toml(Path::new("many.toml"), &text).unwrap();
        assert_eq!(scene.surface_names().unwrap().len(), MAX_SURFACES);
    }
}
