//! The content of each table.

use std::fmt::Write;

use model_format::limits;
use model_format::link::{Setting, SettingSet};
use model_format::scene::limits as scene_limits;
use stylus_kernel::scene::cost::{self, StageCost};

use crate::firmware::Memory;

/// Every setting of the device with its unit, range, default and meaning.
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
            setting.meaning().to_owned(),
        ]
    };
    let header = ["setting", "unit", "lowest", "highest", "default", "what it is"];
    table(header, Setting::ALL.into_iter().map(row))
}

/// Instructions of a scene's stages per sample, and the budget per tick for all stages together.
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
        ("lines tied to position", cost::LINES, "line"),
        ("tap, while it rings", cost::TAP, ""),
        ("equaliser", cost::EQUALISER, "section"),
        ("fade while scenes are exchanged", cost::FADE_OUT, ""),
    ];
    let terms = rows.map(|(name, cost, each)| [name.to_owned(), term(cost, each)]);
    let budget = ["budget per tick".to_owned(), grouped(cost::BUDGET.into())];
    table(["stage", "instructions per sample"], terms.into_iter().chain([budget]))
}

fn term(cost: StageCost, each: &str) -> String {
    let StageCost { base, each: more } = cost;
    if more == 0 {
        base.to_string()
    } else {
        format!("{base} + {more} per {each}")
    }
}

/// Limits that every library observes.
pub fn library_limits() -> String {
    let whole = |value: usize| grouped(value as u64);
    let rows = [
        ("bytes of a library", whole(limits::MAX_LIBRARY_BYTES)),
        ("textures", whole(limits::MAX_TEXTURES)),
        ("scenes", whole(scene_limits::MAX_SCENES)),
        ("bytes of a name, UTF-8", whole(limits::MAX_NAME_BYTES)),
        ("speeds, and forces, of a grid", whole(limits::MAX_AXIS_LEN)),
        ("order of a model", whole(limits::MAX_ORDER)),
        ("stages of a lattice with 24 bits of θ", whole(limits::MAX_FINE_STAGES)),
        ("sample rate, Hz", grouped(limits::MAX_SAMPLE_RATE_HZ.into())),
        ("output power of a node, (m/s²)²", limits::MAX_OUTPUT_POWER.to_string()),
    ];
    most(rows)
}

/// Limits that every scene observes.
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
        ("transition, mm", scene_limits::MAX_TRANSITION_MM.to_string()),
        ("gain of a texture", scene_limits::MAX_GAIN.to_string()),
        ("constant speed, mm/s", scene_limits::MAX_SPEED_MM_S.to_string()),
        ("constant force, N", scene_limits::MAX_FORCE_N.to_string()),
        ("frequency of a tap", tap_hz),
        ("decay of a tap, s", between(scene_limits::TAP_DECAY_S)),
        ("gain of a tap, m/s² per N/s", scene_limits::MAX_TAP_GAIN.to_string()),
        ("amplitude of a tap, m/s²", scene_limits::MAX_TAP_M_S2.to_string()),
        ("period of stick-slip, mm", between(scene_limits::STICK_SLIP_PERIOD_MM)),
        ("duty of stick-slip", between(scene_limits::STICK_SLIP_DUTY)),
        ("sections of an equaliser", whole(scene_limits::MAX_SECTIONS)),
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

/// The used bytes of each memory. `compiler` is the version of the compiler, without its name.
pub fn memory(memory: &Memory, compiler: &str) -> String {
    let rows = memory
        .uses()
        .iter()
        .map(|memory| [memory.name.to_owned(), grouped(memory.used), grouped(memory.size)]);
    format!(
        "{}\nBuilt by rustc {compiler}.\n",
        table(["memory", "used, bytes", "of"], rows)
    )
}

/// Returns a table with `header` and `rows`. No cell may contain a vertical bar.
pub fn table<const COLUMNS: usize>(
    header: [&str; COLUMNS],
    rows: impl IntoIterator<Item = [String; COLUMNS]>,
) -> String {
    let mut text = format!("| {} |\n|{}\n", header.join(" | "), "---|".repeat(COLUMNS));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text
}

/// Formats `number` with a space before every three digits from the right, if it has at least five digits.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    if digits.len() < 5 {
        return digits;
    }
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_from_five_on() {
        for (number, text) in [(0, "0"), (4530, "4530"), (41_285, "41 285"), (1_000_000, "1 000 000")] {
            assert_eq!(grouped(number), text);
        }
    }

    #[test]
    fn a_table_has_a_header_a_rule_and_its_rows() {
        let rows = [["a".to_owned(), "1".to_owned()]];
        assert_eq!(table(["x", "y"], rows), "| x | y |\n|---|---|\n| a | 1 |\n");
    }
}
