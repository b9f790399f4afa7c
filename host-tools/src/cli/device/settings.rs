//! `stylus settings`

use std::io::{BufRead, IsTerminal, Write};

use clap::Subcommand;
use model_format::link::{SettingSet, Settings, SettingsChange, SettingsError, SettingsState};
use stylus_link::link::Device;
use stylus_link::link::settings::{self as described, Known, SettingOrigin, SettingRow, consequences};
use stylus_support::{Error, Result};

use super::Link;
use super::status::settings as remarks;
use crate::cli::output::{is_full, print, print_json};
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
    /// Change settings and read them back
    Set {
        /// Names of settings, each followed by its value in the setting's unit
        #[arg(value_name = "NAME VALUE", num_args = 2.., required = true, allow_negative_numbers = true)]
        pairs: Vec<String>,
        /// Do not ask before a change that loosens a limit
        #[arg(long)]
        yes: bool,
    },
    /// Erase all settings: those with a default return to it, and nothing plays until the others are set
    Reset {
        /// Do not ask first
        #[arg(long)]
        yes: bool,
    },
}

pub fn run(arguments: &Arguments) -> Result<()> {
    // Unknown names, and values that are no numbers, are refused before the connection to the device.
    let mut changes = Vec::new();
    let mut wanted = SettingSet::ALL;
    match &arguments.action {
        Some(Action::Get { name: Some(name) }) => {
            wanted = SettingSet::NONE.with(described::named(name)?, true);
        }
        Some(Action::Set { pairs, .. }) => {
            changes = described::changes(pairs)?;
            let set = SettingSet::NONE;
            wanted = changes.iter().fold(set, |set, change| set.with(change.setting, true));
        }
        _ => {}
    }
    let device = arguments.link.connect()?;
    let settings = match &arguments.action {
        // The device checks the values, because its ranges may differ from those known here.
        Some(Action::Set { yes, .. }) => change(&device, &SettingsChange::of(&changes).map_err(refused)?, *yes)?,
        Some(Action::Reset { yes }) => change(&device, &SettingsChange::Reset, *yes)?,
        _ => device.settings()?,
    };
    let state = device.status()?.settings;
    if let Some(unknown) = changes.iter().find(|change| !state.set.contains(change.setting)) {
        let problem = "was written, but the device says that it is not set: set it again";
        return Err(Error::Request(format!("{} {problem}", unknown.setting)));
    }
    show(&settings, &state, wanted, arguments.json)
}

fn refused(error: SettingsError) -> Error {
    Error::Request(error.to_string())
}

/// Proposes a change, asks the user about the limits that it loosens, and applies it.
fn change(device: &Device, change: &SettingsChange, yes: bool) -> Result<Settings> {
    let (before, state) = (device.settings()?, device.status()?.settings);
    // The device says what the change loosens, and applies only what was shown, which the proposal's token names.
    let proposal = device.propose(change)?;
    if !proposal.loosens.is_empty() {
        let after = change.applied_to(before).map_err(refused)?;
        let known = Known::of(&before, &state);
        let lines = consequences(known, known.after(change, &after), proposal.loosens);
        consent(&lines, yes)?;
    }
    Ok(device.apply(&proposal)?)
}

/// Shows `lines`, and asks whether the user wants them, unless `yes` confirms that.
fn consent(lines: &[String], yes: bool) -> Result<()> {
    let input = std::io::stdin();
    if !yes && !input.is_terminal() {
        let told: Vec<&str> = lines.iter().map(|line| line.trim()).collect();
        return Err(Error::Request(format!(
            "nothing was changed, because this loosens limits or gives them their first values: {}: give --yes if you \
             mean it",
            told.join("; ")
        )));
    }
    // A closed standard error must not prevent a script from making the change.
    let mut shown = std::io::stderr().lock();
    for line in lines {
        let _ = writeln!(shown, "{line}");
    }
    if yes {
        return Ok(());
    }
    let _ = write!(shown, "apply this? [y/N] ");
    let mut line = String::new();
    match input.lock().read_line(&mut line) {
        Ok(_) if line.trim() == "y" => Ok(()),
        _ => Err(Error::Request("nothing was changed".to_owned())),
    }
}

fn show(settings: &Settings, state: &SettingsState, wanted: SettingSet, json: bool) -> Result<()> {
    let rows: Vec<SettingRow> = settings
        .iter()
        .filter(|change| wanted.contains(change.setting))
        .map(|change| SettingRow::new(change, state))
        .collect();
    if json {
        return print_json(&rows);
    }
    // A line per setting: the other columns are for --full.
    let header = ["setting", "value", "unit", "what it is", "range", "default"];
    let header = if is_full() { &header[..] } else { &header[..4] };
    let rows = rows.iter().map(|row| cells(row)[..header.len()].to_vec());
    print(&table(header, &rows.collect::<Vec<_>>()))?;
    for line in remarks(state) {
        print(&line)?;
    }
    Ok(())
}

/// Returns the cells of a row of the table.
fn cells(row: &SettingRow) -> Vec<String> {
    let value = match (row.state, row.value) {
        (_, Some(value)) => value.to_string(),
        (SettingOrigin::Lost, None) => "lost".to_owned(),
        (_, None) => "not set".to_owned(),
    };
    vec![
        row.name.to_owned(),
        value,
        row.unit.to_owned(),
        row.meaning.to_owned(),
        if row.least_magnitude > 0.0 {
            format!("{} to {}, not 0", row.lowest, row.highest)
        } else {
            format!("{} to {}", row.lowest, row.highest)
        },
        row.default
            .map_or_else(|| "none".to_owned(), |default| default.to_string()),
    ]
}
