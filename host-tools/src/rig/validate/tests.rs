//! Checks of rig files: values in and out of range.

use std::fmt::Write as _;
use std::path::Path;

use super::*;
use crate::rig::RigFile;
use crate::support::error::Result;

/// A rig file with every section; the tests break one line each.
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

/// The number of the line of [`WHOLE`] that starts with `start`.
fn line_of_start(start: &str) -> usize {
    1 + WHOLE
        .lines()
        .position(|line| line.trim_start().starts_with(start))
        .unwrap()
}

#[test]
fn a_whole_scene_is_read_with_its_defaults() {
    let description = read(WHOLE).unwrap();
    assert_eq!(description.textures.len(), 2);
    let range_m_s2 = description.measurement.clipping.unwrap().range_m_s2();
    assert!((range_m_s2 - 49.033_25).abs() < 1e-12);
    assert_eq!(description.textures[0].roughness, None);
}

/// A line of the rig file, the value or the line that takes its place, and the field that the error must name.
const OUT_OF_RANGE: &[(&str, &str, &str)] = &[
    ("name = \"test\"", "\"\"", "name"),
    ("sample_rate_hz = 5000", "50", "recording.sample_rate_hz"),
    ("sample_rate_hz = 5000", "50000", "recording.sample_rate_hz"),
    ("duration_s = 0.5", "0.0", "recording.duration_s"),
    ("duration_s = 0.5", "nan", "recording.duration_s"),
    ("duration_s = 0.5", "1e-5", "recording.duration_s"),
    ("40,", "20,", "recording.speeds_mm_s[2]"),
    ("40,", "nan,", "recording.speeds_mm_s[2]"),
    (
        "wander = { rms = 0.01, correlation_s = 0.5 }",
        "{ rms = 0.2, correlation_s = 0.5 }",
        "drum.wander.rms",
    ),
    (
        "wander = { rms = 0.01, correlation_s = 0.5 }",
        "{ rms = 0.01, correlation_s = 0.0 }",
        "drum.wander.correlation_s",
    ),
    ("forces_n = [0.0, 1.0]", "[]", "recording.forces_n"),
    (
        "forces_n = [0.0, 1.0]",
        "[-1.0, 1.0]",
        "recording.forces_n[1]",
    ),
    (
        "forces_n = [0.0, 1.0]",
        "[1.0, 0.5]",
        "recording.forces_n[2]",
    ),
    (
        "circumference_mm = 300.0",
        "-300.0",
        "drum.circumference_mm",
    ),
    ("tip_radius_mm = 1.5", "0", "tool.tip_radius_mm"),
    ("frequency_hz = 100.0", "0.0", "tool.mode[1].frequency_hz"),
    ("damping_ratio = 0.1", "0.0", "tool.mode[1].damping_ratio"),
    (
        "participation_m_s2_per_n = [1.0, 2.0, 3.0]",
        "[1.0, nan, 3.0]",
        "tool.mode[1].participation_m_s2_per_n[2]",
    ),
    (
        "tip_participation_m_s2_per_n = 4.0",
        "-4.0",
        "tool.mode[1].tip_participation_m_s2_per_n",
    ),
    ("name = \"denim\"", "\"a/b\"", "texture[2].name"),
    ("name = \"denim\"", "'a\\b'", "texture[2].name"),
    ("name = \"denim\"", "\"..\"", "texture[2].name"),
    ("name = \"denim\"", "\"#1\"", "texture[2].name"),
    ("name = \"denim\"", "\"Smooth\"", "texture[2].name"),
    ("name = \"denim\"", LONG_NAME, "texture[2].name"),
    (
        "effective_modulus_mpa = 500.0",
        "0.1",
        "texture[2].effective_modulus_mpa",
    ),
    ("loss_factor = 0.1", "-0.1", "texture[2].loss_factor"),
    (
        "wavelength_mm = 0.8",
        "400",
        "texture[2].weave[1].wavelength_mm",
    ),
    (
        "wavelength_mm = 0.8",
        "1e-4",
        "texture[2].weave[1].wavelength_mm",
    ),
    (
        "amplitude_um = 3.0",
        "-3.0",
        "texture[2].weave[1].amplitude_um",
    ),
    (
        "harmonics = [0.5, 0.2]",
        "[0.5, nan]",
        "texture[2].weave[1].harmonics[2]",
    ),
    (
        "jitter = { rms_rad = 0.1, correlation_mm = 2.0 }",
        "{ rms_rad = 0.1, correlation_mm = 0.0 }",
        "texture[2].weave[1].jitter.correlation_mm",
    ),
    ("rms_um = 1.0", "-1.0", "texture[2].roughness.rms_um"),
    ("hurst = 0.5", "1.5", "texture[2].roughness.hurst"),
    (
        "roll_off_mm = 1.0",
        "301.0",
        "texture[2].roughness.roll_off_mm",
    ),
    (
        "shortest_mm = 0.1",
        "1.1",
        "texture[2].roughness.shortest_mm",
    ),
    (
        "shortest_mm = 0.1",
        "1e-4",
        "texture[2].roughness.shortest_mm",
    ),
    ("highest_hz = 12.0", "7.0", "measurement.tremor.highest_hz"),
    (
        "frequency_hz = 50.0",
        "2501",
        "measurement.hum.frequency_hz",
    ),
    (
        "value_m_s2 = [0.1, 0.1, 0.1]",
        "[0.1, 0.1, inf]",
        "measurement.offset.value_m_s2[3]",
    ),
    (
        "[measurement.clipping]",
        "[measurement]\nclipping.range_g = 0",
        "measurement.clipping",
    ),
];

