//! `stylus headroom`

use std::path::PathBuf;

use model_format::Library;
use serde::Serialize;
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_link::link::Device;
use stylus_link::procedures::response::{Headroom, headroom};
use stylus_support::Result;

use super::Link;
use crate::cli::input::warn_of_unknown_levels;
use crate::cli::output::{print, print_json, warn};
use crate::cli::table::table;

#[derive(clap::Args)]
pub struct Arguments {
    /// Library to compare with what the stylus can give: each texture by itself and in each scene
    library: PathBuf,
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct Report {
    /// True if a response is stored, so that levels at the tip are known.
    calibrated: bool,
    textures: Vec<Headroom>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let device = arguments.link.connect()?;
    let (calibrated, textures) = of(&device, &library)?;
    warn_of_unknown_levels(library.textures());
    if !calibrated {
        warn("no response is stored, so levels at the tip are not known: run `stylus calibrate --response`");
    }
    if arguments.json {
        return print_json(&Report { calibrated, textures });
    }
    for texture in &textures {
        let (limit, over_db) = texture.tightest();
        let [speed, force] = texture.at;
        print(&format!(
            "{}: {} at {speed} mm/s and {force} N, {:.1} dB {} the limit of {limit}; fits at a gain of {:.2}",
            texture.name(),
            if over_db > 0.0 { "EXCEEDS" } else { "fits" },
            over_db.abs(),
            if over_db > 0.0 { "above" } else { "below" },
            texture.fitting_gain
        ))?;
        let rows: Vec<Vec<String>> = texture
            .bands
            .iter()
            .map(|band| {
                vec![
                    format!("{:.0}", band.hz),
                    format!("{:.3}", band.asked_m_s2),
                    band.tip_m_s2.map_or("?".to_owned(), |tip| format!("{tip:.3}")),
                    format!("{:.1}", 1e3 * band.pin_volts),
                    format!("{:+.1}", band.over_db),
                ]
            })
            .collect();
        print(&table(&["Hz", "asked m/s²", "at the tip", "pin mV", "over dB"], &rows))?;
    }
    Ok(())
}

/// Returns true if a response is stored, and the headroom of each texture and of each surface of a scene.
fn of(device: &Device, library: &Library<'_>) -> Result<(bool, Vec<Headroom>)> {
    let response = device.response()?.stored.map(|stored| stored.response);
    Ok((
        response.is_some(),
        headroom(library, &device.settings()?, response.as_ref())?,
    ))
}

/// Warns of textures that exceed what the stylus can output, if a response is stored, or of a headroom that is not
/// known. Warns of levels that are not known, too.
pub fn warn_of(device: &Device, library: &Library<'_>) {
    warn_of_unknown_levels(library.textures());
    let known = || -> Result<Vec<Headroom>> {
        // Without a response, the levels at the tip are not known.
        if device.response()?.stored.is_none() {
            return Ok(Vec::new());
        }
        Ok(of(device, library)?.1)
    };
    match known() {
        Ok(textures) => textures
            .iter()
            .filter_map(Headroom::warning)
            .for_each(|warning| warn(&warning)),
        Err(failure) => warn(&format!("the headroom is not known: {failure}")),
    }
}
