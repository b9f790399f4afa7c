//! Rows of the list of recordings, as a person fills them in, and the list as the command reads it.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use stylus_signals::recording::freehand::is_simulated;
use stylus_signals::recording::pattern::{Named, Pattern, one_number};
use stylus_signals::recording::{Kind, LIST_COLUMNS, RecordingSet, Trial, is_list, read, scale};
use stylus_support::csv_table::written;
use stylus_support::names::portable;
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, files};

/// Names that are tried if no pattern is given, the most telling first.
const USUAL: [&str; 6] = [
    "{texture}_{speed}mms_{force}N_{take}",
    "{texture}_{speed}mms_{force}N",
    "{texture}/simulated_{speed}mm_s_{force}N",
    "{texture}_{speed}_{force}_{take}",
    "{texture}_{speed}_{force}",
    "{texture}_{speed}mms",
];

/// A row of the list: a recording's file, relative to the folder, and what is known of it, as text. What is not known
/// is empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Row {
    /// The file.
    pub file: String,
    /// Name of the texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: String,
    /// Normal force, N.
    pub force_n: String,
    /// Acceleration of a sample of 1: m/s², or a unit.
    pub scale_m_s2: String,
    /// Start of the used part, s.
    pub start_s: String,
    /// Duration of the used part, s.
    pub duration_s: String,
    /// Sample rate of a table without times, Hz.
    pub sample_rate_hz: String,
    /// Unit of a table's times.
    pub time_unit: String,
    /// `true` if the samples are evenly spaced whatever their times are.
    pub even_times: String,
    /// `true` if the recording is simulated.
    pub simulated: String,
}

impl Row {
    /// The row of a trial of a list in `folder`.
    fn of(trial: &Trial, folder: &Path) -> Self {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let file = trial.file.strip_prefix(folder).unwrap_or(&trial.file);
        Self {
            file: portable(file),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s.to_string(),
            force_n: trial.force_n.to_string(),
            scale_m_s2: number(trial.scale_m_s2),
            start_s: number(Some(trial.start_s).filter(|start| *start > 0.0)),
            duration_s: number(trial.duration_s),
            sample_rate_hz: number(trial.sample_rate_hz),
            time_unit: trial.time_unit.map_or("", |unit| unit.name()).to_owned(),
            even_times: trial.has_even_times.map_or_else(String::new, |even| even.to_string()),
            simulated: match trial.provenance {
                model_format::Provenance::Simulated => "true".to_owned(),
                model_format::Provenance::Recorded | model_format::Provenance::Unscaled => String::new(),
            },
        }
    }

    /// The texts, in the order of [`LIST_COLUMNS`].
    fn fields(&self) -> [&str; 11] {
        [
            &self.file,
            &self.texture,
            &self.speed_mm_s,
            &self.force_n,
            &self.scale_m_s2,
            &self.start_s,
            &self.duration_s,
            &self.sample_rate_hz,
            &self.time_unit,
            &self.even_times,
            &self.simulated,
        ]
    }

    /// The row with its unit as a number, which a list needs.
    fn in_numbers(&self, folder: &Path) -> Result<Self> {
        let text = self.scale_m_s2.trim();
        if text.is_empty() || text.parse::<f64>().is_ok() {
            return Ok(self.clone());
        }
        let refused = |fault| Error::file(&folder.join(&self.file), format!("the unit '{text}' {fault}"));
        Ok(Self {
            scale_m_s2: scale(text).map_err(refused)?.to_string(),
            ..self.clone()
        })
    }
}

/// Rows for files, and how they were filled in.
#[derive(Debug, Default, Serialize)]
pub struct Filled {
    /// The rows.
    pub rows: Vec<Row>,
    /// A sentence on each source of what is in them, and on what cannot be used.
    pub notes: Vec<String>,
    /// Files that are no recordings, or that no list names although one names others. They are no longer kept.
    pub left_out: Vec<PathBuf>,
}

/// Returns rows for the recordings in `folder` that are not `known`: by `pattern`; without one, from lists among the
/// files, or by the first usual pattern that fits all names.
///
/// # Errors
/// A list that cannot be read; a pattern that is none.
pub fn filled(folder: &Path, pattern: &str, known: &[String]) -> Result<Filled> {
    let all: Vec<PathBuf> = files::below(folder).into_iter().map(|(path, _)| path).collect();
    let mut known: HashSet<PathBuf> = known.iter().map(|file| folder.join(file)).collect();
    let mut filled = Filled::default();
    let (lists, recordings): (Vec<PathBuf>, Vec<PathBuf>) = all
        .iter()
        .filter(|path| Kind::of(path).is_some())
        .cloned()
        .partition(|path| is_list(path));
    // By a pattern, rows are filled again.
    let has_lists = pattern.is_empty();
    let others = all.iter().filter(|path| has_lists && Kind::of(path).is_none());
    let mut others: Vec<PathBuf> = others.cloned().collect();
    for list in lists.into_iter().filter(|_| has_lists) {
        let set = RecordingSet::from_list(&list)?;
        let own = set.trials.iter().filter(|trial| !known.contains(&trial.file));
        let own: Vec<Row> = own.map(|trial| Row::of(trial, folder)).collect();
        if !own.is_empty() {
            filled
                .notes
                .push(format!("{} rows from the list {}", own.len(), list.display()));
        }
        filled.rows.extend(own);
        known.extend(set.trials.into_iter().map(|trial| trial.file));
    }
    let mut new: Vec<PathBuf> = recordings.into_iter().filter(|path| !known.contains(path)).collect();
    if !filled.rows.is_empty() {
        others.append(&mut new);
    }
    let named = new.iter().map(|path| path.strip_prefix(folder).unwrap_or(path));
    let (told, note) = told(&named.map(portable).collect::<Vec<_>>(), pattern)?;
    filled.notes.extend(note);
    for (path, named) in new.iter().zip(told) {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        filled.rows.push(Row {
            file: portable(path.strip_prefix(folder).unwrap_or(path)),
            texture: named.texture.unwrap_or_default(),
            speed_mm_s: number(named.speed_mm_s),
            force_n: number(named.force_n),
            simulated: if is_simulated(path)? {
                "true".to_owned()
            } else {
                String::new()
            },
            ..Row::default()
        });
    }
    for path in &others {
        // The readers' own words, unless a list leaves the file out.
        let why = match (Kind::of(path), read(&Trial::of(path, "", 0.0, 0.0))) {
            (None, Err(fault)) => fault.to_string(),
            _ => format!("{}: left out, because no list names it", path.display()),
        };
        filled.notes.push(why);
        files::remove(path);
    }
    filled.left_out = others;
    Ok(filled)
}

