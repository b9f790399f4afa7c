//! A simulated set on disk: one WAV file per trial, and the table of trials. Each file says that it is simulated.

use std::fmt;
use std::path::Path;

use rayon::prelude::*;
use stylus_support::csv_table::written;
use stylus_support::float_wav::float_wav;
use stylus_support::number::counted;
use stylus_support::output::OutputFolder;
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, files, progress};

use super::RigDescription;
use super::file::{RIG, RigFile};
use super::trial::{Strip, Trial};

/// Name of the file that states that the set is simulated. It is written before any recording.
const MARKER: &str = "SIMULATED.txt";
/// The marker's first words.
const MARKER_START: &str = "SIMULATED. Nothing in this folder was measured.";
/// Name of the table of trials. It is written after everything else.
const TRIALS: &str = "trials.csv";
/// Prefix of the name of every recording.
const RECORDING_PREFIX: &str = "simulated_";

/// Summary of the files of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Number of trials, each in its own file.
    pub trials: usize,
    /// Samples of a trial on each axis.
    pub samples_per_trial: usize,
    /// Size of all files together.
    pub bytes: u64,
    /// The textures, in the rig's order.
    pub textures: Vec<TextureSummary>,
}

/// Summary of one texture's trials.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureSummary {
    /// Name of the texture.
    pub name: String,
    /// Lowest and highest RMS, over the three axes together, of the trials in contact (force above zero), m/s²; `None`
    /// if no trial is in contact.
    pub rms_range_m_s2: Option<(f64, f64)>,
    /// Number of samples that the sensor's range cut off.
    pub clipped_samples: u64,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "SIMULATED, not measured: {} of {} samples on 3 axes, {:.1} MB",
            counted(self.trials, "trial"),
            self.samples_per_trial,
            self.bytes as f64 * 1e-6
        )?;
        for texture in &self.textures {
            write!(f, "  {}:", texture.name)?;
            match texture.rms_range_m_s2 {
                Some((low, high)) => write!(f, " RMS {low:.2} to {high:.2} m/s² in contact")?,
                None => write!(f, " never in contact")?,
            }
            match texture.clipped_samples {
                0 => writeln!(f)?,
                count => writeln!(f, ", {} clipped", counted(count, "sample"))?,
            }
        }
        Ok(())
    }
}

/// Runs every trial of `rig` with `seed` and writes them to the folder `out`.
///
/// Each trial is a WAV file `TEXTURE/simulated_SPEEDmm_s_FORCEN.wav` of 3 channels (x, y, z), 32-bit float, m/s². The
/// folder also contains `SIMULATED.txt`, a copy of the rig file (`rig.toml`), and `trials.csv`. The same rig and seed
/// give the same bytes for any number of threads.
///
/// The folder is written whole or not at all. With `overwrite`, an earlier simulated set in `out` is replaced at the
/// end.
pub fn simulate_to_folder(rig: &RigFile, seed: u64, out: &Path, overwrite: bool) -> Result<Summary> {
    let folder = OutputFolder::begin(out, overwrite)?;
    folder.fill(|folder| simulate(rig, seed, folder.path()))
}

/// Like [`simulate_to_folder`], into an empty folder.
pub fn simulate(rig: &RigFile, seed: u64, out: &Path) -> Result<Summary> {
    let description = rig.description();
    let notice = notice(rig, seed);
    atomic_file::write(&out.join(MARKER), notice.as_bytes())?;
    for texture in &description.textures {
        let folder = out.join(&texture.name);
        // Missing parent folders are not created: if an interrupt has removed the set's folder, it must not be created
        // again.
        files::create_dir(&folder).map_err(Error::io("create", &folder))?;
    }

    let recording = &description.recording;
    let (speeds, forces) = (recording.speeds_mm_s.len(), recording.forces_n.len());
    let trials = description.textures.len() * speeds * forces;
    let bar = progress::bar(trials as u64, "simulating trials");
    let mut rows = Vec::with_capacity(trials);
    for (position, texture) in description.textures.iter().enumerate() {
        let strip = Strip::new(rig, position, seed);
        let of_texture = (0..speeds * forces)
            .into_par_iter()
            .map(|i| {
                let trial = strip.trial(i / forces, i % forces);
                let row = Row::write(description, &texture.name, &trial, seed, out)?;
                bar.inc(1);
                Ok(row)
            })
            // The rows keep the order of the trials, whichever thread computed them.
            .collect::<Result<Vec<_>>>()?;
        rows.extend(of_texture);
    }
    bar.finish_and_clear();

    atomic_file::write(&out.join(RIG), rig.text().as_bytes())?;
    let table = table(description, seed, &rows);
    atomic_file::write(&out.join(TRIALS), table.as_bytes())?;
    let recordings: u64 = rows.iter().map(|row| row.bytes).sum();
    Ok(Summary {
        trials: rows.len(),
        samples_per_trial: description.recording.samples(),
        bytes: recordings + (notice.len() + rig.text().len() + table.len()) as u64,
        textures: summarise(description, &rows),
    })
}

/// The row of a trial in the table, kept after its samples are written.
struct Row {
    texture: String,
    /// Path of the file relative to the set's folder, with `/` between folders.
    file: String,
    speed_mm_s: f64,
    force_n: f64,
    rms_m_s2: f64,
    clipped: u64,
    bytes: u64,
}

