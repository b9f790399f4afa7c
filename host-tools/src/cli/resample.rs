//! `stylus resample`

use std::path::PathBuf;

use host_tools::support::atomic_file;
use host_tools::support::error::{Error, Result};
use host_tools::texture::resample::{BandErrors, Resampled, at_rate};
use model_format::{PlayRate, Texture, TextureSpec, encode};
use serde::Serialize;

use super::overwrite::Overwrite;
use super::table::table;
use crate::cli::output::{print, print_json};
use host_tools::texture::library_file::{decode_library, read_library};

#[derive(clap::Args)]
pub struct Arguments {
    /// Library whose textures are to be had at another rate
    library: PathBuf,
    /// Sample rate to change to, Hz: 5000 or 10000
    #[arg(long, value_name = "HZ")]
    rate: u32,
    /// Library file to write
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Order of the models; by default it goes with the rate, so that the lags span the same time, up to 400
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=400))]
    order: Option<u16>,
    /// Print the errors as JSON
    #[arg(long)]
    json: bool,
}

/// A texture, and the error of its change.
#[derive(Serialize)]
struct Row {
    texture: String,
    orders: [usize; 2],
    #[serde(flatten)]
    errors: BandErrors,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let rate = PlayRate::of(arguments.rate).ok_or_else(|| {
        let rates = PlayRate::ALL.map(|rate| rate.hz().to_string()).join(" or ");
        Error::Request(format!(
            "a rate of {} Hz: a stylus plays {rates}",
            arguments.rate
        ))
    })?;
    (arguments.overwrite).file(&arguments.out, std::slice::from_ref(&arguments.library))?;
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    if let Some(scene) = library.scenes().next() {
        let problem = format!(
            "has scene '{}': resample the library that it was compiled from, and compile it again with sample_rate_hz \
             = {}",
            scene.name,
            rate.hz()
        );
        return Err(Error::file(&arguments.library, problem));
    }
    let order = arguments.order.map(usize::from);
    let mut specs: Vec<TextureSpec> = Vec::new();
    let mut rows: Vec<Row> = Vec::new();
    for texture in library.textures() {
        let moved = at_rate(&texture, rate, order)?;
        rows.push(row(&texture, &moved));
        specs.push(moved.spec);
    }
    let encoded = encode(&specs).map_err(|failure| {
        Error::Model(format!("the textures do not make a library: {failure}"))
    })?;
    atomic_file::write(&arguments.out, &encoded)?;
    if arguments.json {
        return print_json(&rows);
    }
    print(&shown(&rows, rate, arguments, encoded.len()))
}

fn row(texture: &Texture<'_>, moved: &Resampled) -> Row {
    Row {
        texture: moved.spec.name.clone(),
        orders: [texture.max_order(), moved.order],
        errors: moved.errors,
    }
}

fn shown(rows: &[Row], rate: PlayRate, arguments: &Arguments, bytes: usize) -> String {
    let header = ["texture", "order", "at the new rate", "RMS dB", "worst dB"];
    let lines: Vec<Vec<String>> = rows
        .iter()
        .map(|row| {
            let [before, after] = row.orders;
            vec![
                row.texture.clone(),
                before.to_string(),
                after.to_string(),
                format!("{:.3}", row.errors.rms_db),
                format!("{:.3}", row.errors.largest_db),
            ]
        })
        .collect();
    format!(
        "{}\n\nErrors are those of third-octave bands from 20 Hz to 1 kHz against the original.\n{} at {} Hz ({bytes} \
         bytes)",
        table(&header, &lines),
        arguments.out.display(),
        rate.hz()
    )
}
