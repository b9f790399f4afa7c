//! Configurations of the command as TOML.

use std::path::Path;

use host_tools::support::configuration::{Configuration, KEYS, TOP};

use crate::place;

/// Judges `input` as a configuration.
pub fn judge(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let path = Path::new("fuzz/config.toml");
    let configuration = match Configuration::from_toml(path, text) {
        Ok(configuration) => configuration,
        Err(error) => {
            place::check(&error, path, input);
            return;
        }
    };
    let lines = text.split('\n').count() as u64;
    let (mut top, mut tables) = (String::new(), String::new());
    for (table, keys) in KEYS {
        if table != TOP {
            tables.push_str(&format!("[{table}]\n"));
        }
        for key in keys {
            let Some(entry) = configuration.entry(table, key) else {
                continue;
            };
            assert!((1..=lines).contains(&entry.line), "{entry:?}");
            let part = if table == TOP { &mut top } else { &mut tables };
            // A text between quotes is the same text, whatever kind of value it was.
            part.push_str(&format!("{key} = {}\n", quoted(&entry.value)));
        }
    }
    let again = Configuration::from_toml(path, &(top + &tables)).expect("it was read before");
    let told = |configuration: &Configuration| -> Vec<(&str, &str, String)> {
        let entries = configuration.entries.iter();
        entries
            .map(|entry| (entry.table, entry.key, entry.value.clone()))
            .collect()
    };
    assert_eq!(told(&again), told(&configuration));
}

/// `text` as TOML's basic string, with all but letters and digits escaped.
fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for c in text.chars() {
        if c.is_ascii_alphanumeric() {
            quoted.push(c);
        } else {
            quoted.push_str(&format!("\\U{:08x}", u32::from(c)));
        }
    }
    quoted + "\""
}
