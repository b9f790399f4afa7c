//! What a page asks, and the answers.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use stylus_evaluation::evaluate::{self, Evaluation};
use stylus_evaluation::held_out::{Judge, judges};
use stylus_evaluation::listening::{self, Compared};
use stylus_evaluation::played;
use stylus_fit::fit::blocks::Part;
use stylus_fit::fit::record::FitRecord;
use stylus_fit::fit::{self, Options, TrialReport};
use stylus_fit::texture::library::decode_library;
use stylus_report::rub_page::{self, Clips};
use stylus_report::sound::node_seconds;
use stylus_report::{evaluation_page, listening_page};
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::{WavFormat, render_wav, write_floats_wav};
use stylus_signals::recording::triage::Verdict;
use stylus_signals::recording::{Kind, RecordingSet, TRIALS_FILE, Unscaled};
use stylus_signals::rig::{self, RigFile};
use stylus_support::bounded_file::Format;
use stylus_support::files::{self, Bytes};
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, progress};

use crate::rows::{Row, filled, listed};
use crate::zip::archive;

/// What is asked. Paths are of files in memory.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case")]
pub enum Asked {
    /// Whether a file of this size may be read at all.
    Admits {
        /// The file.
        path: PathBuf,
        /// Its size, bytes.
        size: u64,
    },
    /// Keeps the bytes that come with the request as a file.
    Put {
        /// The file.
        path: PathBuf,
    },
    /// The bytes of a file.
    Get {
        /// The file.
        path: PathBuf,
    },
    /// Removes a file or folder.
    Remove {
        /// The file or folder.
        path: PathBuf,
    },
    /// Keeps samples, which come with the request as `f32`, as a WAV file.
    Wave {
        /// The file.
        path: PathBuf,
        /// Samples per second.
        rate_hz: u32,
    },
    /// Simulates recordings of the demo's surfaces.
    Demo {
        /// The folder of recordings.
        folder: PathBuf,
    },
    /// Rows for recordings that have none.
    Rows {
        /// The folder of recordings.
        folder: PathBuf,
        /// Pattern of the files' names, or nothing.
        pattern: String,
        /// Files that have rows.
        known: Vec<String>,
    },
    /// What is in the recording of a row.
    Look {
        /// The folder of recordings.
        folder: PathBuf,
        /// The row.
        row: Row,
    },
    /// Fits a library to the rows, and keeps library and record.
    Fit {
        /// The folder of recordings.
        folder: PathBuf,
        /// The rows.
        rows: Vec<Row>,
        /// The library to write.
        library: PathBuf,
    },
    /// Judges the library, and keeps the page of the evaluation and the page to rub.
    Judge(Kept),
    /// Keeps a page of a listening test.
    Blind(Kept),
    /// Keeps a stroke over a texture as a WAV file.
    Stroke {
        /// The library.
        library: PathBuf,
        /// Index of the texture.
        texture: usize,
        /// The file.
        path: PathBuf,
    },
    /// Keeps an archive of files and folders.
    Zip {
        /// Files and folders.
        paths: Vec<PathBuf>,
        /// The archive.
        path: PathBuf,
    },
}

/// A library that was fitted to the list of a folder.
#[derive(Clone, Debug, Deserialize)]
pub struct Kept {
    folder: PathBuf,
    library: PathBuf,
    /// The page to write; of [`Asked::Judge`] that to rub.
    page: PathBuf,
    /// Folder of the evaluation's page.
    #[serde(default)]
    report: PathBuf,
}

/// An answer: what is told, and a file's bytes if they were asked for.
#[derive(Debug, Default)]
pub struct Answer {
    /// What is told.
    pub told: Value,
    /// The bytes.
    pub bytes: Bytes,
}

impl From<Value> for Answer {
    fn from(told: Value) -> Self {
        Self {
            told,
            bytes: Bytes::default(),
        }
    }
}

