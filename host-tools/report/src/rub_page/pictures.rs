//! Pictures of the page: axes for what its scripts draw.

use super::data::Data;
use crate::plot::{COST, Caption, Quantity, Scale, Svg, map_axes, spectrum_axes, waveform_axes};
use crate::support::error::Result;

/// Span of the spectra's axis, dB.
const SPAN_DB: f64 = 80.0;

/// Steps of its ends, dB.
const STEP_DB: f64 = 10.0;

/// Levels of a node.
const RMS: Quantity = Quantity::new("RMS level", "m/s²");

/// The pictures as templates, by the names that the scripts know. All textures share their scales.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn templates(data: &Data) -> Result<String> {
    // A library of silence alone has no peak, and axes from zero to zero cannot be laid out.
    let peak = if data.full_scale_m_s2 > 0.0 {
        data.full_scale_m_s2
    } else {
        1.0
    };
    // Short, because the mark of simulated data stands beside it.
    let waveform = waveform_axes(&Caption::new("Waveform", data.simulated), peak)?;
    let mut text = template("waveform", &waveform) + &template("spectrum", &spectrum(data)?);
    for (name, title, quantity, scale) in maps(data) {
        let axes = map_axes(&Caption::new(title, data.simulated), quantity, scale)?;
        text += &template(name, &axes);
    }
    Ok(text)
}

/// The axes of spectra.
fn spectrum(data: &Data) -> Result<Svg> {
    let highest = data.textures.iter().map(|texture| texture.top_db);
    // The level of a silent texture is negative infinity.
    let highest = highest.filter(|level| level.is_finite());
    let highest = highest.reduce(f64::max).unwrap_or(0.0);
    let highest = (highest / STEP_DB).ceil() * STEP_DB;
    let caption = Caption::new("Spectrum", data.simulated);
    spectrum_axes(&caption, highest - SPAN_DB..highest)
}

/// Axes of maps that the textures need, with a scale for all of them: those of C where it is known.
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

/// A picture as a template.
fn template(name: &str, picture: &Svg) -> String {
    format!("<template id=\"{name}\">{}</template>\n", picture.as_str())
}
