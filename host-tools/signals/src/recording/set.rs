//! Recording sets: a folder with a list of trials, or recordings that are given individually.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use model_format::Provenance;
use stylus_support::bounded_file::{Format, absent};
use stylus_support::csv_table::{CsvTable, Header, Row, is_named};
use stylus_support::files;
use stylus_support::number::{force_fault, speed_fault};
use stylus_support::number::{not_negative, positive, recorded_force, recorded_speed};
use stylus_support::{Error, Result};

use super::kind::Kind;
use super::rate::{MAX_CHANNELS, SampleRate};
use super::times::TimeUnit;
use super::trial::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, Trial};
use super::unit::scale;

/// File name of the list of trials in a recording set's folder.
pub const TRIALS_FILE: &str = "trials.csv";

/// Values that files and lists may lack. None of them changes what a list gives.
#[derive(Clone, Copy, Debug, Default, PartialEq, clap::Args)]
pub struct Assumed {
    /// Start of the used part of trials whose list gives no start_s above 0, in seconds [default: 0]
    #[arg(long = "start", value_name = "S", value_parser = not_negative)]
    pub start_s: Option<f64>,
    /// Duration of a trial whose list gives no duration_s, in seconds [default: to its end]
    #[arg(long = "duration", value_name = "S", value_parser = positive)]
    pub duration_s: Option<f64>,
    /// Sample rate of the recordings, in hertz, before that of a header or of times [default: as they say]
    #[arg(long = "sample-rate", value_name = "HZ", value_parser = positive)]
    pub sample_rate_hz: Option<f64>,
    /// Unit of the times of CSV recordings [default: as in the column's name, or by their steps]
    #[arg(long, value_enum, value_name = "UNIT")]
    pub time_unit: Option<TimeUnit>,
    /// Take the samples of CSV recordings as evenly spaced, at the mean rate of their times or at --sample-rate
    #[arg(long)]
    pub even_times: bool,
    /// Acceleration of a sample of 1 (the full scale of a WAV's integers) of trials whose list gives no scale_m_s2: in
    /// m/s², or as a unit, such as g, mg, mm/s^2, or g/256 for 256 counts per g [default: by the header, or 1]
    #[arg(long = "scale", visible_alias = "unit", value_name = "M_S2", value_parser = scale)]
    pub scale_m_s2: Option<f64>,
    /// Tangential speed of recordings given without a list, in mm/s [default: 100]
    #[arg(long = "speed", value_name = "MM_S", value_parser = recorded_speed)]
    pub speed_mm_s: Option<f64>,
    /// Normal force of recordings given without a list, in newtons [default: 1]
    #[arg(long = "force", value_name = "N", value_parser = recorded_force)]
    pub force_n: Option<f64>,
}

// The help shows the numbers, so they are written out above.
const _: () = assert!(NOMINAL_SPEED_MM_S == 100.0 && NOMINAL_FORCE_N == 1.0);

impl Assumed {
    /// Returns a note on the speed or force that recordings without a list have because it was not given; `None` if
    /// both were given.
    pub fn nominal_motion(&self) -> Option<String> {
        let speed = (self.speed_mm_s.is_none()).then(|| format!("{NOMINAL_SPEED_MM_S} mm/s"));
        let force = (self.force_n.is_none()).then(|| format!("{NOMINAL_FORCE_N} N"));
        let (taken, remedy) = match (speed, force) {
            (Some(speed), Some(force)) => (format!("{speed} and {force}"), "--speed and --force"),
            (Some(speed), None) => (speed, "--speed"),
            (None, Some(force)) => (force, "--force"),
            (None, None) => return None,
        };
        Some(format!(
            "without a list, recordings are taken as made at {taken}: give {remedy}, or a list"
        ))
    }
}

/// A set of trials, in the order of their list.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingSet {
    /// The trials, at least one.
    pub trials: Vec<Trial>,
    /// True if speeds and forces come from a list; otherwise they are nominal.
    pub is_listed: bool,
}

