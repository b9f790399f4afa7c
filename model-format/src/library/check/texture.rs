//! Check of a texture's header and axes, and of the lengths of its strings.

use crate::error::{DecodeError, Place, Problem};
use crate::library::axis::Axis;
use crate::library::texture::Texture;
use crate::limits;
use crate::wire::NodeRecord;

/// Checks all of texture number `index` of a library except its nodes.
///
/// # Errors
/// The first fault found, with its place.
pub(in crate::library) fn check_header(
    texture: &Texture<'_>,
    index: usize,
) -> Result<(), DecodeError> {
    let here = |problem: Problem| problem.at(Place::Texture(index));
    if texture.name.is_empty() || texture.name.len() > limits::MAX_NAME_BYTES {
        return Err(here(Problem::NameLength(texture.name.len())));
    }
    if texture.name.chars().any(char::is_control) {
        return Err(here(Problem::NameCharacter));
    }
    if texture.sample_rate_hz == 0 || texture.sample_rate_hz > limits::MAX_SAMPLE_RATE_HZ {
        return Err(here(Problem::SampleRate(texture.sample_rate_hz)));
    }
    check_axis(texture.speed_axis, Place::SpeedAxis(index))?;
    check_axis(texture.force_axis, Place::ForceAxis(index))?;
    whole_records(texture.nodes, NodeRecord::BYTES).map_err(here)?;
    // A tail may have an odd number of bytes.
    if !texture.has_tails() {
        whole_records(texture.coefficients, 2).map_err(here)?;
    }
    let (found, expected) = (
        texture.nodes.len() / NodeRecord::BYTES,
        texture.speed_axis.len() * texture.force_axis.len(),
    );
    if found != expected {
        return Err(here(Problem::NodeCount { found, expected }));
    }
    texture.parts.check(expected).map_err(here)
}

fn check_axis(axis: Axis<'_>, place: Place) -> Result<(), DecodeError> {
    whole_records(axis.0, Axis::VALUE_BYTES).map_err(|problem| problem.at(place))?;
    if axis.len() == 0 || axis.len() > limits::MAX_AXIS_LEN {
        return Err(Problem::AxisLength(axis.len()).at(place));
    }
    let mut before = None;
    for (index, value) in axis.values().enumerate() {
        if !value.is_finite() || value.is_sign_negative() {
            return Err(Problem::AxisValue { index, value }.at(place));
        }
        if before.is_some_and(|before| value <= before) {
            return Err(Problem::AxisOrder { index }.at(place));
        }
        before = Some(value);
    }
    Ok(())
}

fn whole_records(bytes: &[u8], record: usize) -> Result<(), Problem> {
    let found = bytes.len();
    if found.is_multiple_of(record) {
        Ok(())
    } else {
        Err(Problem::Ragged { found, record })
    }
}
