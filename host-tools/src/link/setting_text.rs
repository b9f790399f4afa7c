//! Names and values of settings, as a user writes them.

use model_format::link::{Setting, SettingChange};

use crate::support::error::{Error, Result};

/// Parses `pairs`: a setting's name, its value in the setting's unit, and so on. The device judges the values, because
/// it may have other ranges.
///
/// # Errors
/// A name without a value, a name of no setting, or a value that is no number.
pub fn changes(pairs: &[String]) -> Result<Vec<SettingChange>> {
    let (pairs, rest) = pairs.as_chunks::<2>();
    if let [name] = rest {
        return Err(Error::Request(format!(
            "{name} has no value: give each setting's name and its value in turn"
        )));
    }
    pairs
        .iter()
        .map(|[name, value]| {
            let setting = named(name)?;
            let value = value.parse().map_err(|_| {
                Error::Request(format!("{name} of '{value}': its value must be a number"))
            })?;
            Ok(SettingChange { setting, value })
        })
        .collect()
}

/// Finds the setting `name`.
///
/// # Errors
/// A name of no setting, with those that there are.
pub fn named(name: &str) -> Result<Setting> {
    Setting::named(name).ok_or_else(|| {
        let names: Vec<&str> = Setting::ALL.iter().map(|s| s.spec().name).collect();
        Error::Request(format!(
            "no setting '{name}'; there are {}",
            names.join(", ")
        ))
    })
}
