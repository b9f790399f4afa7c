//! Kinds of recordings' files, by the endings of their names.

use std::path::Path;

/// Endings of tables, in lower case. LabVIEW's measurement files may have any of them.
const TABLES: [&str; 5] = ["csv", "tsv", "txt", "dat", "lvm"];

/// Endings of WAV files, in lower case.
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
    /// The kind of the file at `path`; none for an ending that no recording has.
    pub fn of(path: &Path) -> Option<Self> {
        let ending = ending(path);
        if WAVES.contains(&ending.as_str()) {
            Some(Self::Wave)
        } else {
            TABLES.contains(&ending.as_str()).then_some(Self::Table)
        }
    }
}

/// Ending of a file's name, in lower case.
pub(super) fn ending(path: &Path) -> String {
    let ending = path.extension().unwrap_or_default();
    ending.to_string_lossy().to_lowercase()
}

/// The way from a file with this ending, which cannot be read, to one that can.
pub(super) fn conversion(ending: &str) -> String {
    let python = |lines: &str| {
        format!("Python makes a .csv of it: `{lines}`; with --sample-rate if it has no times")
    };
    match ending {
        "mat" => {
            python(
                "import numpy, scipy.io; m = scipy.io.loadmat('FILE.mat'); \
             print({k: numpy.shape(v) for k, v in m.items()}); \
             numpy.savetxt('FILE.csv', m['NAME'].squeeze(), delimiter=',')",
            ) + ", and NAME one of the printed names; of MATLAB 7.3 as an .h5 file"
        }
        "tdms" => python(
            "from nptdms import TdmsFile; d = TdmsFile.read('FILE.tdms').as_dataframe(); print(list(d)); \
             d.to_csv('FILE.csv', index=False)",
        ),
        "h5" | "hdf5" | "hdf" => {
            python(
                "import h5py, numpy; f = h5py.File('FILE.h5'); f.visititems(lambda k, v: print(k, v)); \
             numpy.savetxt('FILE.csv', f['NAME'][()].squeeze(), delimiter=',')",
            ) + ", and NAME one of the printed names"
        }
        "npz" => {
            python(
                "import numpy; z = numpy.load('FILE.npz'); print({k: z[k].shape for k in z}); \
             numpy.savetxt('FILE.csv', z['NAME'].squeeze(), delimiter=',')",
            ) + ", and NAME one of the printed names"
        }
        "npy" => {
            python("import numpy; numpy.savetxt('FILE.csv', numpy.load('FILE.npy'), delimiter=',')")
        }
        "xlsx" | "xls" | "ods" => {
            let lines = format!(
                "import pandas; pandas.read_excel('FILE.{ending}').to_csv('FILE.csv', index=False)"
            );
            format!("save the sheet as .csv; or {}", python(&lines))
        }
        "aac" | "aif" | "aiff" | "flac" | "m4a" | "mp3" | "mp4" | "ogg" | "opus" | "wma" => {
            format!("give .wav or .csv; `ffmpeg -i FILE.{ending} FILE.wav` converts sound")
        }
        _ => "export the samples as .csv, or as .wav".to_owned(),
    }
}
