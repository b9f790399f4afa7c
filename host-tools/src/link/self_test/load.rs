//! Load of the kernel during the traffic: a texture that is played with a gain of zero, so that the output stays at
//! mid-scale.

use model_format::link::{MotionSource, PlayRequest, Selection};

use super::line::Line;
use crate::link::device::Device;
use crate::link::error::{LinkError, Result};

/// The load that a device carries.
pub(super) enum Load {
    /// A texture of this name.
    Texture(String),
    /// None, for this reason.
    None(String),
}

/// Plays the first texture of the active library silently.
///
/// # Errors
/// A lost link or a missing answer. A refusal is no error.
pub(super) fn begin(device: &Device) -> Result<Load> {
    let Some(slot) = device.slots()?.active else {
        return Ok(Load::None(
            "upload and activate a library to load the kernel".to_owned(),
        ));
    };
    let Some(texture) = device.textures(slot)?.into_iter().next() else {
        return Ok(Load::None("the active library has no texture".to_owned()));
    };
    let request = PlayRequest {
        selection: Selection::Texture(texture.name.clone()),
        gain: 0.0,
        motion: MotionSource::Host,
        seed: 1,
    };
    match device.play(&request) {
        Ok(_) => Ok(Load::Texture(texture.name.as_str().to_owned())),
        Err(LinkError::Play(refusal)) => Ok(Load::None(refusal.to_string())),
        Err(failure) => Err(failure),
    }
}

/// Stops what [`begin`] plays.
///
/// # Errors
/// A lost link, or an output that does not come to rest.
pub(super) fn end(device: &Device, load: &Load) -> Result<()> {
    if let Load::Texture(_) = load {
        device.stop()?;
    }
    Ok(())
}

impl Load {
    /// The line that tells the load.
    pub(super) fn line(&self, link: &str) -> Line {
        let name = format!("{link}: kernel loaded");
        match self {
            Self::Texture(texture) => {
                Line::exact(name, format!("by {texture}"), "a texture", true, "")
            }
            Self::None(why) => Line::not_measured(name, why),
        }
    }
}
