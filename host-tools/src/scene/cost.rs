//! What a scene takes of a tick, situation by situation, with the arithmetic.

use model_format::Library;
use model_format::scene::{Scene, Surface};
use serde::Serialize;
use stylus_kernel::scene::Plan;
use stylus_kernel::scene::cost::{Cost, Item, Term};

use crate::support::error::{Error, Result};

/// A scene's cost against a budget, in instructions of each tick, by the kernel's own model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CostReport {
    /// The scene's name.
    pub scene: String,
    /// What a tick has for it.
    pub budget_instructions: u32,
    /// Whether the worst case is within the budget; the device refuses the scene if not.
    pub fits: bool,
    /// What can happen at most.
    pub worst_case: Situation,
    /// What happens most of the time.
    pub typical: Vec<Situation>,
}

/// What the tick does in one situation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Situation {
    /// When that is.
    pub when: String,
    /// What it takes in all.
    pub instructions: u32,
    /// How that comes about.
    pub arithmetic: Vec<StageCost>,
}

/// One stage: base + count · each instructions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StageCost {
    /// What it is for.
    pub item: String,
    /// Instructions of the stage as such.
    pub base: u16,
    /// Instructions for each of what it counts.
    pub each: u16,
    /// How many those are.
    pub count: u16,
    /// Its sum.
    pub instructions: u32,
}

impl CostReport {
    /// That of `scene`, whose surfaces are called `names`, against `budget` instructions.
    ///
    /// # Errors
    /// What [`Scene::validate`] finds.
    pub fn new(
        scene: &Scene,
        names: &[String],
        library: &Library<'_>,
        budget: u32,
    ) -> Result<Self> {
        let worst = worst_case(scene, library)?;
        // The base of the sample's path is there in silence, too; it comes first.
        let silence = &worst.terms()[..1];
        let mut typical = vec![Situation::new("no contact, all rung out", silence, names)];
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
            budget_instructions: budget,
            fits: worst.instructions() <= budget,
            worst_case: Situation::new("worst case", worst.terms(), names),
            typical,
        })
    }
}

impl Situation {
    fn new(when: &str, terms: &[Term], names: &[String]) -> Self {
        let arithmetic: Vec<StageCost> = terms
            .iter()
            .map(|&term| StageCost::new(term, names))
            .collect();
        Self {
            when: when.to_owned(),
            instructions: arithmetic.iter().map(|line| line.instructions).sum(),
            arithmetic,
        }
    }

    /// The arithmetic in one line.
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
                Item::Voice { surface, structure } => format!("{}, {structure}", named(surface)),
                Item::StickSlip { surface } => format!("{}, stick-slip", named(surface)),
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
    let plan = Plan::new(scene, library)
        .map_err(|error| Error::Request(format!("scene '{}': {error}", scene.name)))?;
    Ok(plan.worst_case())
}

/// The stages while the tool is on `surface`, which is number `index` of `scene`: those of a scene of it alone, but for the
/// fade, which is only there while scenes are exchanged.
fn terms_on(
    scene: &Scene,
    surface: Surface,
    index: usize,
    taps: bool,
    library: &Library<'_>,
) -> Result<Vec<Term>> {
    let mut alone = Scene::of_surface(scene.name.clone(), scene.sample_rate_hz, surface);
    alone.equaliser.clone_from(&scene.equaliser);
    let cost = worst_case(&alone, library)?;
    let terms = cost.terms().iter().copied();
    let here = |mut term: Term| {
        // Of a scene of one surface, that is number 0.
        if let Item::Voice { surface, .. } | Item::StickSlip { surface } = &mut term.item {
            *surface = index as u8;
        }
        term
    };
    Ok(terms
        .filter(|term| term.item != Item::FadeOut && (taps || term.item != Item::Tap))
        .map(here)
        .collect())
}