/// Returns what the names of `files` say, and by what pattern.
fn told(files: &[String], asked: &str) -> Result<(Vec<Named>, Option<String>)> {
    let stems: Vec<&str> = files.iter().map(|file| stem(file)).collect();
    let by = |text: &str| -> std::result::Result<Vec<Option<Named>>, String> {
        let pattern: Pattern = text.parse()?;
        // A folder above says nothing, unless the pattern names it.
        let part = |stem: &&str| pattern.told(stem).or_else(|| pattern.told(stem.rsplit('/').next()?));
        Ok(stems.iter().map(part).collect())
    };
    if files.is_empty() {
        return Ok((Vec::new(), None));
    }
    if !asked.is_empty() {
        let text = Kind::of(Path::new(asked)).map_or(asked, |_| stem(asked));
        let found = by(text).map_err(|fault| Error::Request(format!("the pattern: {fault}")))?;
        let fits = found.iter().flatten().count();
        let note = format!("'{asked}' fits {fits} of {} names", files.len());
        return Ok((found.into_iter().map(Option::unwrap_or_default).collect(), Some(note)));
    }
    let one_number = one_number(&stems);
    for text in USUAL.iter().copied().chain(one_number.as_deref()) {
        let Ok(found) = by(text) else { continue };
        if let Some(all) = found.into_iter().collect::<Option<Vec<_>>>() {
            let note = format!("{} rows from the files' names, by '{text}'", files.len());
            return Ok((all, Some(note)));
        }
    }
    let texture = |stem: &&str| Named {
        texture: stem.rsplit('/').next().map(str::to_owned),
        ..Named::default()
    };
    let note = "no usual pattern fits all names: each recording is a texture named like its file, until you say more";
    Ok((stems.iter().map(texture).collect(), Some(note.to_owned())))
}

fn stem(file: &str) -> &str {
    let name = file.rfind('/').map_or(0, |slash| slash + 1);
    file[name..].rfind('.').map_or(file, |dot| &file[..name + dot])
}

/// Writes a `list` with these rows, whose files are relative to its folder. Returns the set that it lists.
///
/// # Errors
/// A unit that is none, or a row that no list can have; the error names its line, of which the first is the header.
pub fn listed(list: &Path, rows: &[Row]) -> Result<RecordingSet> {
    let folder = list.parent().unwrap_or(list);
    let rows: Vec<Row> = rows.iter().map(|row| row.in_numbers(folder)).collect::<Result<_>>()?;
    let fields: Vec<[&str; 11]> = rows.iter().map(Row::fields).collect();
    // Columns that no row fills would only be in the way of whoever opens the list.
    let is_used = |column: &usize| *column < 4 || fields.iter().any(|row| !row[*column].is_empty());
    let used: Vec<usize> = (0..LIST_COLUMNS.len()).filter(is_used).collect();
    let table = std::iter::once(&LIST_COLUMNS).chain(&fields);
    let text = written(table.map(|row| used.iter().map(|&column| row[column])));
    atomic_file::write(list, text.as_bytes())?;
    RecordingSet::from_list(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(files: &[&str], pattern: &str) -> Vec<(String, Option<f64>, Option<f64>)> {
        let files: Vec<String> = files.iter().map(ToString::to_string).collect();
        let (told, _) = told(&files, pattern).unwrap();
        let row = |named: Named| (named.texture.unwrap_or_default(), named.speed_mm_s, named.force_n);
        told.into_iter().map(row).collect()
    }

    #[test]
    fn names_fill_rows_by_the_pattern_that_fits_all_of_them_and_nothing_is_guessed_otherwise() {
        let cork = ("cork".to_owned(), Some(60.0), Some(0.5));
        for name in ["cork_60mms_0.5N_1.wav", "cork_60mms_0.5N.csv", "school/cork_60_0.5.wav"] {
            assert_eq!(texts(&[name], ""), std::slice::from_ref(&cork), "{name}");
        }
        let unlike = texts(&["cork_60mms_0.5N.wav", "felt.wav"], "");
        assert_eq!(unlike[1], ("felt".to_owned(), None, None));
        assert_eq!(unlike[0].1, None);
        assert_eq!(texts(&["v60 cork.wav"], "v{speed} {texture}.wav")[0].1, Some(60.0));
    }
}
