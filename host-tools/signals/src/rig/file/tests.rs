//! Checks of rig files: values in and out of range.

use super::*;
use test_helpers::{holds, near};

/// A rig file with every section. Each test changes one line.
const WHOLE: &str = r#"name = "test"

[recording]
sample_rate_hz = 5000
duration_s = 0.5
speeds_mm_s = [
    20,
    40,
]
forces_n = [0.0, 1.0]

[drum]
circumference_mm = 300.0
wander = { rms = 0.01, correlation_s = 0.5 }

[tool]
tip_radius_mm = 1.5

[[tool.mode]]
frequency_hz = 100.0
damping_ratio = 0.1
participation_m_s2_per_n = [1.0, 2.0, 3.0]
tip_participation_m_s2_per_n = 4.0

[[texture]]
name = "smooth"
effective_modulus_mpa = 1000.0

[[texture]]
name = "denim"
effective_modulus_mpa = 500.0
loss_factor = 0.1

[[texture.weave]]
wavelength_mm = 0.8
amplitude_um = 3.0
harmonics = [0.5, 0.2]
jitter = { rms_rad = 0.1, correlation_mm = 2.0 }

[texture.roughness]
rms_um = 1.0
hurst = 0.5
roll_off_mm = 1.0
shortest_mm = 0.1

[measurement.tremor]
lowest_hz = 8.0
highest_hz = 12.0
rms_m_s2 = [0.1, 0.1, 0.1]

[measurement.hum]
frequency_hz = 50.0
amplitude_m_s2 = [0.1, 0.1, 0.1]

[measurement.offset]
value_m_s2 = [0.1, 0.1, 0.1]

[measurement.noise]
rms_m_s2 = [0.1, 0.1, 0.1]

[measurement.clipping]
"#;

fn read(text: &str) -> Result<RigDescription> {
    RigFile::from_toml(Path::new("my.toml"), text).map(|rig| rig.description().clone())
}

/// The start of an error about the line of [`WHOLE`] that begins with `start`.
fn at_line(start: &str) -> String {
    let mut lines = WHOLE.lines();
    let line = lines.position(|line| line.trim_start().starts_with(start));
    format!("my.toml, line {}: ", 1 + line.unwrap())
}

#[test]
fn a_whole_rig_is_read_with_its_defaults() {
    let description = read(WHOLE).unwrap();
    assert_eq!(description.textures.len(), 2);
    let range_m_s2 = description.measurement.clipping.unwrap().range_m_s2();
    near(range_m_s2, 49.033_25, 1e-12);
    assert_eq!(description.textures[0].roughness, None);
}

/// A line, and the field that the error must name; each check occurs once. The line replaces the last line with its
/// key, or the first line for a key outside all tables.
const OUT_OF_RANGE: &[(&str, &str)] = &[
    ("name = \"\"", "name"),
    ("sample_rate_hz = 50000", "recording.sample_rate_hz"),
    ("duration_s = nan", "recording.duration_s"),
    ("duration_s = 1e-5", "recording.duration_s"),
    ("forces_n = []", "recording.forces_n"),
    ("forces_n = [-1.0, 1.0]", "recording.forces_n[1]"),
    ("forces_n = [1.0, 0.5]", "recording.forces_n[2]"),
    ("circumference_mm = -300.0", "drum.circumference_mm"),
    ("tip_radius_mm = 0", "tool.tip_radius_mm"),
    ("damping_ratio = 0.0", "tool.mode[1].damping_ratio"),
    ("name = \"a/b\"", "texture[2].name"),
    ("name = \"Smooth\"", "texture[2].name"),
    ("effective_modulus_mpa = 0.1", "texture[2].effective_modulus_mpa"),
    ("loss_factor = -0.1", "texture[2].loss_factor"),
    ("wavelength_mm = 400", "texture[2].weave[1].wavelength_mm"),
    ("wavelength_mm = 1e-4", "texture[2].weave[1].wavelength_mm"),
    ("harmonics = [0.5, nan]", "texture[2].weave[1].harmonics[2]"),
    ("hurst = 1.5", "texture[2].roughness.hurst"),
    ("shortest_mm = 1.1", "texture[2].roughness.shortest_mm"),
    ("shortest_mm = 1e-4", "texture[2].roughness.shortest_mm"),
    ("highest_hz = 7.0", "measurement.tremor.highest_hz"),
    ("frequency_hz = 2501", "measurement.hum.frequency_hz"),
];

#[test]
fn a_value_out_of_its_range_is_an_error_that_names_line_and_field() {
    for (bad, field) in OUT_OF_RANGE {
        let mut lines: Vec<&str> = WHOLE.lines().collect();
        let is_of_key = |line: &&str| line.split(" = ").next() == bad.split(" = ").next();
        let at = if field.contains('.') {
            lines.iter().rposition(is_of_key)
        } else {
            lines.iter().position(is_of_key)
        };
        let at = at.expect("the rig has every key");
        lines[at] = bad;
        let message = read(&lines.join("\n")).expect_err(bad).to_string();
        let start = format!("my.toml, line {}: {field}", at + 1);
        assert!(message.starts_with(&start), "{bad}: {message}, not {start}");
    }
    // A list that is too long, and an empty list where at least one value is required.
    let many = format!("forces_n = {:?}", (0..65).collect::<Vec<_>>());
    let message = read(&WHOLE.replacen("forces_n = [0.0, 1.0]", &many, 1)).unwrap_err();
    assert!(message.to_string().contains("1 to 64 entries, but has 65"), "{message}");
    let (head, _) = WHOLE.split_once("[[texture]]").unwrap();
    let message = read(&head.replacen("[recording]", "texture = []\n\n[recording]", 1)).unwrap_err();
    holds(&message, &["line 3: texture: must have 1 to 256"]);
}

#[test]
fn text_that_does_not_fit_the_schema_is_an_error_that_names_the_line() {
    for (good, bad, named) in [
        ("hurst = 0.5", "hurts = 0.5", "hurts"),
        ("hurst = 0.5", "hurst = \"rough\"", "rough"),
        ("hurst = 0.5", "hurst 0.5", ""),
        ("sample_rate_hz = 5000", "sample_rate_hz = 5000.5", "5000.5"),
    ] {
        let message = read(&WHOLE.replacen(good, bad, 1)).expect_err(bad).to_string();
        assert!(message.starts_with(&at_line(good)), "{message}");
        assert!(message.contains(named), "{message}");
        assert!(!message.contains('\n'), "{message}");
    }
    let missing = read(&WHOLE.replacen("hurst = 0.5", "", 1)).unwrap_err().to_string();
    let start = at_line("[texture.roughness]");
    assert!(missing.starts_with(&start), "{missing}");
    assert!(missing.contains("hurst"), "{missing}");
}

#[test]
fn a_profile_without_a_tool_is_refused_and_a_flat_texture_is_not() {
    let (before, after) = WHOLE.split_once("[tool]").unwrap();
    let (_, after) = after.split_once("[[texture]]").unwrap();
    let message = read(&format!("{before}[[texture]]{after}")).unwrap_err().to_string();
    holds(&message, &["texture[2]", "[tool]"]);
    let (flat, _) = after.split_once("[[texture]]").unwrap();
    read(&format!("{before}[[texture]]{flat}")).unwrap();
}
