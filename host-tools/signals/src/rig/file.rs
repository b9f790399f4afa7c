//! A rig file: its text, and its description after checks. Errors of the checks name the field.

use std::path::Path;

use model_format::limits::{MAX_AXIS_LEN, MAX_SAMPLE_RATE_HZ, MAX_TEXTURES};
use stylus_support::Result;
use stylus_support::toml_field::{Checked, Field, from_toml};

use super::contact::Contact;
use super::profile::{highest_roughness_term, highest_weave_term};
use super::{Measurement, Recording, RigDescription, Roughness, Texture, Weave};

/// Name of the copy of the rig file in a set.
pub(super) const RIG: &str = "rig.toml";

/// A rig file that was read and checked. It can only be created from its text, which it keeps.
#[derive(Debug, Clone, PartialEq)]
pub struct RigFile {
    description: RigDescription,
    text: String,
}

impl RigFile {
    /// Reads a rig from TOML `text`; `path` is used only in errors.
    ///
    /// # Errors
    /// [`Error::Line`](stylus_support::Error::Line), with the line and the field: text that is not TOML, a field
    /// that is unknown, missing, or of the wrong type, or a value outside its range.
    pub fn from_toml(path: &Path, text: &str) -> Result<Self> {
        let description: RigDescription = from_toml(path, text)?;
        check(&description).map_err(|fault| fault.field.error(path, text, fault.problem))?;
        Ok(Self {
            description,
            text: text.to_owned(),
        })
    }

    /// Returns the rig of the paper's protocol, 15 speeds by 8 forces by 4 textures, with surfaces and a tool that were
    /// chosen for this project.
    pub fn paper() -> Self {
        Self::from_toml(Path::new("rigs/paper-rig.toml"), PAPER_RIG)
            .expect("the rig file that comes with the program is sound; a test reads it")
    }

    /// Returns the rig of the demo. It has the paper's textures paper, vinyl and denim, and a plate with scratches.
    pub fn demo() -> Self {
        Self::from_toml(Path::new("rigs/demo-rig.toml"), DEMO_RIG)
            .expect("the rig file that comes with the program is sound; a test reads it")
    }

    /// The content of the file.
    pub fn description(&self) -> &RigDescription {
        &self.description
    }

    /// The text from which the rig was read, including comments.
    pub fn text(&self) -> &str {
        &self.text
    }
}

const PAPER_RIG: &str = include_str!("../../../examples/rigs/paper-rig.toml");
const DEMO_RIG: &str = include_str!("../../../examples/rigs/demo-rig.toml");

/// Longest trial, s.
const MAX_DURATION_S: f64 = 600.0;
/// Largest number of weaves of a texture, harmonics of a weave, or modes of a tool.
const MAX_PARTS: usize = 64;
/// Largest number of periods of a profile's shortest wave on the drum. Their terms take 16 MiB.
const MAX_TERMS: f64 = 1_048_576.0;

/// Requires that the value of a key is above zero and at most `high`; NaN is refused.
fn positive(field: &Field, key: &'static str, value: f64, high: f64) -> Checked {
    field.key(key).over(value, 0.0, high)
}

/// Requires that each value of a key is from `low` to `high`; NaN is refused.
fn each(field: &Field, key: &'static str, values: &[f64], [low, high]: [f64; 2]) -> Checked {
    field.key(key).each_within(values, low, high)
}