/// Answers what is asked; `bytes` come with it.
///
/// # Errors
/// Those of the functions that the command calls.
pub fn answer(asked: &Asked, bytes: Vec<u8>) -> Result<Answer> {
    let told = match asked {
        Asked::Admits { path, size } => {
            let format = match Kind::of(path) {
                Some(Kind::Table) => Format::Table,
                Some(Kind::Wave) | None => Format::Wave,
            };
            format.admit(path, *size)?;
            Value::Null
        }
        Asked::Put { path } => {
            files::put(path, bytes);
            Value::Null
        }
        Asked::Get { path } => {
            let bytes = files::held(path).ok_or_else(|| Error::Request(format!("no file {}", path.display())))?;
            return Ok(Answer {
                told: Value::Null,
                bytes,
            });
        }
        Asked::Remove { path } => {
            files::remove(path);
            Value::Null
        }
        Asked::Wave { path, rate_hz } => {
            let (samples, _) = bytes.as_chunks();
            let samples = samples.iter().map(|bytes| f32::from_le_bytes(*bytes));
            write_floats_wav(path, *rate_hz, samples)?;
            Value::Null
        }
        Asked::Demo { folder } => demo(folder)?,
        Asked::Rows { folder, pattern, known } => json!(filled(folder, pattern, known)?),
        Asked::Look { folder, row } => look(folder, row)?,
        Asked::Fit { folder, rows, library } => fitted(folder, rows, library)?,
        Asked::Judge(kept) => judge(kept)?,
        Asked::Blind(kept) => blind(kept)?,
        Asked::Stroke { library, texture, path } => stroke(library, *texture, path)?,
        Asked::Zip { paths, path } => zip(paths, path)?,
    };
    Ok(told.into())
}

/// Speeds and forces of the demo's recordings here: fewer than `stylus demo` simulates, so that a visitor waits for
/// seconds.
const DEMO: [(&str, &str); 2] = [
    ("speeds_mm_s = ", "[40, 100, 160, 220, 280]"),
    ("forces_n = ", "[0.4, 0.8, 1.2]"),
];

/// Simulates the recordings. Returns the paths of these and of their list.
fn demo(folder: &Path) -> Result<Value> {
    let full = RigFile::demo();
    let line = |line: &str| {
        let fewer = DEMO.iter().find(|(key, _)| line.starts_with(key));
        fewer.map_or_else(|| format!("{line}\n"), |(key, values)| format!("{key}{values}\n"))
    };
    let text: String = full.text().lines().map(line).collect();
    let rig = RigFile::from_toml(Path::new("rig.toml"), &text)?;
    rig::simulate(&rig, 1, folder)?;
    let set = RecordingSet::open(&[folder.to_owned()])?;
    let files = set.trials.iter().map(|trial| trial.file.clone());
    let files: Vec<PathBuf> = files.chain([folder.join(TRIALS_FILE)]).collect();
    // The description of the rig is no recording that somebody gave.
    for (other, _) in files::below(folder).iter().filter(|(file, _)| !files.contains(file)) {
        files::remove(other);
    }
    Ok(json!(files))
}

/// Name of the list of one row, while its recording is looked at.
const LOOK: &str = "row.csv";

/// Columns of the small picture of a recording.
const COLUMNS: usize = 60;

/// What is in a recording, as a table shows it.
#[derive(Serialize)]
struct Looked {
    /// Duration of what is used, s.
    seconds: f64,
    /// The file's own sample rate, Hz.
    rate_hz: f64,
    /// RMS, m/s²; none if the level is not known.
    rms_m_s2: Option<f64>,
    /// Lowest and highest value per column, as fractions of the largest magnitude.
    waveform: Vec<[f32; 2]>,
    /// Triage's verdicts, and what was changed in reading.
    verdicts: Vec<String>,
}

