//! Settings: written, read back, refused out of range, and kept over a reset.

use host_tools::link::LinkError;
use model_format::link::{ResetReason, Setting, SettingChange, Settings, SettingsError};

use crate::bench::Bench;
use crate::error::{Error, Result};

/// Settings that are changed. None of them raises the power of a coil.
const CHANGED: [(Setting, [f32; 2]); 2] = [
    (Setting::SoftStart, [60.0, 70.0]),
    (Setting::ContactThreshold, [0.05, 0.06]),
];

/// Checks the settings.
///
/// # Errors
/// The link fails, or the device refuses a setting that it should take.
pub fn check(bench: &mut Bench) -> Result<()> {
    let before = bench.device.settings()?;
    let mut expected = before;
    for (setting, values) in CHANGED {
        let name = setting.spec().name;
        // A value that it has not already.
        let [first, second] = values;
        let value = if before.get(setting) == first {
            second
        } else {
            first
        };
        let read = bench.device.set(SettingChange { setting, value })?;
        expected = read;
        let found = read.get(setting);
        bench.judge(
            &format!("{name} is written and read back"),
            found,
            &value.to_string(),
            found == value,
        );
    }
    let moved = changed(&before, &expected);
    let others = moved.filter(|setting| CHANGED.iter().all(|(changed, _)| changed != setting));
    let others = others.count();
    bench.judge("no other setting changes", others, "0", others == 0);
    refused(bench)?;
    let name = "settings survive a reset";
    if let Some(reason) = bench.board.lacks() {
        bench.leave_out(name, reason);
        return Ok(());
    }
    let status = bench.status()?;
    bench.board.reset()?;
    let restarted = bench.wait_for_restart(&status)?;
    let after = bench.device.settings()?;
    let lost = changed(&after, &expected).count();
    bench.judge(name, format!("{lost} lost"), "0", lost == 0);
    // A probe pulls the pin or requests the reset from the core, as its firmware and its program like.
    let wanted = [ResetReason::Pin, ResetReason::Software];
    bench.judge(
        "the reset has its reason",
        restarted.reset,
        "reset pin or software",
        wanted.contains(&restarted.reset),
    );
    Ok(())
}

/// Settings with another value.
fn changed(before: &Settings, after: &Settings) -> impl Iterator<Item = Setting> {
    let changed = |setting: &Setting| before.get(*setting) != after.get(*setting);
    Setting::ALL.into_iter().filter(changed)
}

/// A value out of range must be refused and leave the setting as it was.
fn refused(bench: &mut Bench) -> Result<()> {
    let setting = Setting::MuteRamp;
    let before = bench.device.settings()?.get(setting);
    let value = setting.spec().highest * 2.0;
    let answer = bench.device.set(SettingChange { setting, value });
    let (text, is_refused) = match answer {
        Err(LinkError::Settings(error)) => {
            (error.to_string(), !matches!(error, SettingsError::Playing))
        }
        Err(error) => return Err(Error::Link(error)),
        Ok(_) => ("taken".to_owned(), false),
    };
    let after = bench.device.settings()?.get(setting);
    bench.judge(
        "a value out of range is refused",
        text,
        "refused, and the value before holds",
        is_refused && after == before,
    );
    Ok(())
}
