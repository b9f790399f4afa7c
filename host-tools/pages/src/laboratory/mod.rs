//! The laboratory: one page with which a person records or drops recordings, fits, judges, rubs and keeps, with nothing
//! installed.
//!
//! The page has what is seen. All that is computed is in the module of `host-tools/laboratory`, which runs in a worker.

use std::io::{self, Write};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;

use super::document;

/// The page's content security policy: nothing is fetched from anywhere. Scripts may compile the module; its worker,
/// and the pages that the module makes, come from the page itself. Those pages have policies of their own, and inherit
/// this one.
const POLICY: &str = "default-src 'none'; img-src data: blob:; media-src data: blob:; style-src 'unsafe-inline'; \
     script-src 'unsafe-inline' 'wasm-unsafe-eval' data:; worker-src blob:; frame-src blob:; base-uri 'none'; \
     form-action 'none'";

/// Scripts of the page, in the order in which they are loaded.
const SCRIPTS: [&str; 6] = [
    include_str!("elements.js"),
    include_str!("module.js"),
    include_str!("store.js"),
    include_str!("table.js"),
    include_str!("record.js"),
    include_str!("page.js"),
];

/// Returns the page with the `module`, a WebAssembly module, which it has packed.
pub fn page(module: &[u8]) -> io::Result<String> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(module)?;
    let content = format!(
        "{body}<script type=\"text/plain\" id=\"module\">{module}</script>\n\
         <script type=\"text/plain\" id=\"worker\">{worker}</script>\n\
         <script type=\"text/plain\" id=\"taker\">{taker}</script>\n<script>\n{script}</script>\n",
        body = include_str!("body.html"),
        module = STANDARD.encode(packed.finish()?),
        worker = include_str!("worker.js"),
        taker = include_str!("taker.js"),
        script = SCRIPTS.join("\n"),
    );
    Ok(document(
        POLICY,
        "Stylus laboratory",
        include_str!("style.css"),
        &content,
    ))
}
