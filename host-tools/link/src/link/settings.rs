//! Settings with their values, ranges and origins, as a program shows them.

use model_format::link::{
    BUILT_FOR_GAIN, BUILT_FOR_OHM, MAX_PIN_MEAN_SQUARE, Setting, SettingChange, SettingSet, Settings, SettingsChange,
    SettingsState,
};
use serde::Serialize;
use stylus_app::safety::Config;
use stylus_support::names::listed;
use stylus_support::{Error, Result};

/// Origin of a setting's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SettingOrigin {
    /// Somebody has set the value.
    Set,
    /// Nobody has set the value.
    Default,
    /// Nobody has set the value, and the setting has no default.
    NotSet,
    /// The value was set, and is lost.
    Lost,
}

/// A setting with its value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SettingRow {
    /// Name.
    pub name: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Value; none if nobody has set it and the setting has no default, or if it was lost.
    pub value: Option<f32>,
    /// Origin of the value.
    pub state: SettingOrigin,
    /// Unit of the value.
    pub unit: &'static str,
    /// Lowest value.
    pub lowest: f32,
    /// Highest value.
    pub highest: f32,
    /// Least magnitude; 0 if the value may be 0.
    pub least_magnitude: f32,
    /// Default value; none for a setting without which nothing plays.
    pub default: Option<f32>,
}

impl SettingRow {
    /// The row of a setting of a device in this `state`.
    pub fn new(SettingChange { setting, value }: SettingChange, state: &SettingsState) -> Self {
        let spec = setting.spec();
        let is_required = SettingSet::REQUIRED.contains(setting);
        let origin = if state.lost.contains(setting) {
            SettingOrigin::Lost
        } else if state.set.contains(setting) {
            SettingOrigin::Set
        } else if is_required {
            SettingOrigin::NotSet
        } else {
            SettingOrigin::Default
        };
        Self {
            name: spec.name,
            meaning: setting.meaning(),
            value: matches!(origin, SettingOrigin::Set | SettingOrigin::Default).then_some(value),
            state: origin,
            unit: spec.unit,
            lowest: spec.lowest,
            highest: spec.highest,
            least_magnitude: spec.least_magnitude,
            default: (!is_required).then_some(spec.default),
        }
    }
}

/// Parses `pairs`, which alternate between a setting's name and its value in the setting's unit. The device checks the
/// values, because its ranges may be different.
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
            let value = value
                .parse()
                .map_err(|_| Error::Request(format!("{name} of '{value}': its value must be a number")))?;
            Ok(SettingChange { setting, value })
        })
        .collect()
}

/// Finds the setting `name`.
///
/// # Errors
/// A name of no setting. The error lists the settings.
pub fn named(name: &str) -> Result<Setting> {
    Setting::named(name).ok_or_else(|| {
        let names: Vec<&str> = Setting::ALL.iter().map(|s| s.spec().name).collect();
        Error::Request(format!("no setting '{name}'; there are {}", listed(name, &names)))
    })
}

/// Settings of which some have no value.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// The values. Those of the settings in `unset` are placeholders.
    pub settings: &'a Settings,
    /// Settings without a value.
    pub unset: SettingSet,
}

impl<'a> Known<'a> {
    /// The settings of a device in this `state`.
    pub fn of(settings: &'a Settings, state: &SettingsState) -> Self {
        let unset = state.lost.or(SettingSet::REQUIRED.without(state.set));
        Self { settings, unset }
    }

    /// Returns the state after `change`, which leads to `settings`.
    #[must_use]
    pub fn after(self, change: &SettingsChange, settings: &'a Settings) -> Self {
        let unset = match change {
            // A reset gives every setting its default, and these have none that is known to fit the hardware.
            SettingsChange::Reset => SettingSet::REQUIRED,
            SettingsChange::Set(changes) => {
                let set = changes
                    .iter()
                    .fold(SettingSet::NONE, |set, change| set.with(change.setting, true));
                self.unset.without(set)
            }
        };
        Self { settings, unset }
    }

    /// Returns the value of `setting` as text.
    fn value(self, setting: Setting) -> String {
        if self.unset.contains(setting) {
            return "not set".to_owned();
        }
        self.settings.get(setting).to_string()
    }

    /// Returns the limits at pin and coil as text. None if a value is missing, because nothing plays then.
    fn in_force(self) -> Option<String> {
        self.unset.is_empty().then(|| in_force(self.settings))
    }
}

/// Returns a line for each of the `changed` settings, with its value `before` and `after`. Further lines give the
/// limits at pin and coil before and after the change.
pub fn consequences(before: Known<'_>, after: Known<'_>, changed: SettingSet) -> Vec<String> {
    let line = |setting: Setting| {
        let unit = match setting.spec().unit {
            _ if after.unset.contains(setting) => String::new(),
            // A switch has its range in place of a unit.
            unit if unit.contains(" or ") => String::new(),
            unit => format!(" {unit}"),
        };
        format!(
            "  {setting}: {} -> {}{unit}",
            before.value(setting),
            after.value(setting)
        )
    };
    let mut lines: Vec<String> = changed.iter().map(line).collect();
    lines.extend(before.in_force().map(|limits| format!("  before: {limits}")));
    let limits = after
        .in_force()
        .unwrap_or_else(|| "nothing plays until what is not set is set".to_owned());
    lines.push(format!("  after:  {limits}"));
    lines
}