fn look(folder: &Path, row: &Row) -> Result<Value> {
    // What is missing yet must not keep a recording from being seen.
    let or = |text: &str, other: &str| if text.trim().is_empty() { other } else { text }.to_owned();
    let row = Row {
        texture: or(&row.texture, "?"),
        speed_mm_s: or(&row.speed_mm_s, "100"),
        force_n: or(&row.force_n, "1"),
        ..row.clone()
    };
    // Beside the recordings, because their paths begin there.
    let list = folder.join(LOOK);
    let set = listed(&list, std::slice::from_ref(&row));
    files::remove(&list);
    let set = set?;
    let (analysis, signal) = fit::analyse(&set.trials[0], &Options::default(), Part::Whole)?;
    let peak = signal
        .samples
        .iter()
        .fold(f64::MIN_POSITIVE, |peak, x| peak.max(x.abs()));
    let width = signal.samples.len().div_ceil(COLUMNS).max(1);
    let column = |part: &[f64]| {
        let ends = part
            .iter()
            .fold([0.0_f64; 2], |[low, high], x| [low.min(*x), high.max(*x)]);
        ends.map(|end| (end / peak) as f32)
    };
    let account = &analysis.account;
    Ok(json!(Looked {
        seconds: signal.samples.len() as f64 / f64::from(model_format::SAMPLE_RATE_HZ),
        rate_hz: analysis.source_rate_hz,
        rms_m_s2: account.unscaled.is_none().then(|| analysis.power.sqrt()),
        waveform: signal.samples.chunks(width).map(column).collect(),
        verdicts: found(&analysis.verdicts, account.unscaled, &account.remarks),
    }))
}

/// Returns what a table shows of a recording.
fn found(verdicts: &[Verdict], unscaled: Option<Unscaled>, remarks: &[String]) -> Vec<String> {
    let no_unit = "without a unit: what plays is right in itself, and its level is not known";
    let verdicts = verdicts.iter().map(ToString::to_string);
    let unscaled = unscaled.map(|_| no_unit.to_owned());
    verdicts.chain(unscaled).chain(remarks.iter().cloned()).collect()
}

fn fitted(folder: &Path, rows: &[Row], library: &Path) -> Result<Value> {
    let options = Options::default();
    let (set, moves) = listed(&folder.join(TRIALS_FILE), rows)?.snapped(options.snap)?;
    let bar = progress::bar(set.trials.len() as u64, "fitting");
    let fit = fit::fit(&set, &options, |trials| bar.inc(trials as u64))?;
    let bytes = fit.library()?;
    let record = FitRecord::of(&set, &options, &bytes)?.with_account_of(&fit);
    record.write_with(library, &bytes)?;
    let decoded = decode_library(library, &bytes)?;
    let textures = decoded
        .textures()
        .map(|texture| json!({ "name": texture.name(), "plays": played::in_words(&played::parts(&texture)) }));
    let textures: Vec<Value> = textures.collect();
    let of_trial = |own: &TrialReport| found(&own.verdicts, own.unscaled, &own.remarks);
    Ok(json!({
        "bytes": bytes.len(),
        "textures": textures,
        "trials": fit.trials.iter().map(of_trial).collect::<Vec<_>>(),
        "notes": moves.into_iter().chain(fit.warnings().iter().map(ToString::to_string)).collect::<Vec<_>>(),
    }))
}

/// What judging and pages need, read again from the files.
struct Opened {
    set: RecordingSet,
    bytes: Vec<u8>,
    record: Option<FitRecord>,
    judges: Vec<Judge>,
    options: evaluate::Options,
}

impl Opened {
    fn of(kept: &Kept) -> Result<Self> {
        let bytes = Format::Library.read(&kept.library)?;
        let record = FitRecord::beside(&kept.library, &bytes)?;
        let mut set = RecordingSet::open(std::slice::from_ref(&kept.folder))?;
        if let Some(record) = &record {
            set = record.as_fitted(set)?;
        }
        let options = evaluate::Options {
            // What the report plays at each node has to be kept while its trial is judged.
            excerpt_s: node_seconds(set.trials.len()),
            ..evaluate::Options::default()
        };
        let judges = judges(&set, Vec::new(), record.as_ref())?;
        Ok(Self {
            set,
            bytes,
            record,
            judges,
            options,
        })
    }
}