impl RecordingSet {
    /// Opens the inputs of a command: one folder with a `trials.csv`, one list of any name, or recordings. Given
    /// individually, each recording is a separate texture, named after the file, at the nominal speed and force.
    ///
    /// # Errors
    /// No input is given, a folder has no list or is not given alone, a list cannot be read or has no trials, or one of
    /// its lines cannot be used; the error then states the line's number. Recordings that are missing are no error
    /// here.
    pub fn open(inputs: &[PathBuf]) -> Result<Self> {
        let set = match inputs {
            [] => {
                return Err(Error::Request(
                    "no recordings given: name a folder, a list or files".into(),
                ));
            }
            [folder] if files::is_dir(folder) && !files::exists(&folder.join(TRIALS_FILE)) => {
                let problem = format!(
                    "has no {TRIALS_FILE}, the list of its recordings: `{}` makes one of the files' names",
                    list_command(folder, "{texture}_{speed}mms_{force}N", usual_ending(folder))
                );
                return Err(Error::file(folder, problem));
            }
            [folder] if files::is_dir(folder) => Self::from_list(&folder.join(TRIALS_FILE))?,
            [file] if file.file_name().is_some_and(|name| name == TRIALS_FILE) || is_list(file) => {
                Self::from_list(file)?
            }
            files => Self::from_files(files)?,
        };
        refuse_single_axes(&set.trials)?;
        Ok(set)
    }

    /// Opens inputs like [`RecordingSet::open`], with values for what they lack.
    pub fn open_with(inputs: &[PathBuf], assumed: &Assumed) -> Result<Self> {
        for input in inputs {
            if let Err(source) = files::found(input) {
                return Err(absent("open", input, source));
            }
        }
        let mut set = Self::open(inputs)?;
        for trial in &mut set.trials {
            if trial.start_s <= 0.0 {
                trial.start_s = assumed.start_s.unwrap_or(0.0);
            }
            trial.duration_s = trial.duration_s.or(assumed.duration_s);
            trial.scale_m_s2 = trial.scale_m_s2.or(assumed.scale_m_s2);
            trial.sample_rate_hz = trial.sample_rate_hz.or(assumed.sample_rate_hz);
            trial.time_unit = trial.time_unit.or(assumed.time_unit);
            trial.has_even_times = trial.has_even_times.or(assumed.even_times.then_some(true));
            if !set.is_listed {
                trial.speed_mm_s = assumed.speed_mm_s.unwrap_or(NOMINAL_SPEED_MM_S);
                trial.force_n = assumed.force_n.unwrap_or(NOMINAL_FORCE_N);
            }
        }
        Ok(set)
    }

    fn from_files(files: &[PathBuf]) -> Result<Self> {
        let trials = files
            .iter()
            .map(|file| {
                if files::is_dir(file) {
                    let problem = "is a folder: give it alone, or recordings only; beside a library, by --recordings";
                    return Err(Error::file(file, problem));
                }
                let stem = file.file_stem().unwrap_or_default();
                Ok(Trial::of(
                    file.clone(),
                    stem.to_string_lossy().into_owned(),
                    NOMINAL_SPEED_MM_S,
                    NOMINAL_FORCE_N,
                ))
            })
            .collect::<Result<Vec<Trial>>>()?;
        let mut named: HashMap<&str, &Path> = HashMap::new();
        for trial in &trials {
            let first = *named.entry(&trial.texture).or_insert(&trial.file);
            if first != trial.file {
                let problem = format!(
                    "has the name of {}, and a file is a texture by its name: rename one of them, or give a list, as \
                     `stylus trials FOLDER --pattern '{{texture}}/{{*}}.csv'` makes",
                    first.display()
                );
                return Err(Error::file(&trial.file, problem));
            }
        }
        Ok(Self {
            trials,
            is_listed: false,
        })
    }

    /// Reads a list of trials, whose files are relative to the list's folder.
    ///
    /// # Errors
    /// The list is missing or empty, or a line cannot be used. The error states the line's number.
    pub fn from_list(list: &Path) -> Result<Self> {
        Ok(Self {
            trials: read_list(list)?,
            is_listed: true,
        })
    }

