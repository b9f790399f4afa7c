//! Pictures of the page: axes for what its scripts draw, and maps under the point that moves.

use super::data::{Data, TextureData};
use crate::report::plot::{
    COST, Caption, GridCell, GridMap, NARROW, Quantity, Scale, Svg, grid_map, spectrum_axes,
    waveform_axes,
};
use crate::support::error::Result;

/// Span of the spectra's axis, dB.
const SPAN_DB: f64 = 80.0;

/// Steps of its ends, dB.
const STEP_DB: f64 = 10.0;

/// Levels of a node.
const RMS: Quantity<'static> = Quantity::new("RMS level", "m/s²");

/// The pictures as templates, by the names that the scripts know. All textures share their scales.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn templates(data: &Data) -> Result<String> {
    let peak = if data.full_scale_m_s2 > 0.0 {
        data.full_scale_m_s2
    } else {
        1.0
    };
    let waveform = waveform_axes(
        &caption("What sounds, the last 100 ms", data.simulated),
        peak,
    )?;
    let mut text = template("waveform", &waveform) + &template("spectrum", &spectrum(data)?);
    for (index, map) in maps(data)?.iter().enumerate() {
        text += &template(&format!("map-{index}"), map);
    }
    Ok(text)
}

fn caption(title: &str, simulated: bool) -> Caption<'_> {
    Caption { title, simulated }
}

/// The axes of spectra.
fn spectrum(data: &Data) -> Result<Svg> {
    let highest = data.textures.iter().map(|texture| texture.highest_db);
    let highest = highest.filter(|level| level.is_finite());
    let highest = highest.reduce(f64::max).unwrap_or(0.0);
    let highest = (highest / STEP_DB).ceil() * STEP_DB;
    spectrum_axes(
        &caption("Spectrum", data.simulated),
        highest - SPAN_DB..highest,
    )
}

/// The map of each texture.
fn maps(data: &Data) -> Result<Vec<Svg>> {
    let simulated = data.simulated;
    let costs = Scale::of(data.textures.iter().flat_map(costs));
    let levels = data.textures.iter().flat_map(|texture| &texture.nodes);
    let levels = Scale::of(levels.map(|node| node.rms_m_s2));
    let mut maps = Vec::new();
    for texture in &data.textures {
        let shows_cost = costs_known(texture);
        let title = if shows_cost {
            format!("Cost C of {}", texture.name)
        } else {
            format!("RMS level of {}", texture.name)
        };
        let cells: Vec<GridCell> = texture
            .nodes
            .iter()
            .map(|node| GridCell {
                value: if shows_cost {
                    node.cost.map(|cost| 100.0 * cost)
                } else {
                    Some(node.rms_m_s2)
                },
                flags: node.flags,
            })
            .collect();
        let map = GridMap {
            texture: &texture.name,
            speeds_mm_s: &texture.speeds_mm_s,
            forces_n: &texture.forces_n,
            cells: &cells,
            quantity: if shows_cost { COST } else { RMS },
            scale: if shows_cost { costs } else { levels },
        };
        maps.push(grid_map(&caption(&title, simulated), &map, NARROW)?);
    }
    Ok(maps)
}

fn costs_known(texture: &TextureData) -> bool {
    costs(texture).next().is_some()
}

/// The known C of all nodes, per cent.
fn costs(texture: &TextureData) -> impl Iterator<Item = f64> {
    let nodes = texture.nodes.iter();
    nodes.filter_map(|node| node.cost.map(|cost| 100.0 * cost))
}

/// A picture as a template.
fn template(name: &str, picture: &Svg) -> String {
    format!("<template id=\"{name}\">{}</template>\n", picture.as_str())
}