/// Checks every value of `rig`, and that the values are compatible.
///
/// # Errors
/// The first fault, with its field.
fn check(rig: &RigDescription) -> Checked {
    let root = Field::default();
    root.key("name").name(&rig.name)?;
    check_recording(&root.key("recording"), &rig.recording)?;
    let (drum, circumference_mm) = (root.key("drum"), rig.drum.circumference_mm);
    positive(&drum, "circumference_mm", circumference_mm, 10_000.0)?;
    if let Some(wander) = &rig.drum.wander {
        let field = drum.key("wander");
        field.key("rms").within(wander.rms, 0.0, 0.1)?;
        positive(&field, "correlation_s", wander.correlation_s, 100.0)?;
    }
    if let Some(tool) = &rig.tool {
        let field = root.key("tool");
        positive(&field, "tip_radius_mm", tool.tip_radius_mm, 100.0)?;
        let modes = field.key("mode");
        modes.count(tool.modes.len(), 1, MAX_PARTS)?;
        for (index, mode) in tool.modes.iter().enumerate() {
            let field = modes.item(index);
            positive(&field, "frequency_hz", mode.frequency_hz, 1e6)?;
            positive(&field, "damping_ratio", mode.damping_ratio, 10.0)?;
            let participation = &mode.participation_m_s2_per_n;
            each(&field, "participation_m_s2_per_n", participation, [-1e6, 1e6])?;
            let tip = mode.tip_participation_m_s2_per_n.unwrap_or(0.0);
            field.key("tip_participation_m_s2_per_n").within(tip, 0.0, 1e6)?;
        }
    }
    let textures = root.key("texture");
    textures.count(rig.textures.len(), 1, MAX_TEXTURES)?;
    for (index, texture) in rig.textures.iter().enumerate() {
        let field = textures.item(index);
        check_texture(&field, texture, circumference_mm)?;
        check_contact(&field, texture, rig)?;
        // Some file systems do not distinguish upper and lower case.
        let name = texture.name.to_lowercase();
        let mut earlier = rig.textures[..index].iter();
        let is_new = earlier.all(|other| other.name.to_lowercase() != name);
        let problem = || format!("{:?} is the name of an earlier texture", texture.name);
        field.key("name").require(is_new, problem)?;
    }
    let nyquist_hz = f64::from(rig.recording.sample_rate_hz) / 2.0;
    check_measurement(&root.key("measurement"), &rig.measurement, nyquist_hz)
}

fn check_recording(field: &Field, recording: &Recording) -> Checked {
    let rate_hz = f64::from(recording.sample_rate_hz);
    field
        .key("sample_rate_hz")
        .within(rate_hz, 100.0, f64::from(MAX_SAMPLE_RATE_HZ))?;
    let duration = field.key("duration_s");
    // At least one sample.
    duration.within(recording.duration_s, 0.5 / rate_hz, MAX_DURATION_S)?;
    for (key, values, high) in [
        ("speeds_mm_s", &recording.speeds_mm_s, 10_000.0),
        ("forces_n", &recording.forces_n, 100.0),
    ] {
        let field = field.key(key);
        field.count(values.len(), 1, MAX_AXIS_LEN)?;
        field.each_within(values, 0.0, high)?;
        field.ascending(values)?;
    }
    // At rest, a sample would be no step along the track.
    let slowest = recording.speeds_mm_s[0];
    field.key("speeds_mm_s").item(0).over(slowest, 0.0, 10_000.0)
}

fn check_texture(field: &Field, texture: &Texture, circumference_mm: f64) -> Checked {
    field.key("name").name(&texture.name)?;
    let modulus = texture.effective_modulus_mpa;
    positive(field, "effective_modulus_mpa", modulus, 1e7)?;
    let loss_factor = texture.loss_factor.unwrap_or(0.0);
    field.key("loss_factor").within(loss_factor, 0.0, 10.0)?;
    let weaves = field.key("weave");
    weaves.count(texture.weaves.len(), 0, MAX_PARTS)?;
    for (index, weave) in texture.weaves.iter().enumerate() {
        check_weave(&weaves.item(index), weave, circumference_mm)?;
    }
    match &texture.roughness {
        Some(roughness) => check_roughness(&field.key("roughness"), roughness, circumference_mm),
        None => Ok(()),
    }
}

