//! A library as one page to rub on, by pointer or touch: kernel, library, the recordings' clips and spectra, style and
//! scripts are in it, and its content security policy forbids every request.
//!
//! The kernel is the device's own, compiled to the WebAssembly module of `host-tools/browser`, whose page specifies the
//! form of the data. The compiled module is kept next to this file, so that a page can be written without a compiler. A
//! test compiles the module again and compares the bytes.
//!
//! The page's pictures are axes, in which its scripts draw.

mod clips;
mod data;
mod spectra;
#[cfg(test)]
mod tests;

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use data::Data;
use model_format::Library;
use stylus_evaluation::evaluate::Evaluation;
use stylus_fit::fit::conditioning::Conditioning;
use stylus_fit::texture::library::unknown_levels;
use stylus_plant::Plant;
use stylus_signals::recording::RecordingSet;
use stylus_support::visible::page_json;
use stylus_support::{Result, atomic_file};

use super::html::escaped;
use crate::plot::{COST, Caption, Quantity, Scale, Svg, map_axes, spectrum_axes, waveform_axes};

/// The kernel as a WebAssembly module, as `cargo tasks browser-module` builds it.
pub const KERNEL: &[u8] = include_bytes!("kernel.wasm");

/// Name and version of the compiler that built [`KERNEL`].
pub const KERNEL_BUILT_BY: &str = include_str!("kernel.txt");

/// Duration of the clips of recordings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clips {
    /// As long as a budget of the page's size allows. If there are many nodes, only some have clips.
    Budget,
    /// This number of seconds at every recorded node, however large the page becomes.
    Seconds(f64),
}

/// The recordings that a library was fitted to, and their comparison with it.
#[derive(Clone, Copy)]
pub struct JudgedRecordings<'a> {
    /// The recordings.
    pub set: &'a RecordingSet,
    /// The library's comparison with them.
    pub evaluation: &'a Evaluation,
    /// Reduction of the axes to one signal, the same as in the fit.
    pub conditioning: Conditioning,
    /// Duration of the recordings' clips.
    pub clips: Clips,
}

/// The contents of a page.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// The library.
    pub library: &'a Library<'a>,
    /// Bytes of the library.
    pub bytes: &'a [u8],
    /// The recordings, if there are any.
    pub recordings: Option<JudgedRecordings<'a>>,
    /// Seed with which the page starts.
    pub seed: u64,
    /// A plant with its name. The page has a switch to hear its tip.
    pub plant: Option<(&'a str, &'a Plant)>,
}

/// The page's content security policy: nothing is fetched from anywhere. Scripts may compile the kernel, and the script
/// of the sound's own thread is loaded from the page itself.
const POLICY: &str = "default-src 'none'; img-src data:; media-src data: blob:; style-src 'unsafe-inline'; \
     script-src 'unsafe-inline' 'wasm-unsafe-eval' data:; base-uri 'none'; form-action 'none'";

/// Placeholder in the page's body for the notice, if there is one.
const NOTICE_MARK: &str = "<!--notice-->";

/// Scripts of the sound's thread, in the order in which they are loaded.
const WORKLET: [&str; 4] = [
    include_str!("kernel.js"),
    include_str!("resampler.js"),
    include_str!("voices.js"),
    include_str!("worklet.js"),
];

/// Scripts of the page, in the order in which they are loaded.
const SCRIPTS: [&str; 16] = [
    include_str!("kernel.js"),
    include_str!("voices.js"),
    include_str!("data.js"),
    include_str!("hash.js"),
    include_str!("spectrum.js"),
    include_str!("stroke.js"),
    include_str!("pointer.js"),
    include_str!("keyboard.js"),
    include_str!("embedding.js"),
    include_str!("pictures.js"),
    include_str!("patch.js"),
    include_str!("files.js"),
    include_str!("silence.js"),
    include_str!("tip.js"),
    include_str!("sound.js"),
    include_str!("page.js"),
];

/// Properties of a page that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Size of the page, bytes.
    pub bytes: usize,
    /// True if any texture was fitted to simulated recordings.
    pub simulated: bool,
    /// Number of clips.
    pub clips: usize,
    /// Name and digest of each texture; see [`stylus_kernel::digest`].
    pub digests: Vec<(String, String)>,
}

/// Writes the page, and calls `progress` after each of the library's textures.
pub fn write(inputs: &Inputs<'_>, path: &Path, progress: impl Fn()) -> Result<Written> {
    let (text, written) = page(inputs, progress)?;
    atomic_file::write(path, text.as_bytes())?;
    Ok(written)
}

