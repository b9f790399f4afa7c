//! Settings with their values, ranges and origins, as a program shows them.

use model_format::link::{SettingChange, SettingSet, SettingsState};
use serde::Serialize;

/// Origin of a setting's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SettingOrigin {
    /// Somebody has set it.
    Set,
    /// Nobody has set it.
    Default,
    /// Nobody has set it, and it has no default.
    NotSet,
    /// It was set, and is lost.
    Lost,
}

/// A setting with its value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SettingRow {
    /// Name.
    pub name: &'static str,
    /// None if nobody has set it and it has no default, or if it was lost.
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
    /// None for a setting without which nothing plays.
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