fn judge(kept: &Kept) -> Result<Value> {
    let opened = Opened::of(kept)?;
    let library = decode_library(&kept.library, &opened.bytes)?;
    let Opened {
        set,
        record,
        judges,
        options,
        ..
    } = &opened;
    let bar = progress::bar(set.trials.len() as u64, "evaluating");
    let evaluation = evaluate::evaluate(set, &library, judges.clone(), record.as_ref(), options, || bar.inc(1))?;
    let bar = progress::bar(evaluation.textures.len() as u64, "reporting");
    let inputs = evaluation_page::Inputs {
        set,
        library: &library,
        evaluation: &evaluation,
        options,
        removed_nodes: None,
        unused_takes: &[],
    };
    let report = evaluation_page::write(&inputs, &kept.report, || bar.inc(1))?;
    let bar = progress::bar(library.len() as u64, "page");
    let inputs = rub_page::Inputs {
        library: &library,
        bytes: &opened.bytes,
        recordings: Some(rub_page::JudgedRecordings {
            set,
            evaluation: &evaluation,
            conditioning: options.conditioning,
            clips: Clips::Budget,
        }),
        seed: options.seed,
        plant: None,
    };
    rub_page::write(&inputs, &kept.page, || bar.inc(1))?;
    Ok(verdicts(&evaluation, &report))
}

fn verdicts(evaluation: &Evaluation, report: &Path) -> Value {
    json!({ "verdicts": evaluation.verdicts().collect::<Vec<_>>(), "held_out": evaluation.held_out, "report": report })
}

fn blind(kept: &Kept) -> Result<Value> {
    let opened = Opened::of(kept)?;
    let library = &decode_library(&kept.library, &opened.bytes)?;
    let fitted = Compared {
        library,
        record: opened.record.as_ref(),
    };
    let evaluate = evaluate::Options::default();
    let options = listening::Options::default();
    let plan = listening::plan(&opened.set, &opened.judges, fitted, None, &evaluate, &options)?;
    listening_page::write(&plan, &kept.page)?;
    Ok(json!(plan.notes(options.excerpt_s, false)))
}

/// Motion of a stroke, as that of `stylus demo`: it speeds up, presses harder, and comes to rest.
const STROKE: &str =
    "time_s,speed_mm_s,force_n\n0,0,0\n0.5,60,0.4\n2,280,0.4\n3,120,1.2\n4.5,120,0.2\n5,0,0\n5.5,0,0\n";

/// Full scale of a stroke's sound, m/s².
const LISTENING: WavFormat = WavFormat::Pcm16 { full_scale_m_s2: 60.0 };

fn stroke(library: &Path, texture: usize, path: &Path) -> Result<Value> {
    let bytes = Format::Library.read(library)?;
    let decoded = decode_library(library, &bytes)?;
    let missing = || Error::Request(format!("the library has no texture {texture}"));
    let texture = decoded.textures().nth(texture).ok_or_else(missing)?;
    let motion = path.with_extension("csv");
    atomic_file::write(&motion, STROKE.as_bytes())?;
    let along = MotionPath::from_csv(&motion)?;
    let written = render_wav(texture, &along, along.duration_s(), 1, path, LISTENING)?;
    Ok(json!({ "clipped": written.wav.clipped }))
}

fn zip(paths: &[PathBuf], path: &Path) -> Result<Value> {
    let mut all = Vec::new();
    for path in paths {
        all.extend(files::below(path));
    }
    let names: Vec<String> = all
        .iter()
        .map(|(path, _)| stylus_support::names::portable(path))
        .collect();
    let contents = names
        .iter()
        .zip(&all)
        .map(|(name, (_, bytes))| (name.as_str(), &**bytes));
    let archive = archive(contents).ok_or_else(|| {
        Error::Request(
            "an archive has at most 65 535 files and 4 GiB: keep the library, and the recordings as they are".into(),
        )
    })?;
    files::put(path, archive);
    Ok(Value::Null)
}
