//! A library as one page that a hand can rub: the kernel, the library, recordings' clips and spectra, style and scripts
//! are in it, and its policy forbids every request.
//!
//! The kernel is the device's, as the WebAssembly module of `host-tools/browser`, whose page has the form of the data.
//! It is kept built beside this file, so that pages take no compiler; a test builds it again and compares the bytes.

mod clips;
mod data;
mod figures;
mod inputs;
mod kernel;
mod pictures;
mod spectra;
#[cfg(test)]
mod tests;

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::family;
use super::html::escaped;
use crate::support::atomic_file;
use crate::support::error::Result;
use crate::support::visible::visible;

pub use inputs::{Clips, Inputs, Recordings};
pub use kernel::{KERNEL, KERNEL_BUILT_BY};

/// The page's policy: nothing is fetched, from anywhere. A script may compile the kernel, and the sound's own thread
/// is loaded from the page itself.
const POLICY: &str = "default-src 'none'; img-src data:; media-src data: blob:; style-src 'unsafe-inline'; \
     script-src 'unsafe-inline' 'wasm-unsafe-eval' data:; base-uri 'none'; form-action 'none'";

/// Mark in the page's body where the notice stands, if there is one.
const NOTICE_MARK: &str = "<!--notice-->";

/// Scripts of the sound's thread, in their order.
const WORKLET: [&str; 4] = [
    include_str!("kernel.js"),
    include_str!("resampler.js"),
    include_str!("voices.js"),
    include_str!("worklet.js"),
];

/// Scripts of the page, in their order.
const SCRIPTS: [&str; 12] = [
    include_str!("kernel.js"),
    include_str!("resampler.js"),
    include_str!("data.js"),
    include_str!("hash.js"),
    include_str!("spectrum.js"),
    include_str!("stroke.js"),
    include_str!("pointer.js"),
    include_str!("keyboard.js"),
    include_str!("pictures.js"),
    include_str!("patch.js"),
    include_str!("files.js"),
    include_str!("page.js"),
];

/// A page that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Bytes of the page.
    pub bytes: usize,
    /// True if any texture is of simulated recordings.
    pub simulated: bool,
    /// Number of clips.
    pub clips: usize,
    /// Digest of each texture with its name; see [`stylus_kernel::digest`].
    pub digests: Vec<(String, String)>,
}

/// Writes the page, telling `progress` of each texture done; there are as many as the library has.
///
/// # Errors
/// A recording that cannot be used any more, or a file that cannot be written.
pub fn write(inputs: &Inputs<'_>, path: &Path, progress: impl Fn()) -> Result<Written> {
    write_with_data(inputs, path, None, progress)
}

/// As [`write()`], with the data of the page's pictures in the folder `data`, where one is named.
///
/// # Errors
/// As [`write()`].
pub fn write_with_data(
    inputs: &Inputs<'_>,
    path: &Path,
    folder: Option<&Path>,
    progress: impl Fn(),
) -> Result<Written> {
    let data = data::Data::of(inputs, progress)?;
    let (text, written) = text_of(inputs, &data)?;
    if let Some(folder) = folder {
        figures::write(&data, folder)?;
    }
    atomic_file::write(path, text.as_bytes())?;
    Ok(written)
}

#[cfg(test)]
fn page(inputs: &Inputs<'_>, progress: impl Fn()) -> Result<(String, Written)> {
    text_of(inputs, &data::Data::of(inputs, progress)?)
}

fn text_of(inputs: &Inputs<'_>, data: &data::Data) -> Result<(String, Written)> {
    let templates = pictures::templates(data)?;
    let notice = if data.simulated {
        "<p class=\"notice\">SIMULATED: the textures here were fitted to recordings that the rig simulator computed. \
         They say nothing of real surfaces.</p>"
    } else {
        ""
    };
    let text = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n\
         <style>\n{family}{style}</style>\n</head>\n<body>\n\
         {body}{templates}\
         <script type=\"text/plain\" id=\"kernel\">{kernel}</script>\n\
         <script type=\"text/plain\" id=\"library\">{library}</script>\n\
         <script type=\"application/json\" id=\"data\">{data}</script>\n\
         <script type=\"text/plain\" id=\"worklet\">{worklet}</script>\n\
         <script>\n{plots}</script>\n<script>\n{script}</script>\n</body>\n</html>\n",
        title = escaped(&data.title),
        family = family::style(),
        style = include_str!("style.css"),
        body = include_str!("body.html").replace(NOTICE_MARK, notice),
        kernel = STANDARD.encode(KERNEL),
        library = STANDARD.encode(inputs.bytes),
        data = json(data),
        worklet = WORKLET.join("\n"),
        plots = family::plots_script(),
        script = SCRIPTS.join("\n"),
    );
    let written = Written {
        bytes: text.len(),
        simulated: data.simulated,
        clips: data.clips.len(),
        digests: data.digests(),
    };
    Ok((text, written))
}

/// JSON that ends no script element, whatever a texture's name holds.
fn json(value: &impl Serialize) -> String {
    let text = serde_json::to_string(value).expect("the data have text keys only");
    visible(&text).replace('<', "\\u003c")
}
