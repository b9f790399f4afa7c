//! Order of the tests. At the end of a run the stylus is silent and has its own settings again.
//!
//! A library cannot be read back from a device, so the tests overwrite the libraries in its slots for good. At the end,
//! a library file of the user's can be uploaded.

use std::path::PathBuf;

use model_format::link::{Setting, SettingChange, SettingSet, Settings, SlotState};
use stylus_link::link::upload::upload;

use crate::bench::DeviceUnderTest;
use crate::checks::{faults, playing, silent, timing};
use crate::library::{Played, played};
use crate::report::{Error, Result};

/// Runs all tests, and uploads `library` at the end. The results are in the bench's report.
///
/// # Errors
/// The settings could not be saved, or the device could not be restored. Every other failure is in the report.
pub fn run(bench: &mut DeviceUnderTest, library: Option<PathBuf>) -> Result<()> {
    let kept = Kept::save(bench, library)?;
    let played = played();
    let ended = if kept.may_play(bench) {
        kept.make_playable(bench).and_then(|()| subjects(bench, &played))
    } else {
        silent_subjects(bench, &played)
    };
    bench.report.interrupted = matches!(ended, Err(Error::Interrupted));
    bench.begin("end");
    // Failures of subjects are lines of the report already, so this one is that of `make_playable`.
    if let Err(error) = &ended
        && !bench.report.interrupted
    {
        bench.judge("the coil's settings are set", error.to_string(), "set", false);
    }
    let restored = kept.restore(bench);
    if let Err(error) = &restored {
        bench.judge(
            "silent, settings and library restored",
            error.to_string(),
            "done",
            false,
        );
    }
    restored
}

/// Runs the subjects that play nothing.
fn silent_subjects(bench: &mut DeviceUnderTest, played: &Played) -> Result<()> {
    silent_ones(bench, played)?;
    bench.begin("play");
    bench.leave_out(
        "all that plays",
        "an amplifier without a wired enable would play at guessed settings of its coil: set `enable-wired` or the \
         coil's settings, or take it off and give --no-amplifier",
    );
    Ok(())
}

/// Runs the silent subjects one after the other. A failure becomes a line of the report; only an interrupt ends the
/// run.
fn silent_ones(bench: &mut DeviceUnderTest, played: &Played) -> Result<()> {
    subject(bench, "self test", silent::check_self_test)?;
    subject(bench, "upload", |bench| silent::check_upload(bench, &played.bytes))
}

/// Runs all subjects.
fn subjects(bench: &mut DeviceUnderTest, played: &Played) -> Result<()> {
    let Played { bytes, selections } = played;
    let (_, scene) = selections.last().expect("there are scenes");
    silent_ones(bench, played)?;
    subject(bench, "play", |bench| playing::check(bench, scene))?;
    subject(bench, "endurance", |bench| timing::check_endurance(bench, bytes))?;
    subject(bench, "cycles", |bench| timing::check_cycles(bench, selections))?;
    subject(bench, "faults", faults::check)
}

fn subject(
    bench: &mut DeviceUnderTest,
    name: &'static str,
    check: impl FnOnce(&mut DeviceUnderTest) -> Result<()>,
) -> Result<()> {
    bench.begin(name);
    match check(bench) {
        Ok(()) => Ok(()),
        Err(_) if bench.is_interrupted() => Err(Error::Interrupted),
        Err(error) => {
            bench.judge(
                "goes to its end",
                error.to_string(),
                "no failure of link or device",
                false,
            );
            // The link may be whole again for the next subject; if not, that subject reports it.
            if bench.device.status().is_err() {
                let _ = bench.device.reconnect();
            }
            // The next subject must not begin while something plays.
            let _ = bench.device.stop();
            Ok(())
        }
    }
}

/// Largest power limit during the tests, W.
const MOST_POWER_W: f32 = 0.01;

/// State that the suite changes and restores.
#[derive(Clone, Debug)]
pub struct Kept {
    settings: Settings,
    /// Settings that the user has set.
    set: SettingSet,
    library: Option<PathBuf>,
}

impl Kept {
    /// Saves the settings. `library` is the file to upload at the end.
    pub fn save(bench: &DeviceUnderTest, library: Option<PathBuf>) -> Result<Self> {
        Ok(Self {
            settings: bench.device.settings()?,
            set: bench.status()?.settings.set,
            library,
        })
    }

    /// Returns true if the suite is allowed to play: all settings of [`SettingSet::REQUIRED`] were set, or the
    /// amplifier can be switched off, or the user states that there is no amplifier.
    fn may_play(&self, bench: &DeviceUnderTest) -> bool {
        let mut required = SettingSet::REQUIRED.iter();
        required.all(|setting| self.set.contains(setting))
            || self.settings.get(Setting::EnableWired) == 1.0
            || bench.no_amplifier
    }

    /// Sets the coil's settings to their present values, with a power limit of at most `MOST_POWER_W`, so that the
    /// device plays even if nobody has set them. [`Kept::restore`] undoes that.
    pub fn make_playable(&self, bench: &DeviceUnderTest) -> Result<()> {
        for setting in SettingSet::REQUIRED.iter() {
            let value = match setting {
                Setting::PowerLimit => self.settings.get(setting).min(MOST_POWER_W),
                _ => self.settings.get(setting),
            };
            bench.device.set(SettingChange { setting, value })?;
        }
        Ok(())
    }

    /// Silences the device, and restores what was saved. After a failure the remaining steps are still tried.
    pub fn restore(&self, bench: &mut DeviceUnderTest) -> Result<()> {
        if bench.device.status().is_err() {
            bench.device.reconnect()?;
        }
        let silent = silence(bench);
        let settings = self.restore_settings(bench);
        let library = self.restore_library(bench);
        silent.and(settings).and(library)
    }

    fn restore_settings(&self, bench: &DeviceUnderTest) -> Result<()> {
        // Settings that nobody has set stay unset, because a device with guessed settings of its coil must refuse to
        // play.
        bench.device.reset_settings()?;
        for setting in self.set.iter() {
            let value = self.settings.get(setting);
            bench.device.set(SettingChange { setting, value })?;
        }
        Ok(())
    }

    fn restore_library(&self, bench: &mut DeviceUnderTest) -> Result<()> {
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

/// Stops the output and any recording.
fn silence(bench: &DeviceUnderTest) -> Result<()> {
    let stopped = bench.device.stop();
    if bench.device.status()?.record.recording {
        bench.device.record_stop()?;
    }
    stopped?;
    Ok(())
}

/// Describes the libraries that the run will overwrite, one text per library.
pub fn overwrites(bench: &DeviceUnderTest) -> Result<Vec<String>> {
    let slots = bench.device.slots()?;
    Ok(["A", "B"]
        .into_iter()
        .zip(&slots.slots)
        .filter_map(|(name, slot)| match slot {
            SlotState::Valid(info) => Some(format!(
                "the library in slot {name}: {} bytes, {} textures, {} scenes",
                info.length, info.textures, info.scenes
            )),
            _ => None,
        })
        .collect())
}
