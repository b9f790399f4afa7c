//! The user's settings and libraries: saved before, restored after.
//!
//! A device does not give a library back, so what its slots hold is overwritten; a file of the user's can be uploaded
//! at the end.

use std::path::PathBuf;

use host_tools::link::upload::upload;
use model_format::link::{Setting, SettingChange, SettingSet, Settings, SlotState};

use crate::bench::Bench;
use crate::error::{Error, Result};

/// Largest power limit during the tests, W.
const MOST_POWER_W: f32 = 0.01;

/// State that the suite changes and puts back.
#[derive(Clone, Debug)]
pub struct Kept {
    settings: Settings,
    /// Those that somebody has set.
    set: SettingSet,
    library: Option<PathBuf>,
}

impl Kept {
    /// Saves the settings; `library` is the file to upload at the end.
    ///
    /// # Errors
    /// The link fails.
    pub fn save(bench: &Bench, library: Option<PathBuf>) -> Result<Self> {
        Ok(Self {
            settings: bench.device.settings()?,
            set: bench.status()?.settings.set,
            library,
        })
    }

    /// Sets the coil's settings, so that the device plays even if nobody has set them: as they are, with a power of at
    /// most `MOST_POWER_W`. [`Kept::restore`] takes that back.
    ///
    /// # Errors
    /// The link fails, or the device refuses a value.
    pub fn make_playable(&self, bench: &Bench) -> Result<()> {
        for setting in SettingSet::REQUIRED.iter() {
            let value = match setting {
                Setting::PowerLimit => self.settings.get(setting).min(MOST_POWER_W),
                _ => self.settings.get(setting),
            };
            bench.device.set(SettingChange { setting, value })?;
        }
        Ok(())
    }

    /// Silences the device, and puts back what was saved. Does all that is still possible after a failure.
    ///
    /// # Errors
    /// The first failure.
    pub fn restore(&self, bench: &mut Bench) -> Result<()> {
        if bench.device.status().is_err() {
            bench.device.reconnect()?;
        }
        let silent = silence(bench);
        let settings = self.restore_settings(bench);
        let library = self.restore_library(bench);
        silent.and(settings).and(library)
    }

    fn restore_settings(&self, bench: &Bench) -> Result<()> {
        // What nobody has set stays so, because a device with guessed settings of its coil must refuse to play.
        bench.device.reset_settings()?;
        for setting in self.set.iter() {
            let value = self.settings.get(setting);
            bench.device.set(SettingChange { setting, value })?;
        }
        Ok(())
    }

    fn restore_library(&self, bench: &mut Bench) -> Result<()> {
        let Some(path) = &self.library else {
            return Ok(());
        };
        let bytes = std::fs::read(path).map_err(|source| Error::File {
            path: path.clone(),
            source,
        })?;
        let uploaded = upload(&mut bench.device, &bytes, |_| ())?;
        bench.device.activate(uploaded.slot)?;
        Ok(())
    }
}

/// Stops the output and a recording.
fn silence(bench: &Bench) -> Result<()> {
    let stopped = bench.device.stop();
    if bench.device.status()?.record.recording {
        bench.device.record_stop()?;
    }
    stopped?;
    Ok(())
}

/// The libraries that the run will overwrite, as text; empty if there are none.
///
/// # Errors
/// The link fails.
pub fn overwrites(bench: &Bench) -> Result<Vec<String>> {
    let slots = bench.device.slots()?;
    let names = ["A", "B"].into_iter().zip(&slots.slots);
    let taken = names.filter_map(|(name, slot)| match slot {
        SlotState::Valid(info) => Some(format!(
            "the library in slot {name}: {} bytes, {} textures, {} scenes",
            info.length, info.textures, info.scenes
        )),
        _ => None,
    });
    Ok(taken.collect())
}
