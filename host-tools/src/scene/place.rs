//! The place in a scene's text of an error in its wire form.

use model_format::scene::{SceneError, ScenePlace, SceneProblem};

use crate::support::toml_field::Field;

/// Returns the key that holds the value of `error`; `region` gives the place in the text of a region of the scene.
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
