//! The ranges of a rig's description, and faults that name the field.

use super::contact::Contact;
use super::description::{
    Measurement, Mode, Recording, RigDescription, Roughness, Texture, Tool, Weave,
};
use super::profile::{highest_roughness_term, highest_weave_term};
use crate::support::toml_field::{Checked, Field};
use model_format::limits::{MAX_AXIS_LEN, MAX_SAMPLE_RATE_HZ, MAX_TEXTURES};

/// Longest trial, s.
const MAX_DURATION_S: f64 = 600.0;
/// Most weaves of a texture, harmonics of a weave, modes of a tool.
const MAX_PARTS: usize = 64;
/// Most periods of a profile's shortest wave on the drum; they take 16 MiB of terms.
const MAX_TERMS: f64 = 1_048_576.0;

/// Checks every value of `description`, and that they go together.
///
/// # Errors
/// The first fault, with its field.
pub(super) fn check(description: &RigDescription) -> Checked {
    let root = Field::default();
    root.key("name").name(&description.name)?;
    check_recording(&root.key("recording"), &description.recording)?;
    let circumference_mm = description.drum.circumference_mm;
    root.key("drum")
        .key("circumference_mm")
        .over(circumference_mm, 0.0, 10_000.0)?;
    if let Some(wander) = &description.drum.wander {
        let field = root.key("drum").key("wander");
        field.key("rms").within(wander.rms, 0.0, 0.1)?;
        field
            .key("correlation_s")
            .within(wander.correlation_s, 0.01, 100.0)?;
    }
    if let Some(tool) = &description.tool {
        check_tool(&root.key("tool"), tool)?;
    }
    let textures = root.key("texture");
    textures.count(description.textures.len(), 1, MAX_TEXTURES)?;
    for (index, texture) in description.textures.iter().enumerate() {
        let field = textures.item(index);
        check_texture(&field, texture, circumference_mm)?;
        check_contact(&field, texture, description)?;
        // Some file systems do not distinguish upper and lower case.
        let name = texture.name.to_lowercase();
        let earlier = description.textures[..index]
            .iter()
            .any(|other| other.name.to_lowercase() == name);
        field.key("name").require(!earlier, || {
            format!("{:?} is the name of an earlier texture", texture.name)
        })?;
    }
    check_measurement(
        &root.key("measurement"),
        &description.measurement,
        f64::from(description.recording.sample_rate_hz) / 2.0,
    )
}

fn check_recording(field: &Field, recording: &Recording) -> Checked {
    field.key("sample_rate_hz").within(
        f64::from(recording.sample_rate_hz),
        100.0,
        f64::from(MAX_SAMPLE_RATE_HZ),
    )?;
    let duration = field.key("duration_s");
    duration.over(recording.duration_s, 0.0, MAX_DURATION_S)?;
    duration.require(recording.samples() >= 1, || {
        format!(
            "must be at least one sample, and is {} s",
            recording.duration_s
        )
    })?;

    let speeds = field.key("speeds_mm_s");
    speeds.count(recording.speeds_mm_s.len(), 1, MAX_AXIS_LEN)?;
    for (index, speed_mm_s) in recording.speeds_mm_s.iter().enumerate() {
        speeds.item(index).over(*speed_mm_s, 0.0, 10_000.0)?;
    }
    speeds.ascending(&recording.speeds_mm_s)?;

    let forces = field.key("forces_n");
    forces.count(recording.forces_n.len(), 1, MAX_AXIS_LEN)?;
    forces.each_within(&recording.forces_n, 0.0, 100.0)?;
    forces.ascending(&recording.forces_n)
}

fn check_tool(field: &Field, tool: &Tool) -> Checked {
    field
        .key("tip_radius_mm")
        .over(tool.tip_radius_mm, 0.0, 100.0)?;
    let modes = field.key("mode");
    modes.count(tool.modes.len(), 1, MAX_PARTS)?;
    for (index, mode) in tool.modes.iter().enumerate() {
        check_mode(&modes.item(index), mode)?;
    }
    Ok(())
}

fn check_mode(field: &Field, mode: &Mode) -> Checked {
    field
        .key("frequency_hz")
        .over(mode.frequency_hz, 0.0, 1e6)?;
    field
        .key("damping_ratio")
        .over(mode.damping_ratio, 0.0, 10.0)?;
    field
        .key("participation_m_s2_per_n")
        .each_within(&mode.participation_m_s2_per_n, -1e6, 1e6)?;
    match mode.tip_participation_m_s2_per_n {
        Some(participation) => {
            field
                .key("tip_participation_m_s2_per_n")
                .within(participation, 0.0, 1e6)
        }
        None => Ok(()),
    }
}

