//! `stylus demo`: every step from recordings to sound, on simulated recordings.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use model_format::Library;
use stylus_evaluation::evaluate::{self, Evaluation};
use stylus_evaluation::held_out::judges;
use stylus_evaluation::played;
use stylus_fit::fit::record::FitRecord;
use stylus_fit::fit::{self, Fit};
use stylus_report::evaluation_page;
use stylus_report::rub_page::{Clips, Inputs, JudgedRecordings};
use stylus_report::sound::node_seconds;
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::{WavFormat, render_wav};
use stylus_signals::recording::RecordingSet;
use stylus_signals::rig::{self, RigFile};
use stylus_support::atomic_file;
use stylus_support::names::portable;
use stylus_support::output::OutputFolder;
use stylus_support::{Error, Result};

use super::output::{print, warn_of};
use stylus_fit::texture::library::decode_library;

/// Motion along which every texture is rendered: a stroke that speeds up, presses harder, and comes to rest.
const STROKE: &str = "\
time_s,speed_mm_s,force_n
0,0,0
0.5,60,0.4
2,280,0.4
3,120,1.2
4.5,120,0.2
5,0,0
5.5,0,0
";

/// Full scale of the renderings for listening, m/s².
const LISTENING_FULL_SCALE_M_S2: f64 = 60.0;

/// Name of the page to rub on, in the output folder.
const PAGE: &str = "page.html";

/// Name of the folder of renderings, in the output folder.
const RENDERED: &str = "render";

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for all outputs
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    /// Seed of the simulated recordings and of the syntheses
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let begin = Instant::now();
    // The demo replaces its own earlier result without asking, because nobody edits that. A folder with any other file
    // is kept.
    let page = OutputFolder::begin(&arguments.out, true)?.fill(|folder| all(arguments, folder, begin))?;
    let out = arguments.out.display();
    print(&format!(
        "Done in {:.1} s. Open in a browser, with sound:\n  \
           {out}/{PAGE}: rub, and hear clicks on 'scratched' (recorded snippets),\n    \
             a tone that follows your speed on denim (lines), paper's hiss, vinyl's hum.\n  \
           {}: recording and synthesis, to see and hear\n\
         {out}/{RENDERED} has each texture along one stroke, as WAV files.",
        begin.elapsed().as_secs_f64(),
        page.display()
    ))
}

/// Runs every step, with outputs in `folder`. Returns the path that the report's page will have at the end.
fn all(arguments: &Arguments, folder: &OutputFolder, begin: Instant) -> Result<PathBuf> {
    let out = folder.path();
    let step = |number: u32, what: &str| print(&format!("[{number}/4, {:.1} s] {what}", begin.elapsed().as_secs_f64()));

    let recordings = out.join("recordings");
    step(1, "stylus simulate-rig: SIMULATED recordings of four surfaces")?;
    rig::simulate_to_folder(&RigFile::demo(), arguments.seed, &recordings, false)?;

    step(2, "stylus fit: a model per speed and force, and what no filter holds")?;
    let set = RecordingSet::open(&[recordings])?;
    let path = out.join("textures.lib");
    let (fit, bytes, record) = fit_into(folder, &path, &set)?;
    let library = decode_library(&path, &bytes)?;
    print(&format!("  {}", parts_in_words(&library)))?;
    warn_of(&fit.warnings());

    step(3, "stylus evaluate: the device's kernel against what was not fitted")?;
    let options = evaluate::Options {
        seed: arguments.seed,
        // What the report plays at each node has to be kept while its trial is judged.
        excerpt_s: node_seconds(set.trials.len()),
        ..evaluate::Options::default()
    };
    let (evaluation, page) = evaluated(&set, &library, &record, &options, out)?;

    step(4, "stylus render and stylus page: sounds, and a page to rub")?;
    render_all(&library, arguments.seed, &created(out.join(RENDERED))?)?;

    let inputs = Inputs {
        library: &library,
        bytes: &bytes,
        recordings: Some(JudgedRecordings {
            set: &set,
            evaluation: &evaluation,
            conditioning: options.conditioning,
            clips: Clips::Budget,
        }),
        seed: arguments.seed,
        plant: None,
    };
    let rubbed = out.join(PAGE);
    super::page::write(&inputs, &rubbed)?;
    Ok(folder.named(&page))
}

/// Fits `set`, and writes library and record to `path` in `folder`.
fn fit_into(folder: &OutputFolder, path: &Path, set: &RecordingSet) -> Result<(Fit, Vec<u8>, FitRecord)> {
    let options = fit::Options::default();
    let (fit, bytes) = super::fit::fit_library(set, &options)?;
    let mut record = FitRecord::of(set, &options, &bytes)?.with_account_of(&fit);
    // The folder is renamed at the end, and the record has to name the recordings where they will be.
    for trial in &mut record.trials {
        trial.file = portable(&folder.named(Path::new(&trial.file)));
    }
    record.write_with(path, &bytes)?;
    Ok((fit, bytes, record))
}

/// Evaluates `library`, prints the answer, and writes the report into `out`. Returns the evaluation and the path of the
/// report's page.
fn evaluated(
    set: &RecordingSet,
    library: &Library<'_>,
    record: &FitRecord,
    options: &evaluate::Options,
    out: &Path,
) -> Result<(Evaluation, PathBuf)> {
    let judges = judges(set, Vec::new(), Some(record))?;
    let evaluation = super::evaluate::evaluate_set(set, library, judges, Some(record), options)?;
    print(&super::evaluate::answer(&evaluation))?;
    let reported = created(out.join("report"))?;
    let page = super::evaluate::write_report(
        &evaluation_page::Inputs {
            set,
            library,
            evaluation: &evaluation,
            options,
            removed_nodes: None,
            unused_takes: &[],
        },
        &reported,
    )?;
    Ok((evaluation, page))
}

/// Returns the parts that the textures play, each combination with the names of its textures.
fn parts_in_words(library: &Library<'_>) -> String {
    let mut by_parts: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for texture in library.textures() {
        let parts = played::in_words(&played::parts(&texture));
        by_parts.entry(parts).or_default().push(texture.name());
    }
    let plays: Vec<String> = by_parts
        .iter()
        .map(|(parts, names)| format!("{}: {parts}", names.join(", ")))
        .collect();
    plays.join("; ")
}

/// Creates `folder` and returns it.
fn created(folder: PathBuf) -> Result<PathBuf> {
    std::fs::create_dir(&folder).map_err(Error::io("create", &folder))?;
    Ok(folder)
}

fn render_all(library: &Library<'_>, seed: u64, folder: &Path) -> Result<()> {
    let stroke = folder.join("stroke.csv");
    atomic_file::write(&stroke, STROKE.as_bytes())?;
    let along = MotionPath::from_csv(&stroke)?;
    let listening = WavFormat::Pcm16 {
        full_scale_m_s2: LISTENING_FULL_SCALE_M_S2,
    };
    for texture in library.textures() {
        let path = folder.join(format!("{}_stroke_simulated.wav", texture.name()));
        render_wav(texture, &along, along.duration_s(), seed, &path, listening)?;
    }
    Ok(())
}
