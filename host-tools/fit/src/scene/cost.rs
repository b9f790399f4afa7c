//! Cost of a scene in instructions per sample, per situation, with the arithmetic. It comes from the kernel's own cost
//! model, so that the host refuses a scene exactly when the device does.

use model_format::Library;
use model_format::scene::{MotionOfScene, Scene, Surface};
use serde::Serialize;
use stylus_kernel::scene::cost::{Cost, Item, Term, budget_per_sample};
use stylus_kernel::scene::{Plan, cost};
use stylus_support::{Error, Result};

use super::library::surface_names;

/// A scene's cost against a budget, in instructions per sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CostReport {
    /// The scene's name.
    pub scene: String,
    /// Sample rate, Hz.
    pub sample_rate_hz: u32,
    /// Instructions per sample that the scene may take: those of a whole tick at 5 kHz, half of that at 10 kHz.
    pub budget_instructions: u32,
    /// True if the worst case is within the budget; otherwise the device refuses the scene.
    pub fits: bool,
    /// The worst case over all motions.
    pub worst_case: Situation,
    /// The cases between transitions: without contact, and on each surface.
    pub typical: Vec<Situation>,
}

/// The cost of one situation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Situation {
    /// Description of the situation.
    pub when: String,
    /// Instructions per sample, in total.
    pub instructions: u32,
    /// Cost of each stage.
    pub arithmetic: Vec<StageCost>,
}

/// The cost of one stage: base + count · each instructions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StageCost {
    /// Name of the stage.
    pub item: String,
    /// Instructions of the stage itself.
    pub base: u16,
    /// Instructions per counted item.
    pub each: u16,
    /// Number of items.
    pub count: u16,
    /// Instructions in total.
    pub instructions: u32,
}

impl CostReport {
    /// Returns the cost of `scene`, whose surfaces have these `names`, against `budget` instructions per tick.
    pub fn new(scene: &Scene, names: &[String], library: &Library<'_>, budget: u32) -> Result<Self> {
        let budget = budget_per_sample(budget, scene.sample_rate_hz);
        let worst = worst_case(scene, library)?;
        // The first term is the base of the sample's path, which also runs in silence.
        let silence = &worst.terms()[..1];
        let mut typical = vec![Situation::new("no contact, all rung out", silence, names)];
        // A surface without a region is never touched, except the first one if there are no regions.
        let occurring = |index: usize| {
            let mut regions = scene.regions.iter();
            let named = regions.any(|region| usize::from(region.surface) == index);
            named || (scene.regions.is_empty() && index == 0)
        };
        for (index, surface) in scene.surfaces.iter().enumerate() {
            if !occurring(index) {
                continue;
            }
            let name = names.get(index).map_or("", String::as_str);
            let mut add = |when: String, surface: Surface, taps: bool| -> Result<()> {
                let terms = terms_on(scene, surface, index, taps, library)?;
                typical.push(Situation::new(&when, &terms, names));
                Ok(())
            };
            let plain = Surface {
                tap: None,
                stick_slip: None,
                ..surface.clone()
            };
            add(format!("on {name}"), plain.clone(), false)?;
            if surface.stick_slip.is_some() {
                let sticking = Surface {
                    stick_slip: surface.stick_slip,
                    ..plain.clone()
                };
                add(format!("on {name}, sticking"), sticking, false)?;
            }
            if surface.tap.is_some() {
                let tapped = Surface {
                    tap: surface.tap,
                    ..plain
                };
                add(format!("on {name}, a tap ringing"), tapped, true)?;
            }
        }
        Ok(Self {
            scene: scene.name.as_str().to_owned(),
            sample_rate_hz: scene.sample_rate_hz,
            budget_instructions: budget,
            fits: worst.instructions() <= budget,
            worst_case: Situation::new("worst case", worst.terms(), names),
            typical,
        })
    }
}

