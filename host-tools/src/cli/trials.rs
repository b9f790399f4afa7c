//! `stylus trials`

use std::collections::BTreeSet;
use std::path::PathBuf;

use stylus_signals::recording::TRIALS_FILE;
use stylus_signals::recording::freehand::is_simulated;
use stylus_signals::recording::pattern::{Named, Pattern};
use stylus_signals::recording::{scale, texture_fault};
use stylus_support::atomic_file;
use stylus_support::csv_table::written;
use stylus_support::number::counted;
use stylus_support::number::{positive, recorded_force, recorded_speed};
use stylus_support::{Error, Result};

use super::files::Overwrite;
use super::input::texture_name;
use super::table::table;
use crate::cli::output::{print, warn};

/// Number of values, and of files that do not match, that are listed.
const SHOWN: usize = 8;

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder of recordings, WAV, tables or LabVIEW files, in it or below
    folder: PathBuf,
    /// Names of the files, by {texture}, {speed} in mm/s, {force} in newtons, {take}, and {*} for anything, such as
    /// '{texture}_{speed}mms_{force}N_{take}.wav'; {force*0.001} takes millinewtons
    #[arg(long)]
    pattern: Pattern,
    /// Texture of all files, if their names tell none
    #[arg(long, value_name = "NAME", value_parser = texture_name)]
    texture: Option<String>,
    /// Speed of all files, in mm/s, if their names tell none
    #[arg(long, value_name = "MM_S", value_parser = recorded_speed)]
    speed: Option<f64>,
    /// Force of all files, in newtons, if their names tell none
    #[arg(long, value_name = "N", value_parser = recorded_force)]
    force: Option<f64>,
    /// Acceleration of a sample of 1 in all files, in m/s², or as a unit such as g or g/256
    #[arg(long, visible_alias = "unit", value_name = "M_S2", value_parser = scale)]
    scale: Option<f64>,
    /// Start of the used part of all files, in seconds
    #[arg(long, value_name = "S", value_parser = positive)]
    start: Option<f64>,
    /// Duration of the used part of all files, in seconds
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,
    /// Take to list alone; the others can have a list of their own, for evaluate --takes
    #[arg(long)]
    take: Option<String>,
    /// Name of the list to write, in the folder, because its files are named from there
    #[arg(long, value_name = "NAME", default_value = TRIALS_FILE)]
    list: String,
    #[command(flatten)]
    overwrite: Overwrite,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let folder = arguments.folder.as_path();
    if arguments.list.contains(['/', '\\']) {
        let problem = "--list is the name of a file in the folder, because its files are named from there";
        return Err(Error::Request(problem.into()));
    }
    let list = folder.join(&arguments.list);
    arguments.overwrite.file(&list)?;
    let (mut named, others) = arguments.pattern.read(folder)?;
    if let Some(take) = &arguments.take {
        named.retain(|file| file.take.as_ref() == Some(take));
    }
    // Without a match of the pattern, `read` has returned an error, so this is by --take alone.
    if named.is_empty() {
        return Err(Error::Request("no file is of that take".into()));
    }
    let mut header = vec!["file", "texture", "speed_mm_s", "force_n"];
    let of_all = [
        ("scale_m_s2", arguments.scale),
        ("start_s", arguments.start),
        ("duration_s", arguments.duration),
    ];
    let of_all = || of_all.into_iter().filter_map(|(name, value)| Some((name, value?)));
    header.extend(of_all().map(|(name, _)| name));
    // A list that did not pass on the mark of simulated files would make every library and report of them look
    // recorded.
    let simulated = named
        .iter()
        .map(|file| folder.join(&file.file))
        .map(|path| is_simulated(&path))
        .collect::<Result<Vec<bool>>>()?;
    let has_simulated = simulated.contains(&true);
    header.extend(has_simulated.then_some("simulated"));
    let mut records = vec![header.into_iter().map(str::to_owned).collect::<Vec<_>>()];
    for (file, simulated) in named.iter_mut().zip(simulated) {
        let (texture, speed, force) = completed(file, arguments)?;
        let mut record = vec![
            file.file.display().to_string(),
            texture,
            speed.to_string(),
            force.to_string(),
        ];
        record.extend(of_all().map(|(_, value)| value.to_string()));
        record.extend(has_simulated.then(|| simulated.to_string()));
        records.push(record);
    }
    let text = written(records.iter().map(|record| record.iter().map(String::as_str)));
    atomic_file::write(&list, text.as_bytes())?;
    warn_of_others(&others);
    print(&format!("{}\n", understood(&named)))?;
    let mark = if has_simulated { ", SIMULATED" } else { "" };
    print(&format!(
        "{}{mark} -> {}",
        counted(named.len(), "trial"),
        list.display()
    ))
}

