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
    let python = |lines: &str| format!("Python makes a .csv of it, for which --sample-rate gives the rate: `{lines}`");
    // The commands first print the names in the file. Rows of the array become samples; an array with few rows is
    // transposed, because its rows are axes.
    let array = |opened: &str, names: &str, array: &str| {
        let lines = python(&format!(
            "import numpy; {opened}; print({names}); x = {array}.squeeze(); \
             numpy.savetxt('FILE.csv', x if len(x) > 3 else x.T, delimiter=',')"
        ));
        format!("{lines}, where NAME is one of the names that it prints")
    };
    match ending {
        "mat" => {
            array(
                "import scipy.io; m = scipy.io.loadmat('FILE.mat')",
                "[k for k in m]",
                "numpy.array(m['NAME'])",
            ) + "; for MATLAB 7.3 with `import h5py; m = h5py.File('FILE.mat')` instead"
        }
        "h5" | "hdf5" | "hdf" => array(
            &format!("import h5py; f = h5py.File('FILE.{ending}')"),
            "f.visit(print)",
            "f['NAME'][()]",
        ),
        "npz" => array("z = numpy.load('FILE.npz')", "z.files", "z['NAME']"),
        "npy" => python(
            "import numpy; x = numpy.load('FILE.npy').squeeze(); \
             numpy.savetxt('FILE.csv', x if len(x) > 3 else x.T, delimiter=',')",
        ),
        "parquet" | "feather" => python(&format!(
            "import pandas; pandas.read_{ending}('FILE.{ending}').to_csv('FILE.csv', index=False)"
        )),
        "bag" => "`rostopic echo -b FILE.bag -p /TOPIC > FILE.csv` makes a .csv of a topic".to_owned(),
        "db3" | "mcap" => "export the topic as .csv, as PlotJuggler does".to_owned(),
        "tdms" => python(
            "from nptdms import TdmsFile; TdmsFile.read('FILE.tdms').as_dataframe().to_csv('FILE.csv', index=False)",
        ),
        "xlsx" | "xls" | "ods" => {
            let lines = format!("import pandas; pandas.read_excel('FILE.{ending}').to_csv('FILE.csv', index=False)");
            format!("save the sheet as .csv; or {}", python(&lines))
        }
        "aac" | "aif" | "aiff" | "flac" | "m4a" | "mp3" | "mp4" | "ogg" | "opus" | "wma" => {
            format!("give .wav or .csv; `ffmpeg -i FILE.{ending} FILE.wav` converts sound")
        }
        "lib" => "it is a texture library; `stylus join` makes one of several".to_owned(),
        _ => "export the samples as .csv, or as .wav".to_owned(),
    }
}
