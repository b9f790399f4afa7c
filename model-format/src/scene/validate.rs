//! The check of a scene.

use super::{MotionOfScene, Scene, SceneError, ScenePlace, SceneProblem, StickSlip, Surface, Tap, equaliser, limits};
use crate::library::{Library, Texture};
use crate::limits::{MAX_OUTPUT_POWER, MAX_SAMPLE_RATE_HZ};

/// Properties of a texture with which a surface must agree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TextureBounds {
    sample_rate_hz: u32,
    highest_gain: f32,
}

impl TextureBounds {
    /// Placeholder where there is no texture.
    pub const NONE: Self = Self {
        sample_rate_hz: 0,
        highest_gain: 0.0,
    };

    pub fn of(texture: &Texture<'_>) -> Self {
        Self {
            sample_rate_hz: texture.sample_rate_hz(),
            highest_gain: highest_gain(texture),
        }
    }
}

impl Scene {
    /// Checks the whole scene, and that `library` has its textures.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn validate(&self, library: &Library<'_>) -> Result<(), SceneError> {
        self.validate_decoded(library)?;
        equaliser::check(&self.equaliser).map_err(|(section, problem)| problem.at(ScenePlace::Section(section)))
    }

    /// Checks everything except the gain of the equaliser. That check is most of the work, and a decoded scene has
    /// already passed it.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn validate_decoded(&self, library: &Library<'_>) -> Result<(), SceneError> {
        let textures = self.textures(library);
        let bounds = textures.map(|texture| texture.as_ref().map(TextureBounds::of));
        self.validate_with(library.len(), |surface, _| bounds[surface])
    }

    /// Like [`Scene::validate_decoded`], for a library of `count` textures. `bounds` gets the index of a surface and
    /// the index of its texture, and returns the texture's properties, or none if there is no such texture.
    pub(crate) fn validate_with(
        &self,
        count: usize,
        bounds: impl Fn(usize, usize) -> Option<TextureBounds>,
    ) -> Result<(), SceneError> {
        let here = |problem: SceneProblem| problem.at(ScenePlace::Scene);
        if self.name.is_empty() {
            return Err(here(SceneProblem::NameLength));
        }
        if self.name.chars().any(char::is_control) {
            return Err(here(SceneProblem::NameCharacter));
        }
        if self.sample_rate_hz == 0 || self.sample_rate_hz > MAX_SAMPLE_RATE_HZ {
            return Err(here(SceneProblem::SampleRate(self.sample_rate_hz)));
        }
        if self.surfaces.is_empty() {
            return Err(here(SceneProblem::NoSurface));
        }
        let transition = [0.0, limits::MAX_TRANSITION_MM];
        within("transition", self.transition_mm, transition, "mm").map_err(here)?;
        if let MotionOfScene::Constant { speed_mm_s, force_n } = self.motion {
            within("speed", speed_mm_s, [0.0, limits::MAX_SPEED_MM_S], "mm/s")
                .and_then(|()| within("force", force_n, [0.0, limits::MAX_FORCE_N], "N"))
                .map_err(|problem| problem.at(ScenePlace::Motion))?;
        }
        for (index, surface) in self.surfaces.iter().enumerate() {
            let texture = surface.texture.map(usize::from);
            let found = texture.and_then(|texture| bounds(index, texture));
            self.validate_surface(index, surface, found, count)?;
        }
        self.validate_regions()?;
        equaliser::check_poles(&self.equaliser).map_err(|(section, problem)| problem.at(ScenePlace::Section(section)))
    }

    /// Returns the texture of each surface, or none where the surface has no texture or `library` has no texture of
    /// that index.
    ///
    /// One pass over the library serves all surfaces. It parses the headers of only those textures that a surface uses.
    pub fn textures<'a>(&self, library: &Library<'a>) -> [Option<Texture<'a>>; limits::MAX_SURFACES] {
        let mut textures = [None; limits::MAX_SURFACES];
        for (index, record) in library.records().enumerate() {
            let is_used = |surface: &Surface| surface.texture.map(usize::from) == Some(index);
            if self.surfaces.iter().any(is_used) {
                let found = Texture::parse(record, index).ok();
                let users = textures.iter_mut().zip(&self.surfaces);
                let users = users.filter(|(_, surface)| is_used(surface));
                users.for_each(|(texture, _)| *texture = found);
            }
        }
        textures
    }

    fn validate_surface(
        &self,
        index: usize,
        surface: &Surface,
        found: Option<TextureBounds>,
        count: usize,
    ) -> Result<(), SceneError> {
        let here = |problem: SceneProblem| problem.at(ScenePlace::Surface(index));
        within("gain", surface.gain, [0.0, limits::MAX_GAIN], "").map_err(here)?;
        if let Some(texture) = surface.texture {
            let found = found.ok_or(here(SceneProblem::UnknownTexture { texture, count }))?;
            self.validate_texture(surface.gain, found).map_err(here)?;
        }
        if let Some(tap) = &surface.tap {
            self.validate_tap(tap)
                .map_err(|problem| problem.at(ScenePlace::Tap(index)))?;
        }
        if let Some(stick_slip) = &surface.stick_slip {
            let at = |problem: SceneProblem| problem.at(ScenePlace::StickSlip(index));
            if surface.texture.is_none() {
                return Err(at(SceneProblem::NothingToModulate));
            }
            validate_stick_slip(stick_slip).map_err(at)?;
        }
        Ok(())
    }

    fn validate_texture(&self, gain: f32, texture: TextureBounds) -> Result<(), SceneProblem> {
        if texture.sample_rate_hz != self.sample_rate_hz {
            return Err(SceneProblem::TextureRate {
                texture_hz: texture.sample_rate_hz,
                scene_hz: self.sample_rate_hz,
            });
        }
        let highest = texture.highest_gain;
        if gain > highest {
            return Err(SceneProblem::TooLoud { gain, highest });
        }
        Ok(())
    }

    fn validate_tap(&self, tap: &Tap) -> Result<(), SceneProblem> {
        let highest_hz = self.sample_rate_hz as f32 * limits::MAX_TAP_SHARE_OF_RATE;
        let frequency = [limits::MIN_TAP_HZ, highest_hz];
        within("frequency", tap.frequency_hz, frequency, "Hz")?;
        within("decay", tap.decay_s, limits::TAP_DECAY_S, "s")?;
        let gain = [0.0, limits::MAX_TAP_GAIN];
        within("gain", tap.gain_m_s2_per_n_s, gain, "m/s² per N/s")?;
        within("limit", tap.limit_m_s2, [0.0, limits::MAX_TAP_M_S2], "m/s²")
    }

    fn validate_regions(&self) -> Result<(), SceneError> {
        const PATH: [f32; 2] = [-limits::MAX_POSITION_MM, limits::MAX_POSITION_MM];
        for (index, region) in self.regions.iter().enumerate() {
            let here = |problem: SceneProblem| problem.at(ScenePlace::Region(index));
            let (start_mm, end_mm) = (region.start_mm, region.end_mm);
            within("start", start_mm, PATH, "mm").map_err(here)?;
            within("end", end_mm, PATH, "mm").map_err(here)?;
            // Neither is a NaN, which no range contains, so that all comparisons hold.
            if end_mm <= start_mm {
                return Err(here(SceneProblem::RegionEnd { start_mm, end_mm }));
            }
            let count = self.surfaces.len();
            if usize::from(region.surface) >= count {
                let surface = region.surface;
                return Err(here(SceneProblem::UnknownSurface { surface, count }));
            }
            let Some(before) = index.checked_sub(1) else {
                continue;
            };
            let end_mm = self.regions[before].end_mm;
            if start_mm < end_mm {
                return Err(here(SceneProblem::RegionOverlap {
                    start_mm,
                    before,
                    end_mm,
                }));
            }
        }
        Ok(())
    }
}

