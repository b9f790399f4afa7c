//! The compiled scene: everything that stays the same while it is played.

use heapless::Vec;
use model_format::scene::limits::MAX_SURFACES;
use model_format::scene::{Biquad, MotionOfScene, Scene, SceneError, Surface, Tap};
use model_format::{Library, MillimetresPerSecond, Newton, Texture};

use super::cost::{self, Cost, Item, OverBudget, Term};
use super::equaliser::Equaliser;
use super::path::{Located, Path};
use super::playback::Wave;
use super::stick_slip::StickSlipWindow;
use super::tap::Resonance;
use crate::grid::{Motion, ONE};
use crate::synthesis::update_interval_samples;

/// A scene, compiled for playing.
#[derive(Clone, Debug)]
pub struct Plan<'a> {
    pub(super) surfaces: Vec<PlannedSurface<'a>, MAX_SURFACES>,
    pub(super) path: Path,
    pub(super) constant_motion: Option<Motion>,
    pub(super) equaliser: Equaliser,
    pub(super) sample_rate_hz: u32,
    /// True if any texture has lines that are tied to position.
    pub(super) has_lines: bool,
    /// A probe's waveform.
    pub(super) wave: Option<Wave<'a>>,
}

/// A surface with its texture looked up and its constants computed.
#[derive(Clone, Debug)]
pub(super) struct PlannedSurface<'a> {
    /// None for a smooth surface.
    pub texture: Option<Texture<'a>>,
    /// Gain in steps of 2⁻¹⁶.
    pub gain: u32,
    pub tap: Option<PlannedTap>,
    pub stick_slip: Option<StickSlipWindow>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct PlannedTap {
    pub tap: Tap,
    pub resonance: Resonance,
}

