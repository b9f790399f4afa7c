//! Pictures of the page: axes in which its scripts draw.

use stylus_support::Result;

use super::data::Data;
use crate::plot::{COST, Caption, Quantity, Scale, Svg, map_axes, spectrum_axes, waveform_axes};

/// Range of the spectra's level axis, dB.
const SPAN_DB: f64 = 80.0;

/// Step to which the ends of that axis are rounded, dB.
const STEP_DB: f64 = 10.0;

/// Levels of a node.
const RMS: Quantity = Quantity::new("RMS level", "m/s²");

/// Returns the pictures as template elements, with the names that the scripts use. All textures share their scales.
pub fn templates(data: &Data) -> Result<String> {
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
