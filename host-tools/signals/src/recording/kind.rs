//! Kinds of recording files, determined from the extensions of their names.

use std::path::Path;

/// Extensions of tables, in lower case. LabVIEW's measurement files may have any of them.
const TABLES: [&str; 5] = ["csv", "tsv", "txt", "dat", "lvm"];

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
    let ending = path.extension().unwrap_or_default();
    ending.to_string_lossy().to_lowercase()
}

/// Returns how to convert a file with this extension, which cannot be read, to one that can be read.
pub(super) fn conversion(ending: &str) -> String {
    match ending {
        "mat" | "h5" | "hdf5" | "hdf" | "npz" | "npy" | "parquet" | "tdms" | "xlsx" => {
            format!("`stylus-convert FILE.{ending} --out FOLDER` of the Python package stylus_haptics makes .csv of it")
        }
        "feather" | "xls" | "ods" => "save its samples as a table, .csv".to_owned(),
        "bag" => "`rostopic echo -b FILE.bag -p /TOPIC > FILE.csv` makes a .csv of a topic".to_owned(),
        "db3" | "mcap" => "export the topic as .csv, as PlotJuggler does".to_owned(),
        "aac" | "aif" | "aiff" | "flac" | "m4a" | "mp3" | "mp4" | "ogg" | "opus" | "wma" => {
            format!("give .wav or .csv; `ffmpeg -i FILE.{ending} FILE.wav` converts sound")
        }
        "lib" => "it is a texture library; `stylus join` makes one of several".to_owned(),
        _ => "export the samples as .csv, or as .wav".to_owned(),
    }
}