fn page(inputs: &Inputs<'_>, progress: impl Fn()) -> Result<(String, Written)> {
    let data = &data::Data::of(inputs, progress)?;
    let templates = templates(data)?;
    let mut notice = String::new();
    if data.simulated {
        notice.push_str(
            "<p class=\"notice\">SIMULATED: the textures here were fitted to recordings that the rig simulator \
             computed. They say nothing of real surfaces.</p>",
        );
    }
    if let Some(words) = unknown_levels(inputs.library.textures()) {
        notice.push_str(&format!("<p class=\"notice\">The {}.</p>", escaped(&words)));
    }
    let content = format!(
        "{body}{templates}\
         <script type=\"text/plain\" id=\"kernel\">{kernel}</script>\n\
         <script type=\"text/plain\" id=\"library\">{library}</script>\n\
         <script type=\"application/json\" id=\"data\">{data}</script>\n\
         <script type=\"text/plain\" id=\"worklet\">{worklet}</script>\n\
         <script>\n{plots}</script>\n<script>\n{script}</script>\n",
        body = include_str!("body.html").replace(NOTICE_MARK, &notice),
        kernel = STANDARD.encode(KERNEL),
        library = STANDARD.encode(inputs.bytes),
        data = page_json(data),
        worklet = WORKLET.join("\n"),
        plots = stylus_pages::plots_script(),
        script = SCRIPTS.join("\n"),
    );
    let (title, style) = (escaped(&data.title), include_str!("style.css"));
    let text = stylus_pages::document(POLICY, &title, style, &content);
    let written = Written {
        bytes: text.len(),
        simulated: data.simulated,
        clips: data.clips.len(),
        digests: data.digests(),
    };
    Ok((text, written))
}

/// Range of the spectra's level axis, dB.
const SPAN_DB: f64 = 80.0;

/// Step to which the ends of that axis are rounded, dB.
const STEP_DB: f64 = 10.0;

/// Levels of a node.
const RMS: Quantity = Quantity::new("RMS level", "m/s²");

/// Returns the pictures as template elements, with the names that the scripts use. All textures share their scales.
fn templates(data: &Data) -> Result<String> {
    // A library that is all silence has no peak, and axes from zero to zero cannot be laid out.
    let peak = if data.full_scale_m_s2 > 0.0 {
        data.full_scale_m_s2
    } else {
        1.0
    };
    // The title is short, because the word SIMULATED may stand beside it.
    let waveform = waveform_axes(&Caption::new("Waveform", data.simulated), peak)?;
    let mut text = template("waveform", &waveform) + &template("spectrum", &spectrum(data)?);
    for (name, title, quantity, scale) in maps(data) {
        let axes = map_axes(&Caption::new(title, data.simulated), quantity, scale)?;
        text += &template(name, &axes);
    }
    Ok(text)
}

/// Returns the axes of spectra.
fn spectrum(data: &Data) -> Result<Svg> {
    let highest = data.textures.iter().map(|texture| texture.top_db);
    // The level of a silent texture is negative infinity.
    let highest = highest
        .filter(|level| level.is_finite())
        .reduce(f64::max)
        .unwrap_or(0.0);
    let highest = (highest / STEP_DB).ceil() * STEP_DB;
    let caption = Caption::new("Spectrum", data.simulated);
    spectrum_axes(&caption, highest - SPAN_DB..highest)
}

/// Returns the axes of the maps that the textures need: of C where it is known, and of levels for the other textures.
/// All textures share one scale per kind of map.
fn maps(data: &Data) -> impl Iterator<Item = (&'static str, &'static str, Quantity, Scale)> {
    let nodes = || data.textures.iter().map(|texture| &texture.nodes);
    let shares = nodes().flat_map(|nodes| nodes.costs.iter().flatten().flatten());
    let costs = Scale::of(shares.map(|share| 100.0 * share));
    let levels = Scale::of(nodes().flat_map(|nodes| nodes.rms_m_s2.iter().copied()));
    let known = [true, false].map(|known| nodes().any(|nodes| nodes.costs.is_some() == known));
    let of_costs = known[0].then_some(("map-cost", "Mismatch of spectra", COST, costs));
    let of_levels = known[1].then_some(("map-level", "RMS level", RMS, levels));
    of_costs.into_iter().chain(of_levels)
}

/// Returns a picture as a template element.
fn template(name: &str, picture: &Svg) -> String {
    format!("<template id=\"{name}\">{}</template>\n", picture.as_str())
}