impl Situation {
    fn new(when: &str, terms: &[Term], names: &[String]) -> Self {
        let arithmetic: Vec<StageCost> = terms.iter().map(|&term| StageCost::new(term, names)).collect();
        Self {
            when: when.to_owned(),
            instructions: arithmetic.iter().map(|line| line.instructions).sum(),
            arithmetic,
        }
    }

    /// Returns the arithmetic in one line.
    pub fn sum(&self) -> String {
        let terms: Vec<String> = self.arithmetic.iter().map(ToString::to_string).collect();
        terms.join("; ")
    }
}

impl StageCost {
    fn new(term: Term, names: &[String]) -> Self {
        let named = |surface: u8| names.get(usize::from(surface)).map_or("", String::as_str);
        Self {
            item: match term.item {
                Item::Voice { surface } => format!("{}, normalised lattice", named(surface)),
                Item::StickSlip { surface } => format!("{}, stick-slip", named(surface)),
                Item::Lines { surface } => format!("{}, lines", named(surface)),
                other => other.to_string(),
            },
            base: term.cost.base,
            each: term.cost.each,
            count: term.count,
            instructions: term.instructions(),
        }
    }
}

impl std::fmt::Display for StageCost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            item,
            base,
            each,
            count,
            ..
        } = self;
        if *each == 0 {
            write!(f, "{item}: {base}")
        } else {
            write!(f, "{item}: {base} + {count} x {each}")
        }
    }
}

fn worst_case(scene: &Scene, library: &Library<'_>) -> Result<Cost> {
    Ok(Plan::new(scene, library)
        .map_err(|error| Error::Request(format!("scene '{}': {error}", scene.name)))?
        .worst_case())
}

/// Returns the terms of the stages that run on `surface`, number `index` of `scene`. They equal those of a scene with
/// only this surface, without the fade, which runs only while scenes are exchanged.
fn terms_on(scene: &Scene, surface: Surface, index: usize, taps: bool, library: &Library<'_>) -> Result<Vec<Term>> {
    let mut alone = Scene::of_surface(scene.name.clone(), scene.sample_rate_hz, surface);
    alone.equaliser.clone_from(&scene.equaliser);
    let cost = worst_case(&alone, library)?;
    let terms = cost.terms().iter().copied();
    let here = |mut term: Term| {
        // In the scene with only this surface, the surface has the number 0.
        if let Item::Voice { surface, .. } | Item::StickSlip { surface } | Item::Lines { surface } = &mut term.item {
            *surface = index as u8;
        }
        term
    };
    Ok(terms
        .filter(|term| term.item != Item::FadeOut && (taps || term.item != Item::Tap))
        .map(here)
        .collect())
}

/// Summary of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneSummary {
    /// Name.
    pub name: String,
    /// Names of its surfaces.
    pub surfaces: Vec<String>,
    /// Number of its regions.
    pub regions: usize,
    /// True if the scene sets a constant motion.
    pub constant_motion: bool,
    /// Names of its effects, besides textures.
    pub effects: Vec<&'static str>,
    /// Worst case of the kernel's cost model, instructions per sample.
    pub worst_case_instructions: u32,
}

impl SceneSummary {
    /// Returns the summary of `scene`, which is one of `library`.
    pub fn of(scene: &Scene, library: &Library<'_>) -> Result<Self> {
        let names = surface_names(scene, library);
        let report = CostReport::new(scene, &names, library, cost::BUDGET)?;
        let effects = [
            ("transitions", scene.transition_mm > 0.0 && scene.regions.len() > 1),
            ("taps", scene.surfaces.iter().any(|s| s.tap.is_some())),
            ("stick-slip", scene.surfaces.iter().any(|s| s.stick_slip.is_some())),
            ("equaliser", !scene.equaliser.is_empty()),
        ];
        Ok(Self {
            name: scene.name.as_str().to_owned(),
            surfaces: names,
            regions: scene.regions.len(),
            constant_motion: scene.motion != MotionOfScene::Followed,
            effects: effects
                .into_iter()
                .filter_map(|(effect, is_there)| is_there.then_some(effect))
                .collect(),
            worst_case_instructions: report.worst_case.instructions,
        })
    }
}
