//! Kinds of recording files, determined from the extensions of their names.

use std::path::Path;

use regex_lite::Regex;

/// Extensions of tables, in lower case. LabVIEW's measurement files may have any of them.
const TABLES: [&str; 7] = ["csv", "tsv", "txt", "dat", "log", "asc", "lvm"];

/// Extensions of WAV files, in lower case.
const WAVES: [&str; 2] = ["wav", "wave"];

/// A kind of file that holds a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A WAV file.
    Wave,
    /// A table of text.
    Table,
}

impl Kind {
    /// Returns the kind of the file at `path`; `None` for an extension that no recording has.
    pub fn of(path: &Path) -> Option<Self> {
        let ending = ending(path);
        if WAVES.contains(&ending.as_str()) {
            Some(Self::Wave)
        } else {
            TABLES.contains(&ending.as_str()).then_some(Self::Table)
        }
    }
}

/// Returns the extension of a file's name, in lower case.
pub(super) fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Returns how to convert a file with this extension, which cannot be read, to one that can be read.
pub(super) fn conversion(ending: &str) -> String {
    match ending {
        "mat" | "h5" | "hdf5" | "hdf" | "npz" | "npy" | "parquet" | "tdms" | "xlsx" => {
            format!("`stylus-convert FILE.{ending} --out FOLDER` of the Python package stylus_haptics makes .csv of it")
        }
        "feather" | "xls" | "ods" | "pkl" | "json" => "save its samples as a table, .csv".to_owned(),
        "bag" => "`rostopic echo -b FILE.bag -p /TOPIC > FILE.csv` makes a .csv of a topic".to_owned(),
        "db3" | "mcap" => "export the topic as .csv, as PlotJuggler does".to_owned(),
        "aac" | "aif" | "aiff" | "flac" | "m4a" | "mp3" | "mp4" | "ogg" | "opus" | "wma" => {
            format!("give .wav or .csv; `ffmpeg -i FILE.{ending} FILE.wav` converts sound")
        }
        "zip" | "7z" | "gz" | "rar" => "unpack it, and give the folder".to_owned(),
        "lib" => {
            "it is a texture library; `stylus join` makes one of several, and `stylus page LIB --recordings DIR` shows \
             one beside recordings"
                .to_owned()
        }
        _ => "export the samples as .csv, or as .wav".to_owned(),
    }
}

/// Files and names that are refused, by a sign in the refusal, the line that it names, or the first lines, which follow
/// one another; and what they are, with the remedy.
const SIGNS: [(&str, &str); 17] = [
    (
        "[ -~]\0[ -~]\0[ -~]\0",
        "it is UTF-16 without a mark at its beginning: save it as UTF-8",
    ),
    (
        "(?m)^\"?Interval\\b.*Interval",
        "it has settings above its names, and times for each channel: remove the lines above the samples but one of \
         names, and all columns of times but one",
    ),
    (
        "Record Length",
        "an oscilloscope wrote its settings beside the samples: remove the columns of the settings",
    ),
    (
        "(?m)^.*,Increment",
        "an oscilloscope wrote the sample interval beside the names: remove the lines above the samples, and give \
         1/interval by --sample-rate",
    ),
    (
        "∞",
        "values out of range are written as ∞, so it is clipped: record with a larger range",
    ),
    (
        " -> ",
        "a serial monitor wrote its own times and an arrow before each row: switch them off, or remove them",
    ),
    (
        "(?m)\\w: +[-+.0-9].*\\w: +[-+.0-9]",
        "its labels have a space after the colon: write them without it, as x:0.1, and no unit behind the numbers",
    ),
    (
        "\r[^\n]",
        "its lines end as an old Macintosh's: save it as CSV UTF-8, or `tr '\\r' '\\n' <FILE >OUT` converts it",
    ),
    (
        "^line [0-9]+: '[-+0-9.]+[dD][-+0-9]",
        "Fortran wrote its exponents with D: write E in place of D",
    ),
    (
        "^line [0-9]{2,}: '[A-Za-z_].* is not a number",
        "names stand between the rows, as in files that were joined: remove this line",
    ),
    (
        "^line [0-9]+: .*\n.*[A-Za-z]{3}.*[(:]",
        "text stands between the rows, as of a board that started again: remove this line",
    ),
    (
        "^line 2: [0-9]+ fields.*\n.*\n[-+.,;\t 0-9]+\n",
        "the first line is cut: remove that line",
    ),
    (
        "^line [0-9]{2,}: [0-9]+ fields.*\n[-+.,;\t 0-9eE]+\n",
        "a row was not ended, or was cut, and the next stands behind it: remove this line",
    ),
    ("[0-9]p[0-9]+.*'$", "a number has a point: rename 0p5 to 0.5"),
    ("(?s)^line 1: .*\0", "it is no text: export its samples as .csv"),
    (
        "(?im)^line 1: .*\n *[{\\[]|^ *[{\\[] *[\"{\\[]",
        "it is JSON, and no table: save its samples as .csv",
    ),
    ("(?i)not UTF-8", "if it is no text, export its samples as .csv"),
];

/// Returns what a refused file or name is, and the remedy, by the first of the known signs in `text`.
pub(super) fn remedy(text: &str) -> Option<&'static str> {
    let is_found = |sign: &str| Regex::new(sign).is_ok_and(|sign| sign.is_match(text));
    SIGNS.iter().find(|(sign, _)| is_found(sign)).map(|(_, words)| *words)
}