    /// Returns whether any recording is simulated.
    pub fn is_simulated(&self) -> bool {
        let mut trials = self.trials.iter();
        trials.any(|trial| trial.provenance == Provenance::Simulated)
    }

    /// Returns the textures' names, each once, in the order of their first trials.
    pub fn textures(&self) -> Vec<&str> {
        self.by_texture().into_iter().map(|(name, _)| name).collect()
    }

    /// Returns the textures' names, in the order of their first trials, with the indices of the trials of each.
    pub fn by_texture(&self) -> Vec<(&str, Vec<usize>)> {
        // The map finds a group at once, and the list keeps the order.
        let mut numbers: HashMap<&str, usize> = HashMap::new();
        let mut groups: Vec<(&str, Vec<usize>)> = Vec::new();
        for (index, trial) in self.trials.iter().enumerate() {
            let name = trial.texture.as_str();
            let number = *numbers.entry(name).or_insert(groups.len());
            if number == groups.len() {
                groups.push((name, Vec::new()));
            }
            groups[number].1.push(index);
        }
        groups
    }

    /// Returns the set of only the trials with these `indices`.
    #[must_use]
    pub fn part(&self, indices: &[usize]) -> Self {
        let trials = indices.iter().map(|&index| self.trials[index].clone());
        Self {
            trials: trials.collect(),
            is_listed: self.is_listed,
        }
    }
}

/// Refuses files that are each an axis of one recording: names that differ in an X, Y or Z at their end.
fn refuse_single_axes(trials: &[Trial]) -> Result<()> {
    let mut found: HashMap<(&Path, String), Vec<&Path>> = HashMap::new();
    for trial in trials {
        let file = trial.file.as_path();
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let axis = stem.strip_suffix(['x', 'y', 'z', 'X', 'Y', 'Z']);
        let Some(rest) = axis.filter(|rest| rest.ends_with(['_', '-', ' ', '.'])) else {
            continue;
        };
        let axes = found
            .entry((file.parent().unwrap_or(file), rest.to_owned()))
            .or_default();
        // A trial may use another part of a file.
        if !axes.contains(&file) {
            axes.push(file);
        }
        if let [first, .., last] = axes[..]
            && axes.len() == MAX_CHANNELS
        {
            let (to, last) = (rest.trim_end_matches(['_', '-', ' ', '.']), last.display());
            let problem = format!(
                "and {last} are axes of one recording by their names, and no takes: join the three, such as by \
                 `paste -d , X Y Z > {to}.csv`, or `sox -M X Y Z {to}.wav` for sound; or rename them"
            );
            return Err(Error::file(first, problem));
        }
    }
    Ok(())
}

/// Returns the command that creates the list of a folder whose files have names of this pattern and this extension.
pub fn list_command(folder: &Path, pattern: &str, ending: &str) -> String {
    let folder = match folder.to_str() {
        // The current folder.
        Some("") => ".".into(),
        Some(name) if name.contains(char::is_whitespace) => format!("'{name}'").into(),
        _ => folder.to_string_lossy(),
    };
    format!("stylus trials {folder} --pattern '{pattern}.{ending}'")
}

/// Returns the usual extension of the files in `folder`: that of tables if there are more tables than WAV files,
/// otherwise that of WAV files.
fn usual_ending(folder: &Path) -> &'static str {
    let files = files::entries(folder).into_iter().flatten().flatten();
    let has_ending = |name: &Path, ending: &str| name.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending));
    let (mut tables, mut sounds) = (0_usize, 0_usize);
    for file in files {
        tables += usize::from(has_ending(Path::new(&file.name), "csv"));
        sounds += usize::from(has_ending(Path::new(&file.name), "wav"));
    }
    if tables > sounds { "csv" } else { "wav" }
}