fn check_weave(field: &Field, weave: &Weave, circumference_mm: f64) -> Checked {
    let wavelength_mm = weave.wavelength_mm;
    positive(field, "wavelength_mm", wavelength_mm, circumference_mm)?;
    field.key("amplitude_um").within(weave.amplitude_um, 0.0, 1e4)?;
    field.key("harmonics").count(weave.harmonics.len(), 0, MAX_PARTS)?;
    each(field, "harmonics", &weave.harmonics, [-100.0, 100.0])?;
    if let Some(jitter) = &weave.jitter {
        let field = field.key("jitter");
        field.key("rms_rad").within(jitter.rms_rad, 0.0, 10.0)?;
        positive(&field, "correlation_mm", jitter.correlation_mm, circumference_mm)?;
    }
    let terms = highest_weave_term(weave, circumference_mm);
    check_fineness(&field.key("wavelength_mm"), terms, circumference_mm)
}

fn check_roughness(field: &Field, roughness: &Roughness, circumference_mm: f64) -> Checked {
    field.key("rms_um").within(roughness.rms_um, 0.0, 1e4)?;
    positive(field, "hurst", roughness.hurst, 1.0)?;
    let roll_off_mm = roughness.roll_off_mm;
    positive(field, "roll_off_mm", roll_off_mm, circumference_mm)?;
    positive(field, "shortest_mm", roughness.shortest_mm, roll_off_mm)?;
    let terms = highest_roughness_term(roughness, circumference_mm);
    check_fineness(&field.key("shortest_mm"), terms, circumference_mm)
}

fn check_fineness(field: &Field, terms: f64, circumference_mm: f64) -> Checked {
    let problem = || format!("is too fine for a drum of {circumference_mm} mm");
    field.require(terms <= MAX_TERMS, problem)
}

/// Checks that there is a tool if the texture has a profile, and that the Hertz contact stays smaller than the tip.
fn check_contact(field: &Field, texture: &Texture, rig: &RigDescription) -> Checked {
    let Some(tool) = &rig.tool else {
        return field.require(!texture.has_profile(), || {
            "has a profile, and the rig has no [tool] to feel it; add [tool] with a [[tool.mode]]".into()
        });
    };
    let modulus = texture.effective_modulus_mpa;
    // The largest force makes the widest contact.
    let largest_n = rig.recording.forces_n.last().copied().unwrap_or(0.0);
    let contact = Contact::hertz(tool.tip_radius_mm, modulus, largest_n);
    let radius_mm = contact.map_or(0.0, |contact| contact.radius_mm());
    field.key("effective_modulus_mpa").require(radius_mm < tool.tip_radius_mm, || {
        format!(
            "is {modulus}, too soft for {largest_n} N: the contact would have a radius of {radius_mm:.3} mm, and the \
             tip has {} mm",
            tool.tip_radius_mm
        )
    })
}

fn check_measurement(field: &Field, measurement: &Measurement, nyquist_hz: f64) -> Checked {
    const ANY: [f64; 2] = [-1e6, 1e6];
    const LEVEL: [f64; 2] = [0.0, 1e6];
    if let Some(tremor) = &measurement.tremor {
        let field = field.key("tremor");
        positive(&field, "lowest_hz", tremor.lowest_hz, nyquist_hz)?;
        field
            .key("highest_hz")
            .within(tremor.highest_hz, tremor.lowest_hz, nyquist_hz)?;
        each(&field, "rms_m_s2", &tremor.rms_m_s2, LEVEL)?;
    }
    if let Some(hum) = &measurement.hum {
        let field = field.key("hum");
        positive(&field, "frequency_hz", hum.frequency_hz, nyquist_hz)?;
        each(&field, "amplitude_m_s2", &hum.amplitude_m_s2, ANY)?;
    }
    if let Some(offset) = &measurement.offset {
        each(&field.key("offset"), "value_m_s2", &offset.value_m_s2, ANY)?;
    }
    if let Some(noise) = &measurement.noise {
        each(&field.key("noise"), "rms_m_s2", &noise.rms_m_s2, LEVEL)?;
    }
    match &measurement.clipping {
        Some(clipping) => positive(&field.key("clipping"), "range_g", clipping.range_g, 1e5),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
