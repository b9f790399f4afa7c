//! The expected level of a playback, computed from the file of the active library.

use std::path::{Path, PathBuf};

use model_format::Provenance;
use model_format::link::{LIBRARY_CRC, PlayRequest, Selection, Status};
use serde::Serialize;
use stylus_dsp::sums::rms;
use stylus_evaluation::evaluate::texture_named;
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::render;
use stylus_support::{Error, Result};

use crate::cli::input::warn_of_unknown_levels;

/// Shortest and longest duration that is rendered, s.
const RENDERED_S: [f64; 2] = [0.1, 60.0];

/// Level of the signal that a device plays.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Level {
    /// RMS, m/s².
    pub rms_m_s2: f64,
    /// Largest magnitude, m/s².
    pub peak_m_s2: f64,
}

/// The file of the active library.
pub struct LibraryFile {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl LibraryFile {
    /// Reads the library at `path`, which must be the device's active one according to `status`.
    pub fn read(path: &Path, status: &Status) -> Result<Self> {
        let bytes = read_library(path)?;
        decode_library(path, &bytes)?;
        if status.active.is_none() || LIBRARY_CRC.checksum(&bytes) != status.library_crc32 {
            let problem = "not the device's active library: give that one's file, or run `stylus upload` with \
                           --activate";
            return Err(Error::file(path, problem));
        }
        Ok(Self {
            path: path.to_owned(),
            bytes,
        })
    }

    /// Computes the level of `request` along `motion` for `seconds`, but for one minute at most; `None` for a scene,
    /// and for a texture whose level is not known, of which it warns.
    pub fn level(&self, request: &PlayRequest, motion: &MotionPath, seconds: f64) -> Result<Option<Level>> {
        let Selection::Texture(name) = &request.selection else {
            return Ok(None);
        };
        let library = decode_library(&self.path, &self.bytes)?;
        let texture = texture_named(&library, name)?;
        if texture.provenance() == Provenance::Unscaled {
            warn_of_unknown_levels([texture]);
            return Ok(None);
        }
        let rendered = render(
            texture,
            motion,
            // A play may have lasted for hours, or for no time at all, which has no level.
            seconds.clamp(RENDERED_S[0], RENDERED_S[1]),
            request.seed,
        )?;
        let gain = f64::from(request.gain);
        let samples = rendered.accelerations_m_s2();
        let magnitudes = samples.iter().map(|sample| sample.abs());
        Ok(Some(Level {
            rms_m_s2: gain * rms(&samples),
            peak_m_s2: gain * magnitudes.fold(0.0, f64::max),
        }))
    }
}