/// Returns whether the file at `path` is a list of trials, according to the names in its first line.
pub fn is_list(path: &Path) -> bool {
    if Kind::of(path) != Some(Kind::Table) {
        return false;
    }
    let Ok(table) = CsvTable::read(path, Format::Trials) else {
        return false;
    };
    let Ok(header) = table.header() else {
        return false;
    };
    ["file", "texture"]
        .iter()
        .all(|known| header.names().any(|name| is_named(name, known)))
}

/// Reads a list of trials, whose files are relative to the list's folder.
///
/// # Errors
/// The list is missing or empty, or a line cannot be used. The error states the line's number.
fn read_list(list: &Path) -> Result<Vec<Trial>> {
    // Only regular files are accepted, because a list is read again to determine its kind.
    Format::Trials.open(list)?;
    let table = CsvTable::read(list, Format::Trials)?;
    let columns = Columns::of(&table.header()?)?;
    let folder = list.parent().unwrap_or(Path::new("."));
    let (mut rows, mut trials) = (table.rows_below_header()?, Vec::new());
    while let Some(row) = rows.next_row()? {
        if trials.len() == MOST_TRIALS {
            let problem = format!("lists more than {MOST_TRIALS} trials: make several lists");
            return Err(row.error(problem));
        }
        trials.push(columns.trial(folder, &row)?);
    }
    if trials.is_empty() {
        return Err(Error::file(list, "lists no trials: add at least one line"));
    }
    Ok(trials)
}