/// Returns a text with the reason for a limit that no setting has caused.
pub fn cap() -> String {
    format!(
        "this firmware holds {:.3} V RMS at the pin at most, as for {BUILT_FOR_OHM} Ω at a gain of {BUILT_FOR_GAIN}",
        MAX_PIN_MEAN_SQUARE.sqrt()
    )
}

/// Returns the limits that follow from `settings`, at the pin and at the coil that the settings describe.
fn in_force(settings: &Settings) -> String {
    let limits = Config::new(settings, 1.0).output_limits(settings);
    let (gain, ohm) = (
        settings.get(Setting::AmplifierGain),
        settings.get(Setting::CoilResistance),
    );
    let peak_volt = limits.peak_volt * gain;
    format!(
        "{:.3} V peak and {:.3} V RMS at the pin; {:.2} V and {:.3} W peak, {:.3} W held at {ohm} Ω{}",
        limits.peak_volt,
        limits.mean_square.sqrt(),
        peak_volt,
        peak_volt * peak_volt / ohm,
        limits.coil_watt,
        if limits.is_capped {
            let allowed = settings.get(Setting::PowerLimit);
            format!(": you allowed {allowed} W, and {}", cap())
        } else {
            String::new()
        }
    )
}

#[cfg(test)]
mod tests {
    use model_format::link::SettingChange;

    use super::*;

    fn with(pairs: &[(Setting, f32)]) -> Settings {
        pairs.iter().fold(Settings::default(), |settings, &(setting, value)| {
            settings.with(SettingChange { setting, value }).unwrap()
        })
    }

    /// Settings of a coil of 8 Ω.
    fn of_coil(others: &[(Setting, f32)]) -> Settings {
        let coil = [
            (Setting::CoilResistance, 8.0),
            (Setting::AmplifierGain, 10.0),
            (Setting::PowerLimit, 0.5),
        ];
        with(&[&coil, others].concat())
    }

    fn known(settings: &Settings) -> Known<'_> {
        Known {
            settings,
            unset: SettingSet::NONE,
        }
    }

    #[test]
    fn a_change_is_told_in_old_and_new_values_and_in_volts_and_watts() {
        let (before, after) = (of_coil(&[]), of_coil(&[(Setting::HardLimit, 0.8)]));
        let changed = SettingSet::NONE.with(Setting::HardLimit, true);
        let lines = consequences(known(&before), known(&after), changed);
        assert_eq!(lines[0], "  hard-limit: 0.5 -> 0.8 V");
        // 0.2 V RMS at a gain of 10 are 2 V, 0.5 W in 8 Ω; 0.5 V are 5 V, 3.1 W.
        for told in ["0.500 V peak and 0.200 V RMS", "3.119 W peak", "0.500 W held at 8 Ω"] {
            assert!(lines[1].contains(told), "{lines:?}");
        }
        // A switch has no unit.
        let switch = SettingSet::NONE.with(Setting::EnableWired, true);
        let lines = consequences(known(&before), known(&before), switch);
        assert_eq!(lines[0], "  enable-wired: 0 -> 0");
        // Whatever the settings say about the hardware, the image has a cap. The text says what was allowed and why
        // less is held.
        let told_away = with(&[(Setting::AmplifierGain, 0.01), (Setting::PowerLimit, 0.1)]);
        let lines = consequences(known(&before), known(&told_away), changed);
        let told = "you allowed 0.1 W, and this firmware holds 0.283 V RMS at the pin at most";
        assert!(lines[2].contains(told), "{lines:?}");
    }

    #[test]
    fn what_is_not_set_is_told_as_such_before_and_after() {
        let (settings, none) = (of_coil(&[]), Settings::default());
        let unset = SettingSet::REQUIRED;
        let nothing = Known { settings: &none, unset };
        let lines = consequences(nothing, known(&settings), unset);
        assert!(lines[0].contains("not set -> "), "{lines:?}");
        assert!(!lines.iter().any(|line| line.contains("before")));
        // One value that is missing is enough for nothing to play, so placeholders give no limits.
        for setting in unset.iter() {
            let unset = SettingSet::NONE.with(setting, true);
            let without = Known { settings: &none, unset };
            let lines = consequences(without, without, unset);
            assert_eq!(lines.len(), 2, "{lines:?}");
            assert!(lines[1].contains("nothing plays until"), "{lines:?}");
        }
        // After a reset no setting has a value, whatever the placeholders are.
        let reset = known(&settings).after(&SettingsChange::Reset, &none);
        let lines = consequences(known(&settings), reset, unset);
        let (last, values) = lines.split_last().expect("there are lines");
        let values = &values[..values.len() - 1];
        assert!(values.iter().all(|line| line.ends_with(" -> not set")), "{lines:?}");
        assert!(last.contains("nothing plays until"), "{lines:?}");
    }
}