fn validate_stick_slip(stick_slip: &StickSlip) -> Result<(), SceneProblem> {
    let period = limits::STICK_SLIP_PERIOD_MM;
    within("period", stick_slip.period_mm, period, "mm")?;
    within("duty", stick_slip.duty, limits::STICK_SLIP_DUTY, "")?;
    within("depth", stick_slip.depth, [0.0, 1.0], "")?;
    let lowest = limits::MIN_STICK_SLIP_THRESHOLD;
    let speeds = [lowest, limits::MAX_SPEED_MM_S];
    within("below", stick_slip.below_mm_s, speeds, "mm/s")?;
    within("above", stick_slip.above_n, [lowest, limits::MAX_FORCE_N], "N")
}

/// Returns the highest gain for `texture`: the largest power of two with which its loudest node has at most half the
/// highest RMS of a node, but at least 1 and at most [`limits::MAX_GAIN`].
///
/// A power of two can be found without a square root. The level of a lattice in the kernel relies on this bound. A
/// codebook changes the power of a node's output by at most 2 %; see [`crate::limits::MIN_CODEBOOK_POWER`].
fn highest_gain(texture: &Texture<'_>) -> f32 {
    let loudest = texture.max_output_power();
    let mut gain = 1.0;
    // With twice the gain, twice the RMS must still be within the limit: 4 · (2 · gain)² · loudest.
    while gain < limits::MAX_GAIN && 16.0 * gain * gain * loudest <= MAX_OUTPUT_POWER {
        gain *= 2.0;
    }
    gain
}

fn within(
    field: &'static str,
    value: f32,
    [lowest, highest]: [f32; 2],
    unit: &'static str,
) -> Result<(), SceneProblem> {
    // A NaN is in no range.
    if (lowest..=highest).contains(&value) {
        Ok(())
    } else {
        Err(SceneProblem::Range {
            field,
            value,
            lowest,
            highest,
            unit,
        })
    }
}