/// Fills in the values that the name of `file` lacks. Returns its texture, its speed, mm/s, and its force, N.
fn completed(file: &mut Named, arguments: &Arguments) -> Result<(String, f64, f64)> {
    let missing = |what: &str| {
        Error::Request(format!(
            "the pattern has no {{{what}}}: add it, or give --{what} for all files"
        ))
    };
    let texture = file
        .texture
        .get_or_insert_with(|| arguments.texture.clone().unwrap_or_default());
    if texture.is_empty() {
        return Err(missing("texture"));
    }
    // A name from a file's name has not been checked by the parser of the options.
    if let Some(fault) = texture_fault(texture) {
        let problem = format!("tells the texture {texture:?}, whose name {fault}");
        return Err(Error::file(&arguments.folder.join(&file.file), problem));
    }
    let speed = file.speed_mm_s.or(arguments.speed);
    let speed = *file.speed_mm_s.insert(speed.ok_or_else(|| missing("speed"))?);
    let force = file.force_n.or(arguments.force);
    let force = *file.force_n.insert(force.ok_or_else(|| missing("force"))?);
    Ok((texture.clone(), speed, force))
}

/// Warns of the files that the pattern does not match.
fn warn_of_others(others: &[String]) {
    if !others.is_empty() {
        let shown: Vec<&str> = others.iter().take(SHOWN).map(String::as_str).collect();
        let more = if others.len() > SHOWN { ", ..." } else { "" };
        warn(&format!(
            "left out, because the pattern does not match: {}, {}{more}",
            counted(others.len(), "file"),
            shown.join(", ")
        ));
    }
}

/// Returns the first `values` in words, with dots if there are more.
fn first(values: impl ExactSizeIterator<Item: ToString>) -> String {
    let more = if values.len() > SHOWN { " ..." } else { "" };
    let shown: Vec<String> = values.take(SHOWN).map(|value| value.to_string()).collect();
    shown.join(" ") + more
}

/// Returns a table with a row per texture: its trials, speeds, forces and takes.
fn understood(named: &[Named]) -> String {
    let textures: BTreeSet<&str> = named.iter().filter_map(|file| file.texture.as_deref()).collect();
    let rows: Vec<Vec<String>> = textures
        .into_iter()
        .map(|texture| {
            let own = || {
                named
                    .iter()
                    .filter(move |file| file.texture.as_deref() == Some(texture))
            };
            let numbers = |of: fn(&Named) -> Option<f64>| {
                let mut values: Vec<f64> = own().filter_map(of).collect();
                values.sort_by(f64::total_cmp);
                values.dedup();
                first(values.iter())
            };
            let takes: BTreeSet<&str> = own().filter_map(|file| file.take.as_deref()).collect();
            vec![
                texture.to_owned(),
                own().count().to_string(),
                numbers(|file| file.speed_mm_s),
                numbers(|file| file.force_n),
                first(takes.iter()),
            ]
        })
        .collect();
    table(&["texture", "trials", "speeds mm/s", "forces N", "takes"], &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_not_shown_are_told_by_dots() {
        assert_eq!(first(["1", "2"].iter()), "1 2");
        assert_eq!(first([7; SHOWN].iter()), "7 7 7 7 7 7 7 7");
        assert_eq!(first([7; SHOWN + 1].iter()), "7 7 7 7 7 7 7 7 ...");
    }
}
