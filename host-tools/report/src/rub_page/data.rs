//! The page's data, written as JSON into its element `data`. A field whose name ends in `_base64` holds little-endian
//! numbers in Base64.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use model_format::scene::{MotionOfScene, Scene};
use model_format::{Provenance, Texture};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};
use stylus_fit::fit;
use stylus_fit::texture::grid::as_written;
use stylus_kernel::digest::{DIGEST_SEED, DIGEST_WORDS, of_plan};
use stylus_kernel::scene::Plan;
use stylus_signals::playing::wavefront::Wavefront;
use stylus_signals::recording::Trial;
use stylus_support::Result;
use stylus_support::number::significant;

use super::clips::{Clip, Thinning};
use super::spectra::{STEPS_PER_DB, Spectrum, TipData, band_centres_hz, model_spectrum, recorded_spectrum};
use super::{Inputs, JudgedRecordings, KERNEL, KERNEL_BUILT_BY};

/// Version of the data's format.
const VERSION: u32 = 2;

/// Largest number of textures that the title names.
const MOST_IN_TITLE: usize = 4;

/// Crest factor (peak over RMS) that filtered Gaussian noise hardly exceeds.
const NOISE_PEAK: f64 = 4.0;

/// Crest factor of textures with codebooks. In 30 s of each of twelve real surfaces, at most 0.023 %
/// of the samples exceed it, and up to 0.97 % exceed [`NOISE_PEAK`].
const LIVELY_PEAK: f64 = 10.0;

/// All data.
#[derive(Serialize)]
pub struct Data {
    version: u32,
    stylus: &'static str,
    pub title: String,
    pub simulated: bool,
    kernel: Value,
    seed: u64,
    digest: DigestData,
    pub frequencies_hz: Vec<f64>,
    pub full_scale_m_s2: f64,
    pub textures: Vec<TextureData>,
    scenes: Vec<Value>,
    pub clips: Vec<Clip>,
    clip_note: String,
    plant: Option<TipData>,
}

#[derive(Serialize)]
struct DigestData {
    words: u32,
    seed: u64,
    of_textures: Vec<String>,
}

/// A texture.
#[derive(Serialize)]
pub struct TextureData {
    pub name: String,
    simulated: bool,
    pub level_is_known: bool,
    sample_rate_hz: u32,
    bytes: usize,
    pub speeds_mm_s: Vec<f64>,
    pub forces_n: Vec<f64>,
    rms_m_s2: f64,
    highest_rms_m_s2: f64,
    can_leave_out: PartsData,
    level_law: String,
    /// Verdict on the model beside the recordings, in words.
    verdict: Option<String>,
    pub nodes: NodesData,
    /// Upper bound of the levels of all spectra, dB; negative infinity for a silent texture.
    pub top_db: f64,
    /// One byte per node and band: the mean power density at which the node is played, without lines, in steps of 0.5
    /// dB below `top_db`, in dB re 1 (m/s²)²/Hz. 255 stands for silence.
    model_base64: String,
    /// The same for the recordings, with their lines.
    recorded_base64: Option<String>,
}

#[derive(Serialize)]
struct PartsData {
    codebooks: bool,
    lines: Vec<Value>,
}

impl PartsData {
    fn of(texture: &Texture<'_>) -> Self {
        Self {
            codebooks: texture.excitation().is_some(),
            lines: (texture.lines().iter())
                .flat_map(|lines| lines.iter().map(|line| as_written(line.wavelength_mm())))
                .map(|wavelength_mm| json!({ "wavelength_mm": wavelength_mm }))
                .collect(),
        }
    }
}

/// Values of a texture's nodes, speed-major. A node's index is speed index times number of forces plus force index.
#[derive(Serialize)]
pub struct NodesData {
    orders: Vec<usize>,
    pub rms_m_s2: Vec<f64>,
    /// The bits of [`model_format::NodeFlags`].
    flags: Vec<u8>,
    /// C as a ratio, not in percent; `None` if no node has a C.
    pub costs: Option<Vec<Option<f64>>>,
}

impl NodesData {
    fn of(texture: &Texture<'_>, recorded: &[Recorded]) -> Self {
        let levels = texture
            .nodes()
            .map(|node| significant(f64::from(node.output_power).sqrt()));
        let costs: Vec<Option<f64>> = (recorded.iter()).map(|node| node.cost.map(significant)).collect();
        Self {
            orders: texture.nodes().map(|node| node.coefficients.order()).collect(),
            rms_m_s2: levels.collect(),
            flags: texture.nodes().map(|node| node.flags.bits()).collect(),
            costs: costs.iter().any(Option::is_some).then_some(costs),
        }
    }
}