impl<'a> Plan<'a> {
    /// Compiles `scene` with the textures of `library`, after checking everything except the gain of its equaliser.
    pub fn new(scene: &Scene, library: &Library<'a>) -> Result<Self, SceneError> {
        scene.validate_decoded(library)?;
        let rate = scene.sample_rate_hz;
        let textures = scene.textures(library);
        let mut all = textures.iter().flatten();
        let has_lines = all.any(|texture| texture.lines().is_some());
        let surfaces = scene.surfaces.iter().zip(textures);
        Ok(Self {
            surfaces: surfaces
                .map(|(surface, texture)| PlannedSurface::new(surface, texture, rate))
                .collect(),
            path: Path::new(scene),
            constant_motion: match scene.motion {
                MotionOfScene::Followed => None,
                MotionOfScene::Constant { speed_mm_s, force_n } => {
                    Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).ok()
                }
            },
            equaliser: Equaliser::new(&scene.equaliser),
            sample_rate_hz: rate,
            has_lines,
            wave: None,
        })
    }

    /// The plan of `texture` everywhere, without effects.
    pub fn of_texture(texture: Texture<'a>) -> Self {
        let mut surfaces = Vec::new();
        // There is space for one.
        let _ = surfaces.push(PlannedSurface {
            texture: Some(texture),
            gain: ONE,
            tap: None,
            stick_slip: None,
        });
        Self {
            surfaces,
            has_lines: texture.lines().is_some(),
            ..Self::nothing(texture.sample_rate_hz())
        }
    }

    /// The plan of a probe's `wave` at `sample_rate_hz`, independent of what the tool does.
    pub fn of_wave(wave: Wave<'a>, sample_rate_hz: u32) -> Self {
        Self {
            wave: Some(wave),
            ..Self::nothing(sample_rate_hz)
        }
    }

    const fn nothing(sample_rate_hz: u32) -> Self {
        Self {
            surfaces: Vec::new(),
            path: Path::everywhere(),
            constant_motion: None,
            equaliser: Equaliser::NONE,
            sample_rate_hz,
            has_lines: false,
            wave: None,
        }
    }

    /// Appends `sections`, those of the device's response, to the plan's own equaliser.
    pub fn append(&mut self, sections: &[Biquad]) {
        self.equaliser.append(sections);
    }

    /// Returns the plan with each texture replaced by the result of `change`, for comparisons with parts left out; see
    /// [`Texture::without_codebooks`].
    ///
    /// A player cannot distinguish such textures from their originals, so each such plan needs its own player.
    #[must_use]
    pub fn with_textures(mut self, change: impl Fn(Texture<'a>) -> Texture<'a>) -> Self {
        let textures = self.surfaces.iter_mut().filter_map(|one| one.texture.as_mut());
        self.has_lines = false;
        for texture in textures {
            *texture = change(*texture);
            self.has_lines |= texture.lines().is_some();
        }
        self
    }

    /// The texture and the gain, in steps of 2⁻¹⁶, of each surface; a smooth surface has no texture.
    pub fn surfaces(&self) -> impl Iterator<Item = (Option<Texture<'a>>, u32)> {
        let surfaces = self.surfaces.iter();
        surfaces.map(|one| (one.texture, one.gain))
    }

    /// The surfaces at a position on the path, mm; see [`Path::locate`].
    pub fn locate(&self, position_mm: f32) -> Vec<Located, 2> {
        self.path.locate(position_mm)
    }

    /// Speed and force that the textures follow instead of the tool's, if the scene has them.
    pub fn constant_motion(&self) -> Option<Motion> {
        self.constant_motion
    }

    /// Sample rate, Hz.
    pub fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }

    /// Samples of a block: 2 ms at each rate that a stylus plays.
    pub fn block_samples(&self) -> u32 {
        update_interval_samples(self.sample_rate_hz)
    }

    /// Returns whether any texture has lines that are tied to position, so that the position matters.
    pub fn has_lines(&self) -> bool {
        self.has_lines
    }

    /// Instructions per sample in the worst case, in the model of [`cost`].
    ///
    /// With two surfaces or more, the two most expensive ones may sound together, because the tool may jump from any
    /// surface to any other. With one surface there is one voice.
    pub fn worst_case(&self) -> Cost {
        let voices = |surface: u8| -> Option<[Option<Term>; 3]> {
            let planned = self.surfaces.get(usize::from(surface))?;
            let texture = planned.texture.filter(|_| planned.gain > 0)?;
            let stick_slip = Term::once(Item::StickSlip { surface }, cost::STICK_SLIP);
            let stick_slip = planned.stick_slip.map(|_| stick_slip);
            let lines = Term::lines(surface, &texture);
            let voice = Term::voice(surface, &texture);
            Some([Some(voice), stick_slip, lines])
        };
        let price = |terms: &[Option<Term>; 3]| -> u32 { terms.iter().flatten().map(Term::instructions).sum() };
        let mut dearest: [Option<[Option<Term>; 3]>; 2] = [None; 2];
        for mut voice in self.path.surfaces().map(voices) {
            for place in &mut dearest {
                let price = |terms: &Option<[Option<Term>; 3]>| terms.as_ref().map_or(0, price);
                if price(&voice) > price(place) {
                    core::mem::swap(place, &mut voice);
                }
            }
        }
        let mut cost = Cost::default();
        cost.add(Term::once(Item::Mix, cost::MIX));
        dearest
            .into_iter()
            .flatten()
            .flatten()
            .flatten()
            .for_each(|term| cost.add(term));
        if self.wave.is_some() {
            cost.add(Term::once(Item::Wave, cost::WAVE));
        }
        let taps = self.path.surfaces().any(|surface| {
            let planned = self.surfaces.get(usize::from(surface));
            planned.is_some_and(|planned| planned.tap.is_some())
        });
        if taps {
            cost.add(Term::once(Item::Tap, cost::TAP));
        }
        if !self.equaliser.is_empty() {
            cost.add(Term {
                item: Item::Equaliser,
                cost: cost::EQUALISER,
                count: self.equaliser.len() as u16,
            });
        }
        // Voices fade by their own levels, so that other plans need no such stage.
        if taps || !self.equaliser.is_empty() {
            cost.add(Term::once(Item::FadeOut, cost::FADE_OUT));
        }
        cost
    }

    /// Returns [`Plan::worst_case`] if a tick's samples together are within `budget` instructions per tick.
    ///
    /// # Errors
    /// A worst case above the budget of a sample; the error holds its terms.
    pub fn within(&self, budget: u32) -> Result<Cost, OverBudget> {
        let budget = cost::budget_per_sample(budget, self.sample_rate_hz);
        self.worst_case().within(budget)
    }
}

impl<'a> PlannedSurface<'a> {
    fn new(surface: &Surface, texture: Option<Texture<'a>>, sample_rate_hz: u32) -> Self {
        Self {
            texture,
            gain: (surface.gain * ONE as f32 + 0.5) as u32,
            tap: surface.tap.map(|tap| PlannedTap {
                tap,
                resonance: Resonance::new(&tap, sample_rate_hz),
            }),
            stick_slip: surface.stick_slip.as_ref().map(StickSlipWindow::new),
        }
    }
}
