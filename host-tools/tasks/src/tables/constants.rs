//! Tables of declared constants: settings, limits, terms of a scene's cost.

use model_format::limits;
use model_format::link::{Setting, SettingSet};
use model_format::scene::limits as scene_limits;
use stylus_kernel::scene::cost::{self, StageCost};

use super::markdown::{grouped, table};

/// Every setting of the device with its unit, range and default.
pub fn settings() -> String {
    let row = |setting: Setting| {
        let spec = setting.spec();
        let whole = if spec.whole { ", whole" } else { "" };
        let default = if SettingSet::REQUIRED.contains(setting) {
            "none".to_owned()
        } else {
            spec.default.to_string()
        };
        [
            format!("`{}`", spec.name),
            format!("{}{whole}", spec.unit),
            spec.lowest.to_string(),
            spec.highest.to_string(),
            default,
        ]
    };
    let header = ["setting", "unit", "lowest", "highest", "default"];
    table(header, Setting::ALL.into_iter().map(row))
}

/// Instructions per tick of a scene's stages, and the budget of all of them together.
pub fn scene_stages() -> String {
    let rows = [
        ("list of stages and mix", cost::MIX, ""),
        ("voice, normalised lattice", cost::LATTICE, "stage"),
        (
            "voice, normalised lattice with codebooks or a track",
            cost::FED_LATTICE,
            "stage",
        ),
        ("stick-slip", cost::STICK_SLIP, ""),
        ("lines that are locked to place", cost::LINES, "line"),
        ("tap, while it rings", cost::TAP, ""),
        ("equaliser", cost::EQUALISER, "section"),
        ("fade while scenes are exchanged", cost::FADE_OUT, ""),
    ];
    let terms = rows.map(|(name, cost, each)| [name.to_owned(), term(cost, each)]);
    let budget = ["budget of a scene".to_owned(), grouped(cost::BUDGET.into())];
    table(
        ["stage", "instructions per tick"],
        terms.into_iter().chain([budget]),
    )
}

fn term(cost: StageCost, each: &str) -> String {
    let StageCost { base, each: more } = cost;
    if more == 0 {
        base.to_string()
    } else {
        format!("{base} + {more} per {each}")
    }
}

/// Bounds that every library keeps.
pub fn library_limits() -> String {
    let whole = |value: usize| grouped(value as u64);
    let rows = [
        ("bytes of a library", whole(limits::MAX_LIBRARY_BYTES)),
        ("textures", whole(limits::MAX_TEXTURES)),
        ("scenes", whole(scene_limits::MAX_SCENES)),
        ("bytes of a name, UTF-8", whole(limits::MAX_NAME_BYTES)),
        ("speeds, and forces, of a grid", whole(limits::MAX_AXIS_LEN)),
        ("order of a model", whole(limits::MAX_ORDER)),
        (
            "stages of a lattice with 24 bits of θ",
            whole(limits::MAX_FINE_STAGES),
        ),
        (
            "sample rate, Hz",
            grouped(limits::MAX_SAMPLE_RATE_HZ.into()),
        ),
        (
            "output power of a node, (m/s²)²",
            limits::MAX_OUTPUT_POWER.to_string(),
        ),
    ];
    most(rows)
}

/// Bounds that every scene keeps.
pub fn scene_limits() -> String {
    let whole = |value: usize| grouped(value as u64);
    let between = |[least, most]: [f32; 2]| format!("{least} to {most}");
    let pole = format!("{} / 1024", scene_limits::MAX_POLE_RADIUS_1024THS);
    let tap_hz = format!(
        "{} Hz to {} of the sample rate",
        scene_limits::MIN_TAP_HZ,
        scene_limits::MAX_TAP_SHARE_OF_RATE
    );
    let rows = [
        ("surfaces", whole(scene_limits::MAX_SURFACES)),
        ("regions", whole(scene_limits::MAX_REGIONS)),
        (
            "position on the path, mm, to either side",
            scene_limits::MAX_POSITION_MM.to_string(),
        ),
        (
            "transition, mm",
            scene_limits::MAX_TRANSITION_MM.to_string(),
        ),
        ("gain of a texture", scene_limits::MAX_GAIN.to_string()),
        (
            "constant speed, mm/s",
            scene_limits::MAX_SPEED_MM_S.to_string(),
        ),
        ("constant force, N", scene_limits::MAX_FORCE_N.to_string()),
        ("frequency of a tap", tap_hz),
        ("decay of a tap, s", between(scene_limits::TAP_DECAY_S)),
        (
            "gain of a tap, m/s² per N/s",
            scene_limits::MAX_TAP_GAIN.to_string(),
        ),
        (
            "amplitude of a tap, m/s²",
            scene_limits::MAX_TAP_M_S2.to_string(),
        ),
        (
            "period of stick-slip, mm",
            between(scene_limits::STICK_SLIP_PERIOD_MM),
        ),
        ("duty of stick-slip", between(scene_limits::STICK_SLIP_DUTY)),
        (
            "sections of an equaliser",
            whole(scene_limits::MAX_SECTIONS),
        ),
        (
            "gain of an equaliser at any frequency",
            scene_limits::MAX_EQUALISER_GAIN.to_string(),
        ),
        ("pole radius of a section", pole),
    ];
    most(rows)
}

fn most<const ROWS: usize>(rows: [(&str, String); ROWS]) -> String {
    let rows = rows.map(|(name, value)| [name.to_owned(), value]);
    table(["quantity", "at most, or range"], rows)
}