impl Data {
    /// Collects the data of `inputs`, and calls `progress` after each texture.
    pub fn of(inputs: &Inputs<'_>, progress: impl Fn()) -> Result<Self> {
        let library = inputs.library;
        let thinning = inputs.recordings.map(|recordings| Thinning::of(library, &recordings));
        let mut textures = Vec::new();
        let mut clips = Vec::new();
        for (index, texture) in library.textures().enumerate() {
            let found = inputs.recordings.zip(thinning.as_ref());
            textures.push(TextureData::of(index, &texture, found, &mut clips)?);
            progress();
        }
        let digests = library.textures().collect::<Vec<_>>();
        // Each digest takes a rendering of 10 s.
        let digests = digests.into_par_iter().map(|texture| {
            let digest = of_plan::<Wavefront>(Plan::of_texture(texture));
            format!("{:08x}", digest.value())
        });
        let loudest = textures.iter().map(TextureData::peak_m_s2).fold(0.0, f64::max);
        let names: Vec<&str> = textures.iter().map(|one| one.name.as_str()).collect();
        Ok(Self {
            version: VERSION,
            stylus: env!("CARGO_PKG_VERSION"),
            title: match names.len() {
                0..=MOST_IN_TITLE => format!("Rub {}", in_words(&names)),
                many => format!("Rub one of {many} textures"),
            },
            simulated: textures.iter().any(|one| one.simulated),
            kernel: json!({ "bytes": KERNEL.len(), "built_by": KERNEL_BUILT_BY.trim() }),
            seed: inputs.seed,
            digest: DigestData {
                words: DIGEST_WORDS,
                seed: DIGEST_SEED,
                of_textures: digests.collect(),
            },
            frequencies_hz: band_centres_hz().map(|hz| rounded(hz, 100.0)).collect(),
            full_scale_m_s2: significant(loudest),
            scenes: library.scenes().map(|scene| scene_data(&scene)).collect(),
            clip_note: thinning.map_or_else(
                || "No recordings are in this page.".to_owned(),
                |thinning| thinning.in_words(clips.len()),
            ),
            textures,
            clips,
            plant: (inputs.plant).map(|(name, plant)| TipData::of(name, plant)),
        })
    }

    /// Returns each texture's name and digest.
    pub fn digests(&self) -> Vec<(String, String)> {
        self.textures
            .iter()
            .map(|texture| texture.name.clone())
            .zip(self.digest.of_textures.iter().cloned())
            .collect()
    }
}

/// Results of a node's recordings.
#[derive(Default)]
struct Recorded {
    spectrum: Option<Spectrum>,
    cost: Option<f64>,
    clip: Option<Clip>,
}

impl TextureData {
    /// Returns the acceleration that samples of the loudest node hardly exceed, m/s².
    fn peak_m_s2(&self) -> f64 {
        self.highest_rms_m_s2
            * if self.can_leave_out.codebooks {
                LIVELY_PEAK
            } else {
                NOISE_PEAK
            }
    }