const LONG_NAME: &str = "\"a name that is longer than the 48 bytes a name may have\"";

#[test]
fn a_value_out_of_its_range_is_an_error_that_names_line_and_field() {
    let many_harmonics = format!("{:?}", [0.1; 65]);
    let too_many = (
        "harmonics = [0.5, 0.2]",
        many_harmonics.as_str(),
        "texture[2].weave[1].harmonics",
    );
    for (good, bad, field) in OUT_OF_RANGE.iter().copied().chain([too_many]) {
        let bad = match good.split_once(" = ") {
            Some((key, _)) => format!("{key} = {bad}"),
            None => bad.to_owned(),
        };
        let text = WHOLE.replacen(good, &bad, 1);
        assert_ne!(text, WHOLE, "{good}");
        let message = read(&text).expect_err(&bad).to_string();
        let extra = bad.lines().count() - 1;
        let line = line_of_start(good.trim_start()) + extra;
        let start = format!("my.toml, line {line}: {field}");
        assert!(message.starts_with(&start), "{bad}: {message}, not {start}");
    }
}

#[test]
fn text_that_does_not_fit_the_schema_is_an_error_that_names_the_line() {
    for (good, bad, named) in [
        ("hurst = 0.5", "hurts = 0.5", "hurts"),
        ("hurst = 0.5", "hurst = \"rough\"", "rough"),
        ("hurst = 0.5", "hurst 0.5", ""),
        ("sample_rate_hz = 5000", "sample_rate_hz = 5000.5", "5000.5"),
        ("rms_um = 1.0", "rms_um = 1.0 mm", ""),
        (
            "participation_m_s2_per_n = [1.0, 2.0, 3.0]",
            "participation_m_s2_per_n = [1.0, 2.0]",
            "length",
        ),
    ] {
        let message = read(&WHOLE.replacen(good, bad, 1))
            .expect_err(bad)
            .to_string();
        let start = format!("my.toml, line {}: ", line_of_start(good));
        assert!(
            message.starts_with(&start) && message.contains(named),
            "{message}"
        );
        assert!(!message.contains('\n'), "{message}");
    }
    let missing = read(&WHOLE.replacen("hurst = 0.5", "", 1))
        .unwrap_err()
        .to_string();
    let start = format!("my.toml, line {}: ", line_of_start("[texture.roughness]"));
    assert!(
        missing.starts_with(&start) && missing.contains("hurst"),
        "{missing}"
    );
}

#[test]
fn lists_that_are_too_long_or_empty_are_refused() {
    let list = |count: u32| format!("{:?}", (1..=count).collect::<Vec<_>>());
    for (count, fits) in [(1, true), (64, true), (65, false)] {
        let text = WHOLE.replacen("[0.0, 1.0]", &list(count), 1);
        // The contact grows with force; keep it within the tip.
        let text = text.replace("effective_modulus_mpa = ", "effective_modulus_mpa = 9");
        assert_eq!(read(&text).is_ok(), fits, "{count}");
    }
    let (head, _) = WHOLE.split_once("[[texture]]").unwrap();
    let head_alone = head.replacen("[recording]", "texture = []\n\n[recording]", 1);
    let message = read(&head_alone).unwrap_err().to_string();
    assert!(
        message.contains("line 3: texture: must have 1 to 256"),
        "{message}"
    );
    let mut many = head.to_owned();
    for i in 0..257 {
        write!(
            many,
            "[[texture]]
name = \"t{i}\"
effective_modulus_mpa = 500.0
"
        )
        .unwrap();
    }
    let message = read(&many).unwrap_err().to_string();
    assert!(
        message.contains("texture: must have 1 to 256 entries, but has 257"),
        "{message}"
    );
}

#[test]
fn a_profile_without_a_tool_is_refused_and_a_flat_texture_is_not() {
    let (before, after) = WHOLE.split_once("[tool]").unwrap();
    let (_, after) = after.split_once("[[texture]]").unwrap();
    let message = read(&format!("{before}[[texture]]{after}"))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("texture[2]") && message.contains("[tool]"),
        "{message}"
    );
    let (flat, _) = after.split_once("[[texture]]").unwrap();
    read(&format!("{before}[[texture]]{flat}")).unwrap();
}
