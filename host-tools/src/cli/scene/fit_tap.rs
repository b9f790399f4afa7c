//! `stylus scene fit-tap`

use std::path::PathBuf;

use stylus_dsp::reduction::Reduction;
use stylus_fit::scene::tap::{TapFit, Taps};
use stylus_signals::recording::scale;
use stylus_support::{Error, Result};

use crate::cli::input::positive;
use crate::cli::output::{print, print_json, warn};
use crate::cli::table::{headed, table};

/// Rate of force at contact that is assumed if none is known, N/s.
const ASSUMED_FORCE_RATE_N_S: f64 = 100.0;

#[derive(clap::Args)]
pub struct Arguments {
    /// Recordings of taps: files of `stylus record --strokes` (with the force), or WAV or CSV recordings
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Rates of force at contact in N/s, one per recording, if no force was recorded
    #[arg(long, value_name = "N_S,N_S...", value_delimiter = ',', value_parser = positive)]
    force_rates: Vec<f64>,
    /// Acceleration of a sample of 1, in m/s², or as a unit such as g or g/256 [default: by the header, or 1]
    #[arg(long, visible_alias = "unit", value_name = "M_S2", value_parser = scale)]
    scale: Option<f64>,
    /// Reduction from three axes to one
    #[arg(long, value_enum, default_value = "pca")]
    reduce: Reduction,
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let rates = &arguments.force_rates;
    if !(rates.is_empty() || rates.len() == arguments.recordings.len()) {
        return Err(Error::Request(format!(
            "--force-rates has {} values for {} recordings; give one per recording",
            rates.len(),
            arguments.recordings.len()
        )));
    }
    let mut recordings = Vec::new();
    for (index, path) in arguments.recordings.iter().enumerate() {
        let mut taps = Taps::read(path, arguments.scale, arguments.reduce)?;
        taps.notes.iter().for_each(|note| warn(note));
        taps.force_rate_n_s = rates.get(index).copied();
        recordings.push(taps);
    }
    let fit = TapFit::new(&recordings)?;
    if arguments.json {
        return print_json(&fit);
    }
    print(&text(&fit))?;
    if fit.gain_m_s2_per_n_s.is_none() {
        warn("no rate of force is known, so the gain is a guess; record the force, or give --force-rates");
    }
    Ok(())
}

fn text(fit: &TapFit) -> String {
    let (header, rows) = headed(fit.impacts.iter().map(|impact| {
        let rate = impact.force_rate_n_s.map(|rate| format!("{rate:.1}"));
        [
            ("recording", impact.recording.clone()),
            ("s", format!("{:.3}", impact.time_s)),
            ("Hz", format!("{:.1}", impact.frequency_hz)),
            ("decay ms", format!("{:.2}", 1000.0 * impact.decay_s)),
            ("m/s²", format!("{:.2}", impact.amplitude_m_s2)),
            ("N/s", rate.unwrap_or_else(|| "-".to_owned())),
            ("left %", format!("{:.1}", 100.0 * impact.residual)),
            ("left out", impact.left_out.clone().unwrap_or_default()),
        ]
    }));
    let counted: Vec<_> = fit.impacts.iter().filter(|i| i.left_out.is_none()).collect();
    // `TapFit::new` refuses recordings of which no impact counts.
    let left = counted.iter().map(|i| i.residual).sum::<f64>() / counted.len() as f64;
    let simulated = if fit.is_simulated { ", SIMULATED" } else { "" };
    let scatter = fit.gain_scatter.map_or_else(String::new, |scatter| {
        format!(", amplitudes deviate from the gain's line by {:.0} %", 100.0 * scatter)
    });
    let (gain, remark) = fit.gain_m_s2_per_n_s.map_or_else(
        || {
            let loudest = counted.iter().map(|i| i.amplitude_m_s2).fold(0.0, f64::max);
            let guess = loudest / ASSUMED_FORCE_RATE_N_S;
            (guess, "  # a guess: the loudest tap at 100 N/s")
        },
        |gain| (gain, ""),
    );
    format!(
        "{}\n\n\
         # {} tap(s){simulated}; a decaying sine leaves {:.1} % of their power{scatter}\n\
         [surface.tap]\n\
         frequency_hz = {:.1}\n\
         decay_s = {:.5}\n\
         gain_m_s2_per_n_s = {gain:.4}{remark}\n\
         limit_m_s2 = {:.1}",
        table(&header, &rows),
        counted.len(),
        100.0 * left,
        fit.frequency_hz,
        fit.decay_s,
        fit.limit_m_s2
    )
}