    fn of(
        index: usize,
        texture: &Texture<'_>,
        found: Option<(JudgedRecordings<'_>, &Thinning)>,
        clips: &mut Vec<Clip>,
    ) -> Result<Self> {
        let speeds: Vec<f32> = texture.speed_axis().values().collect();
        let forces: Vec<f32> = texture.force_axis().values().collect();
        let rate_hz = f64::from(texture.sample_rate_hz());
        let places: Vec<(usize, usize)> = (0..speeds.len())
            .flat_map(|speed| (0..forces.len()).map(move |force| (speed, force)))
            .collect();
        let models: Vec<Spectrum> = places
            .par_iter()
            .map(|&(speed, force)| model_spectrum(&texture.node(speed, force), rate_hz))
            .collect();
        let verdict = found.and_then(|(recordings, _)| {
            let mut textures = recordings.evaluation.textures.iter();
            let own = textures.find(|own| own.texture == texture.name());
            own.map(|own| own.verdict.clone())
        });
        let recorded = places
            .par_iter()
            .map(|&place| match found {
                Some((recordings, thinning)) => recorded_at(index, texture, place, &recordings, thinning),
                None => Ok(Recorded::default()),
            })
            .collect::<Result<Vec<_>>>()?;
        let any_recorded = recorded.iter().any(|node| node.spectrum.is_some());
        let all = recorded.iter().filter_map(|node| node.spectrum.as_ref());
        let highest_db = models
            .iter()
            .chain(all)
            .map(Spectrum::highest_db)
            .fold(f64::NEG_INFINITY, f64::max);
        // A code is unsigned and counts steps downwards, so no level may be above the top.
        let top_db = (STEPS_PER_DB * highest_db).ceil() / STEPS_PER_DB;
        let recorded_base64 = any_recorded.then(|| {
            let silence = Spectrum::silence();
            let of_node = |node: &Recorded| node.spectrum.as_ref().unwrap_or(&silence).codes(top_db);
            STANDARD.encode(recorded.iter().flat_map(of_node).collect::<Vec<u8>>())
        });
        let model_codes: Vec<u8> = models.iter().flat_map(|model| model.codes(top_db)).collect();
        let nodes = NodesData::of(texture, &recorded);
        clips.extend(recorded.into_iter().filter_map(|node| node.clip));
        let mean_power = texture.nodes().map(|node| f64::from(node.output_power)).sum::<f64>() / places.len() as f64;
        Ok(Self {
            name: texture.name().to_owned(),
            simulated: texture.provenance() == Provenance::Simulated,
            level_is_known: texture.provenance() != Provenance::Unscaled,
            sample_rate_hz: texture.sample_rate_hz(),
            bytes: texture.coefficient_bytes() + part_bytes(texture),
            speeds_mm_s: speeds.iter().map(|&v| as_written(v)).collect(),
            forces_n: forces.iter().map(|&f| as_written(f)).collect(),
            rms_m_s2: significant(mean_power.sqrt()),
            highest_rms_m_s2: significant(f64::from(texture.max_output_power()).sqrt()),
            can_leave_out: PartsData::of(texture),
            level_law: texture.level_law().to_string(),
            verdict,
            nodes,
            top_db,
            model_base64: STANDARD.encode(model_codes),
            recorded_base64,
        })
    }
}

fn recorded_at(
    index: usize,
    texture: &Texture<'_>,
    (speed, force): (usize, usize),
    recordings: &JudgedRecordings<'_>,
    thinning: &Thinning,
) -> Result<Recorded> {
    let (speed_mm_s, force_n) = (texture.speed(speed).0, texture.force(force).0);
    let is_here = |name: &str, speed: f64, force: f64| {
        // A library's axes are the recordings' own values rounded to `f32`, so equal values compare as equal.
        name == texture.name() && (speed as f32, force as f32) == (speed_mm_s, force_n)
    };
    let set = recordings.set;
    let of_node = |trial: &Trial| is_here(&trial.texture, trial.speed_mm_s, trial.force_n);
    let trials: Vec<usize> = (0..set.trials.len())
        .filter(|&trial| of_node(&set.trials[trial]))
        .collect();
    let signals = trials
        .iter()
        .map(|&trial| Ok(fit::signal(&set.trials[trial], recordings.conditioning)?.samples))
        .collect::<Result<Vec<Vec<f64>>>>()?;
    let judged = recordings
        .evaluation
        .trials
        .iter()
        .filter(|trial| is_here(&trial.texture, trial.speed_mm_s, trial.force_n));
    let costs: Vec<f64> = judged.filter_map(|trial| trial.scores.cost).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    // The longest is the likeliest to hold a whole clip.
    let longest = (trials.iter().zip(&signals)).max_by_key(|(_, signal)| signal.len());
    let clip = longest
        .filter(|_| thinning.keeps(speed, force))
        .and_then(|(&trial, signal)| {
            let node = speed * texture.force_axis().len() + force;
            let place = (index, node, as_written(speed_mm_s), as_written(force_n));
            let samples = thinning.samples();
            Clip::of(place, &set.trials[trial].file, signal, samples)
        });
    Ok(Recorded {
        spectrum: recorded_spectrum(&signals),
        cost: (!costs.is_empty()).then(|| mean(&costs)),
        clip,
    })
}

fn part_bytes(texture: &Texture<'_>) -> usize {
    texture.parts().map(|(_, bytes)| bytes).sum()
}

fn scene_data(scene: &Scene) -> Value {
    let constant = match scene.motion {
        MotionOfScene::Followed => Value::Null,
        MotionOfScene::Constant { speed_mm_s, force_n } => {
            json!({ "speed_mm_s": as_written(speed_mm_s), "force_n": as_written(force_n) })
        }
    };
    let surfaces = scene.surfaces.iter().map(|surface| {
        let tap_hz = surface.tap.map(|tap| as_written(tap.frequency_hz));
        let period_mm = surface.stick_slip.map(|slip| as_written(slip.period_mm));
        json!({
            "texture": surface.texture,
            "gain": as_written(surface.gain),
            "tap": tap_hz.map(|frequency_hz| json!({ "frequency_hz": frequency_hz })),
            "stick_slip": period_mm.map(|period_mm| json!({ "period_mm": period_mm })),
        })
    });
    let regions = scene.regions.iter().map(|region| {
        json!({
            "start_mm": as_written(region.start_mm),
            "end_mm": as_written(region.end_mm),
            "surface": region.surface,
        })
    });
    json!({
        "name": scene.name.as_str(),
        "sample_rate_hz": scene.sample_rate_hz,
        "transition_mm": as_written(scene.transition_mm),
        "constant": constant,
        "equaliser_sections": scene.equaliser.len(),
        "surfaces": surfaces.collect::<Vec<_>>(),
        "regions": regions.collect::<Vec<_>>(),
    })
}

/// Returns the names as a list in words.
fn in_words(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

fn rounded(value: f64, steps_per_unit: f64) -> f64 {
    (value * steps_per_unit).round() / steps_per_unit
}