/// Indices of a list's columns, by name.
struct Columns(HashMap<&'static str, usize>);

/// Largest number of trials in a list: ten times those of a large laboratory, at about 1 kB of memory each.
pub const MOST_TRIALS: usize = 100_000;

/// Columns of a list. The first four must be there.
pub const LIST_COLUMNS: [&str; 11] = [
    "file",
    "texture",
    "speed_mm_s",
    "force_n",
    "scale_m_s2",
    "start_s",
    "duration_s",
    "sample_rate_hz",
    "time_unit",
    "even_times",
    "simulated",
];
const REQUIRED: usize = 4;

/// Columns for the user's own remarks, which are not read.
const REMARKS: [&str; 6] = ["note", "notes", "comment", "remark", "remarks", "take"];

/// Returns the value of the `text` of a true-or-false column `name`; `None` if it is empty.
fn truth(name: &str, text: Option<&str>) -> std::result::Result<Option<bool>, String> {
    let unlike = |text| format!("{name} '{text}' is not true or false");
    text.map(|text| text.parse().map_err(|_| unlike(text))).transpose()
}

fn provenance_of(is_simulated: Option<bool>) -> Provenance {
    match is_simulated {
        Some(true) => Provenance::Simulated,
        _ => Provenance::Recorded,
    }
}

/// Returns the unit of times that `text` names; `None` if it is empty.
fn time_unit(text: Option<&str>) -> std::result::Result<Option<TimeUnit>, String> {
    let unit = |text: &str| {
        let names = TimeUnit::value_variants().iter().map(|unit| unit.name());
        let unlike = |_| format!("time_unit '{text}' is none of {}", names.collect::<Vec<_>>().join(", "));
        TimeUnit::from_str(text, false).map_err(unlike)
    };
    text.map(unit).transpose()
}

impl Columns {
    fn of(header: &Header<'_>) -> Result<Self> {
        let (required, optional) = LIST_COLUMNS.split_at(REQUIRED);
        let expected = format!(
            "the columns of a list are {}, {}; {} are not used",
            required.join(", "),
            optional.join(", "),
            REMARKS.join(", ")
        );
        let mut columns = HashMap::new();
        for &name in required {
            columns.insert(name, header.needed(name, &expected)?);
        }
        for name in header.names() {
            let mut known = LIST_COLUMNS.iter().chain(&REMARKS);
            let Some(&known) = known.find(|known| is_named(name, known)) else {
                return Err(header.error(format!("unknown column '{name}': {expected}")));
            };
            columns.extend(header.column(known)?.map(|index| (known, index)));
        }
        Ok(Self(columns))
    }

    fn trial(&self, folder: &Path, row: &Row<'_, '_>) -> Result<Trial> {
        let bad = |problem: String| row.error(problem);
        let field = |name: &str| {
            let index = *self.0.get(name)?;
            Some((index, row.text(index))).filter(|(_, text)| !text.is_empty())
        };
        let words = |name: &str| field(name).map(|(_, text)| text);
        let text = |name: &str| words(name).ok_or_else(|| bad(format!("no {name}")));
        let number = |name: &str| match field(name) {
            None => Ok(None),
            Some((index, _)) => row.finite(index, name).map(Some),
        };
        let at_least_zero = |name: &str| match number(name)? {
            Some(value) if value < 0.0 => Err(bad(format!("{name} {value} is negative"))),
            value => Ok(value),
        };
        let above_zero = |name: &str| match number(name)? {
            Some(value) if value <= 0.0 => Err(bad(format!("{name} {value} is not above zero"))),
            value => Ok(value),
        };
        let required = |name: &str, fault: fn(f64) -> Option<String>| {
            let value = at_least_zero(name)?.ok_or_else(|| bad(format!("no {name}")))?;
            match fault(value) {
                None => Ok(value),
                Some(fault) => Err(bad(format!("{name} is {fault}"))),
            }
        };
        let truth = |name: &str| truth(name, words(name)).map_err(bad);
        let provenance = provenance_of(truth("simulated")?);
        let scale_m_s2 = number("scale_m_s2")?;
        if scale_m_s2.is_some_and(|scale| scale.abs() <= 0.0) {
            return Err(bad("scale_m_s2 is zero".into()));
        }
        let sample_rate_hz = above_zero("sample_rate_hz")?;
        if let Some(Err(fault)) = sample_rate_hz.map(|rate_hz| SampleRate::new(rate_hz, "mend it")) {
            return Err(bad(format!("sample_rate_hz is {fault}")));
        }
        let texture = text("texture")?;
        if texture.contains(char::is_control) {
            return Err(bad(format!("texture {texture:?} has a control character: rename it")));
        }
        Ok(Trial {
            scale_m_s2,
            start_s: at_least_zero("start_s")?.unwrap_or(0.0),
            duration_s: above_zero("duration_s")?,
            sample_rate_hz,
            time_unit: time_unit(words("time_unit")).map_err(bad)?,
            has_even_times: truth("even_times")?,
            provenance,
            ..Trial::of(
                folder.join(text("file")?),
                texture.to_owned(),
                required("speed_mm_s", speed_fault)?,
                required("force_n", force_fault)?,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::TRIALS_FILE;
    use super::*;
    use test_helpers::holds;

    fn parse(text: &str) -> Result<Vec<Trial>> {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join(TRIALS_FILE);
        std::fs::write(&list, text).unwrap();
        read_list(&list)
    }

    const HEADER: &str = "file,texture,speed_mm_s,force_n,scale_m_s2,start_s\n";

    #[test]
    fn columns_may_come_in_any_order_and_comments_are_skipped() {
        let trials = parse("# by hand\nforce_n,texture,file,speed_mm_s\n0.5,denim,a.wav,120\n").unwrap();
        let trial = &trials[0];
        assert_eq!((trial.speed_mm_s, trial.force_n), (120.0, 0.5));
        assert_eq!(trial.provenance, Provenance::Recorded);
        assert!(trial.file.ends_with("a.wav"));
    }

    #[test]
    fn columns_may_be_named_as_people_write_them_and_nameless_ones_may_be_empty() {
        let plain = parse("file,texture,speed_mm_s,force_n,scale_m_s2,notes\na.wav,a b,120,0.5,9.8,good\n").unwrap();
        for text in [
            "File,Texture,Speed (mm/s),Force (N),Scale (m/s²),Notes\na.wav,a b,120,0.5,9.8,good\n",
            "FILE;TEXTURE;SPEED_mm/s;Force [N];scale m/s^2;note;;\na.wav;a b;120,0;0,5;9,8;;;\n",
        ] {
            let trials = parse(text).unwrap();
            assert_eq!(trials.len(), 1);
            let with_folder = |trial: &Trial| Trial {
                file: trial.file.file_name().unwrap().into(),
                ..trial.clone()
            };
            assert_eq!(
                format!("{:?}", with_folder(&trials[0])),
                format!("{:?}", with_folder(&plain[0]))
            );
        }
        for (text, words) in [
            (
                "file,texture,Speed (cm/s),force_n\n",
                ["no column 'speed_mm_s'", "Speed (cm/s)"],
            ),
            (
                "file,texture,Force (N),force [N],speed_mm_s\n",
                ["more than one", "force_n"],
            ),
            (
                "file,texture,speed_mm_s,force_n,,\na.wav,a,1,1,,good\n",
                ["line 2", "'good' in column 6"],
            ),
        ] {
            holds(&parse(text).unwrap_err(), &words);
        }
    }

    #[test]
    fn each_file_of_a_list_may_have_times_of_its_own_and_options_are_for_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("mixed.csv");
        let header = "file,texture,speed_mm_s,force_n,time_unit,even_times\n";
        let lines = "a.csv,silk,100,1,us,false\nb.csv,silk,100,1,ms,true\nc.csv,silk,100,1,,\n";
        std::fs::write(&list, format!("{header}{lines}")).unwrap();
        let of_times = |assumed: &Assumed| {
            RecordingSet::open_with(std::slice::from_ref(&list), assumed)
                .unwrap()
                .trials
                .into_iter()
                .map(|trial| (trial.time_unit, trial.has_even_times.unwrap_or(false)))
                .collect::<Vec<_>>()
        };
        let own = [(Some(TimeUnit::Us), false), (Some(TimeUnit::Ms), true)];
        assert_eq!(of_times(&Assumed::default()), [own[0], own[1], (None, false)]);
        let assumed = Assumed {
            time_unit: Some(TimeUnit::Ns),
            even_times: true,
            ..Assumed::default()
        };
        let given = (Some(TimeUnit::Ns), true);
        assert_eq!(of_times(&assumed), [own[0], own[1], given]);
        for (fields, problem) in [
            ("min,", "time_unit 'min' is none of s, ms, us, ns"),
            (",yes", "even_times 'yes' is not true or false"),
        ] {
            let wrong = parse(&format!("{header}a.csv,silk,100,1,{fields}\n"));
            holds(&wrong.unwrap_err(), &["line 2", problem]);
        }
    }

    #[test]
    fn a_start_that_is_given_is_of_the_trials_whose_list_gives_none() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("starts.csv");
        std::fs::write(&list, format!("{HEADER}a.wav,silk,100,1,,0.5\nb.wav,silk,100,1,,\n")).unwrap();
        let assumed = Assumed {
            start_s: Some(2.0),
            ..Assumed::default()
        };
        let set = RecordingSet::open_with(&[list], &assumed).unwrap();
        assert_eq!((set.trials[0].start_s, set.trials[1].start_s), (0.5, 2.0));
    }

    #[test]
    fn a_bad_line_is_named_by_its_number() {
        for (line, word) in [
            ("a.wav,denim,fast,1,,", "speed_mm_s"),
            ("a.wav,denim,100,-1,,", "negative"),
            ("a.wav,denim,100,NaN,,", "force_n"),
            ("a.wav,,100,1,,", "texture"),
            (",denim,100,1,,", "file"),
            ("a.wav,denim,100,1,0,", "scale_m_s2"),
            ("a.wav,denim,100,1,,-1", "start_s"),
            ("a.wav,denim,100", "fields"),
        ] {
            let text = format!("{HEADER}a.wav,denim,100,1,,\n{line}\n");
            holds(&parse(&text).unwrap_err(), &["line 3", word]);
        }
    }

    #[test]
    fn headers_without_their_columns_and_lists_without_trials_are_refused() {
        for (text, word) in [
            ("file,texture,speed_mm_s\n", "force_n"),
            ("file,texture,speed_mm_s,force_n,colour\n", "colour"),
            (HEADER, "no trials"),
            ("", "no column"),
        ] {
            holds(&parse(text).unwrap_err(), &[word]);
        }
    }
}