fn check_texture(field: &Field, texture: &Texture, circumference_mm: f64) -> Checked {
    field.key("name").name(&texture.name)?;
    field
        .key("effective_modulus_mpa")
        .over(texture.effective_modulus_mpa, 0.0, 1e7)?;
    if let Some(loss_factor) = texture.loss_factor {
        field.key("loss_factor").within(loss_factor, 0.0, 10.0)?;
    }
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
    let wavelength = field.key("wavelength_mm");
    wavelength.over(weave.wavelength_mm, 0.0, circumference_mm)?;
    field
        .key("amplitude_um")
        .within(weave.amplitude_um, 0.0, 1e4)?;
    let harmonics = field.key("harmonics");
    harmonics.count(weave.harmonics.len(), 0, MAX_PARTS)?;
    harmonics.each_within(&weave.harmonics, -100.0, 100.0)?;
    if let Some(jitter) = &weave.jitter {
        let field = field.key("jitter");
        field.key("rms_rad").within(jitter.rms_rad, 0.0, 10.0)?;
        field
            .key("correlation_mm")
            .over(jitter.correlation_mm, 0.0, circumference_mm)?;
    }
    wavelength.require(highest_weave_term(weave, circumference_mm) <= MAX_TERMS, || {
        format!(
            "{} mm, with its harmonics and jitter, is too fine for a drum of {circumference_mm} mm",
            weave.wavelength_mm
        )
    })
}

fn check_roughness(field: &Field, roughness: &Roughness, circumference_mm: f64) -> Checked {
    field.key("rms_um").within(roughness.rms_um, 0.0, 1e4)?;
    field.key("hurst").over(roughness.hurst, 0.0, 1.0)?;
    field
        .key("roll_off_mm")
        .over(roughness.roll_off_mm, 0.0, circumference_mm)?;
    let shortest = field.key("shortest_mm");
    shortest.over(roughness.shortest_mm, 0.0, roughness.roll_off_mm)?;
    shortest.require(
        highest_roughness_term(roughness, circumference_mm) <= MAX_TERMS,
        || {
            format!(
                "{} mm is too fine for a drum of {circumference_mm} mm",
                roughness.shortest_mm
            )
        },
    )
}

/// Checks that a profile has a tool to feel it, and that the Hertz contact stays smaller than the tip.
fn check_contact(field: &Field, texture: &Texture, description: &RigDescription) -> Checked {
    let Some(tool) = &description.tool else {
        return field.require(!texture.has_profile(), || {
            "has a profile, and the rig has no [tool] to feel it; add [tool] with a [[tool.mode]]"
                .into()
        });
    };
    let largest_n = description
        .recording
        .forces_n
        .last()
        .copied()
        .unwrap_or(0.0);
    let contact = Contact::hertz(tool.tip_radius_mm, texture.effective_modulus_mpa, largest_n);
    let radius_mm = contact.map_or(0.0, |contact| contact.radius_mm());
    field
        .key("effective_modulus_mpa")
        .require(radius_mm < tool.tip_radius_mm, || {
            format!(
                "is {}, too soft for {largest_n} N: the contact would have a radius of {radius_mm:.3} mm, and the tip \
                 has {} mm",
                texture.effective_modulus_mpa, tool.tip_radius_mm
            )
        })
}

fn check_measurement(field: &Field, measurement: &Measurement, nyquist_hz: f64) -> Checked {
    if let Some(tremor) = &measurement.tremor {
        let field = field.key("tremor");
        field
            .key("lowest_hz")
            .over(tremor.lowest_hz, 0.0, nyquist_hz)?;
        field
            .key("highest_hz")
            .within(tremor.highest_hz, tremor.lowest_hz, nyquist_hz)?;
        field
            .key("rms_m_s2")
            .each_within(&tremor.rms_m_s2, 0.0, 1e6)?;
    }
    if let Some(hum) = &measurement.hum {
        let field = field.key("hum");
        let frequency = field.key("frequency_hz");
        frequency.over(hum.frequency_hz, 0.0, nyquist_hz)?;
        field
            .key("amplitude_m_s2")
            .each_within(&hum.amplitude_m_s2, -1e6, 1e6)?;
    }
    if let Some(offset) = &measurement.offset {
        field
            .key("offset")
            .key("value_m_s2")
            .each_within(&offset.value_m_s2, -1e6, 1e6)?;
    }
    if let Some(noise) = &measurement.noise {
        field
            .key("noise")
            .key("rms_m_s2")
            .each_within(&noise.rms_m_s2, 0.0, 1e6)?;
    }
    if let Some(clipping) = &measurement.clipping {
        field
            .key("clipping")
            .key("range_g")
            .over(clipping.range_g, 0.0, 1e5)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