impl Row {
    fn write(description: &RigDescription, texture: &str, trial: &Trial, seed: u64, out: &Path) -> Result<Self> {
        let file = format!(
            "{texture}/{RECORDING_PREFIX}{}mm_s_{}N.wav",
            trial.speed_mm_s,
            with_a_decimal(trial.force_n)
        );
        let path = out.join(&file);
        let comment = format!(
            "{}; texture {texture}, {} mm/s, {} N; channels x, y, z in m/s2",
            provenance(description, seed),
            trial.speed_mm_s,
            trial.force_n
        );
        let wav = wav_bytes(trial, description.recording.sample_rate_hz, &comment)
            .map_err(|failure| Error::file(&path, failure.to_string()))?;
        // The folder appears whole or not at all, so its recordings are written in place.
        files::write(&path, &wav).map_err(Error::io("write", &path))?;
        Ok(Self {
            texture: texture.to_owned(),
            file,
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
            rms_m_s2: trial.rms_m_s2(),
            clipped: trial.clipped,
            bytes: wav.len() as u64,
        })
    }
}

/// Returns the origin of the set, for the recordings and the table of trials.
fn provenance(description: &RigDescription, seed: u64) -> String {
    format!(
        "SIMULATED by the rig simulator, nothing here was measured; rig {:?}, seed {seed}",
        description.name
    )
}

fn notice(rig: &RigFile, seed: u64) -> String {
    let description = rig.description();
    let recording = &description.recording;
    format!(
        "{MARKER_START}\n\
         \n\
         Every recording here was computed by the rig simulator (stylus simulate-rig) from a model of\n\
         a tool dragged over a surface. No tool, no drum and no accelerometer was involved, and no result\n\
         obtained from these files is a result about a real surface.\n\
         \n\
         Rig: {} (its text is in {RIG})\n\
         Seed: {seed}\n\
         Trials: {} textures at {} speeds and {} forces, {} samples at {} Hz each, in {TRIALS}\n\
         Samples: WAV, 32-bit float, channels x (along the motion), y (across), z (normal), in m/s²\n",
        description.name,
        description.textures.len(),
        recording.speeds_mm_s.len(),
        recording.forces_n.len(),
        recording.samples(),
        recording.sample_rate_hz,
    )
}

fn table(description: &RigDescription, seed: u64, rows: &[Row]) -> String {
    let motion = |row: &Row| [row.speed_mm_s, row.force_n].map(|value| value.to_string());
    let motions: Vec<[String; 2]> = rows.iter().map(motion).collect();
    let fields = rows
        .iter()
        .zip(&motions)
        .map(|(row, [speed, force])| [row.file.as_str(), &row.texture, speed, force, "true"]);
    let header = ["file", "texture", "speed_mm_s", "force_n", "simulated"];
    let table = written([header].into_iter().chain(fields));
    format!("# {}\n{table}", provenance(description, seed))
}

fn summarise(description: &RigDescription, rows: &[Row]) -> Vec<TextureSummary> {
    description
        .textures
        .iter()
        .map(|texture| {
            let own = || rows.iter().filter(|row| row.texture == texture.name);
            let rms_range_m_s2 = own()
                .filter(|row| row.force_n > 0.0)
                .map(|row| (row.rms_m_s2, row.rms_m_s2))
                .reduce(|range, rms| (range.0.min(rms.0), range.1.max(rms.1)));
            TextureSummary {
                name: texture.name.clone(),
                rms_range_m_s2,
                clipped_samples: own().map(|row| row.clipped).sum(),
            }
        })
        .collect()
}

/// Returns a number with at least one decimal: `1.0`, `0.2`, `0.25`.
fn with_a_decimal(value: f64) -> String {
    let text = value.to_string();
    if text.contains('.') { text } else { text + ".0" }
}

/// Returns a trial as a WAV file. An extra chunk contains `comment`, so that the file says SIMULATED outside its
/// folder, too.
fn wav_bytes(trial: &Trial, sample_rate_hz: u32, comment: &str) -> hound::Result<Vec<u8>> {
    let [x, y, z] = &trial.samples_m_s2;
    let samples = (0..x.len()).flat_map(|n| [x[n], y[n], z[n]]);
    let mut bytes = float_wav(3, sample_rate_hz, samples)?;
    append_comment(&mut bytes, comment);
    Ok(bytes)
}

/// Appends a LIST chunk of type INFO with an ICMT entry (RIFF MCI, 1991), and adds its size to the RIFF header.
fn append_comment(wav: &mut Vec<u8>, comment: &str) {
    // Texts are zero-terminated, and chunks start at even offsets.
    let mut text = comment.as_bytes().to_vec();
    text.push(0);
    let text_length = text.len() as u32;
    if text.len() % 2 == 1 {
        text.push(0);
    }
    wav.extend_from_slice(b"LIST");
    wav.extend_from_slice(&(12 + text.len() as u32).to_le_bytes());
    wav.extend_from_slice(b"INFOICMT");
    wav.extend_from_slice(&text_length.to_le_bytes());
    wav.extend_from_slice(&text);
    let riff_length = wav.len() as u32 - 8;
    wav[4..8].copy_from_slice(&riff_length.to_le_bytes());
}
