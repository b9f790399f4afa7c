//! `stylus settings`

use clap::Subcommand;
use host_tools::support::error::{Error, Result};
use model_format::link::{Setting, SettingChange, Settings};
use serde::Serialize;

use super::connection::Link;
use crate::cli::output::{print, print_json};
use crate::cli::table::table;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    action: Option<Action>,
    /// Print settings as JSON
    #[arg(long, global = true)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Subcommand)]
enum Action {
    /// Show all settings, or one; this is the default
    Get {
        /// Name of the setting
        name: Option<String>,
    },
    /// Change a setting and read it back
    Set {
        /// Name of the setting
        name: String,
        /// Value, in the setting's unit
        #[arg(allow_negative_numbers = true)]
        value: f32,
    },
    /// Reset every setting to its default
    Reset,
}

/// A setting with its value.
#[derive(Serialize)]
struct Row {
    name: &'static str,
    value: f32,
    unit: &'static str,
    lowest: f32,
    highest: f32,
    default: f32,
}

impl From<SettingChange> for Row {
    fn from(SettingChange { setting, value }: SettingChange) -> Self {
        let spec = setting.spec();
        Self {
            name: spec.name,
            value,
            unit: spec.unit,
            lowest: spec.lowest,
            highest: spec.highest,
            default: spec.default,
        }
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    // The name is checked before the device is connected.
    let setting = match &arguments.action {
        Some(Action::Get { name: Some(name) } | Action::Set { name, .. }) => Some(named(name)?),
        _ => None,
    };
    let device = arguments.link.connect()?;
    let settings = match &arguments.action {
        None | Some(Action::Get { .. }) => device.settings()?,
        Some(Action::Set { value, .. }) => {
            let setting = setting.expect("it was looked up above");
            let value = *value;
            device.set(SettingChange { setting, value })?
        }
        Some(Action::Reset) => device.reset_settings()?,
    };
    show(&settings, setting, arguments.json)
}

fn named(name: &str) -> Result<Setting> {
    Setting::named(name).ok_or_else(|| {
        let names: Vec<&str> = Setting::ALL.iter().map(|s| s.spec().name).collect();
        Error::Request(format!(
            "no setting '{name}'; there are {}",
            names.join(", ")
        ))
    })
}

fn show(settings: &Settings, only: Option<Setting>, json: bool) -> Result<()> {
    let wanted = settings
        .iter()
        .filter(|change| only.is_none_or(|only| only == change.setting));
    let rows: Vec<Row> = wanted.map(Row::from).collect();
    if json {
        return print_json(&rows);
    }
    let cells: Vec<Vec<String>> = rows
        .iter()
        .map(|row| {
            vec![
                row.name.to_owned(),
                row.value.to_string(),
                row.unit.to_owned(),
                format!("{} to {}", row.lowest, row.highest),
                row.default.to_string(),
            ]
        })
        .collect();
    print(&table(
        &["setting", "value", "unit", "range", "default"],
        &cells,
    ))
}
