//! Textures at the other of the two rates that a stylus plays.
//!
//! Each model's power spectrum is taken to the other rate, as [`LogSpectrum::at_twice_the_rate`] and
//! [`LogSpectrum::at_half_the_rate`] do it; its autocorrelation gives the new model by Levinson and Durbin's recursion.
//! The order goes with the rate, so that the lags span the same time, as far as the highest order allows.

use model_format::{PlayRate, Texture, TextureSpec, limits};
use rayon::prelude::*;

use super::grid::Grid;
use super::library::texture_spec;
use super::stored;
use crate::dsp::linear_prediction::{Prediction, corrected};
use crate::dsp::log_spectrum::{FINE_BINS, LogSpectrum};
use crate::dsp::model::Model;
use crate::support::error::{Error, Result};

/// Bands whose error is told: third octaves with centres from 20 Hz to 1 kHz, as exponents of 10^(n/10).
const BANDS: std::ops::RangeInclusive<i32> = 13..=30;

/// Bands further below the strongest one are not felt beside it.
const AUDIBLE_SHARE: f64 = 1e-5;

/// A texture at another rate.
#[derive(Clone, Debug)]
pub struct Resampled {
    /// The texture.
    pub spec: TextureSpec,
    /// Highest order of its models.
    pub order: usize,
    /// Its errors against the original.
    pub errors: BandErrors,
}

/// Errors of third-octave bands from 20 Hz to 1 kHz over all nodes that are not silent, of those within 50 dB of the
/// strongest band.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct BandErrors {
    /// Root mean square, dB.
    pub rms_db: f64,
    /// Largest magnitude, dB.
    pub largest_db: f64,
}

/// Returns `texture` at `rate`, with models of `order`, or of the order that spans the same time.
///
/// # Errors
/// A texture of that rate already, or of a rate that no stylus plays; a part that is of its rate, by its name; a model
/// that its structure cannot hold at the other rate.
pub fn at_rate(texture: &Texture<'_>, rate: PlayRate, order: Option<usize>) -> Result<Resampled> {
    let name = texture.name();
    let refused = |problem: String| Error::Model(format!("texture '{name}': {problem}"));
    let from = PlayRate::of(texture.sample_rate_hz()).ok_or_else(|| {
        refused(format!(
            "it has {} Hz, which no stylus plays: fit it again",
            texture.sample_rate_hz()
        ))
    })?;
    if from == rate {
        return Err(refused(format!("it has {} Hz already", rate.hz())));
    }
    let parts = [
        ("codebooks", texture.excitation().is_some()),
        ("a level track", texture.modulation().is_some()),
        ("lines", texture.lines().is_some()),
    ];
    if let Some((part, _)) = parts.into_iter().find(|&(_, is_there)| is_there) {
        return Err(refused(format!(
            "{part} stay at the rate of their recordings: fit it without them, or at {} Hz",
            rate.hz()
        )));
    }
    let originals: Vec<Model> = texture
        .nodes()
        .map(|node| Model {
            reflection: stored::reflection(node.coefficients),
            output_power: node.output_power.into(),
            flags: node.flags,
        })
        .collect();
    let models = originals
        .par_iter()
        .map(|model| moved(model, from, rate, order));
    let grid = Grid {
        speeds_mm_s: texture.speed_axis().values().collect(),
        forces_n: texture.force_axis().values().collect(),
        models: models.collect(),
        laws: texture.laws(),
        parts: model_format::PartsSpec::default(),
    };
    let errors = band_errors(&originals, from, &grid.models, rate);
    let orders = grid.models.iter().map(|model| model.reflection.len());
    let order = orders.max().unwrap_or(0);
    let spec = TextureSpec {
        sample_rate_hz: rate.hz(),
        ..texture_spec(name, texture.provenance(), &grid)?
    };
    Ok(Resampled {
        spec,
        order,
        errors,
    })
}

/// Number of frequencies of spectra at `rate`: the same step at both.
fn bins(rate: PlayRate) -> usize {
    (FINE_BINS - 1) * rate.samples_per_tick() as usize + 1
}

fn moved(model: &Model, from: PlayRate, to: PlayRate, order: Option<usize>) -> Model {
    if model.is_silent() || model.output_power <= 0.0 {
        return model.clone();
    }
    let span = model.reflection.len() * to.samples_per_tick() as usize;
    let order = order.unwrap_or(span.div_ceil(from.samples_per_tick() as usize));
    let order = order.min(limits::MAX_ORDER);
    let before = LogSpectrum::of_model_at(model, bins(from));
    let after = match to {
        PlayRate::Hz10000 => before.at_twice_the_rate(),
        PlayRate::Hz5000 => before.at_half_the_rate(),
    };
    let prediction = Prediction::levinson_durbin(&corrected(after.autocorrelation(order)), order);
    Model {
        reflection: prediction.reflection,
        // The sums of a resonance between two frequencies are wrong alike.
        output_power: model.output_power * after.power() / before.power(),
        flags: model.flags,
    }
}

fn band_errors(originals: &[Model], from: PlayRate, models: &[Model], to: PlayRate) -> BandErrors {
    let errors: Vec<f64> = originals
        .par_iter()
        .zip(models)
        .filter(|(original, _)| !original.is_silent() && original.output_power > 0.0)
        .flat_map_iter(|(original, model)| {
            let before = band_powers(original, from);
            let after = band_powers(model, to);
            let strongest = before.iter().copied().fold(0.0, f64::max);
            let pairs = before.into_iter().zip(after);
            let felt = pairs.filter(move |&(before, _)| before > AUDIBLE_SHARE * strongest);
            felt.map(|(before, after)| 10.0 * (after / before).log10())
        })
        .collect();
    let square: f64 = errors.iter().map(|error| error * error).sum();
    BandErrors {
        rms_db: (square / errors.len().max(1) as f64).sqrt(),
        largest_db: errors.iter().fold(0.0, |most, error| most.max(error.abs())),
    }
}

/// Power of `model` at `rate` in each of [`BANDS`], (m/s²)².
fn band_powers(model: &Model, rate: PlayRate) -> Vec<f64> {
    let spectrum = LogSpectrum::of_model_at(model, bins(rate));
    let step_hz = f64::from(PlayRate::Hz5000.hz()) / 2.0 / (FINE_BINS - 1) as f64;
    let scale = model.output_power / spectrum.power() / f64::from(rate.hz()) * 2.0 * step_hz;
    BANDS
        .map(|band| {
            let edge = |half: f64| {
                let hertz = 10f64.powf((f64::from(band) + half) / 10.0);
                (hertz / step_hz).round() as usize
            };
            let bins = edge(-0.5)..edge(0.5);
            scale * spectrum.values()[bins].iter().map(|l| l.exp()).sum::<f64>()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::linear_prediction::{step_down, step_up};
    use model_format::{
        CodebookSpec, ExcitationSpec, FadeLaw, Laws, LevelLaw, Library, NodeFlags, PartsSpec,
        Provenance, encode,
    };

    fn grid(reflection: &[f64]) -> Grid {
        Grid {
            speeds_mm_s: vec![80.0],
            forces_n: vec![1.0],
            models: vec![Model {
                reflection: reflection.to_vec(),
                output_power: 2.0,
                flags: NodeFlags::NONE,
            }],
            laws: Laws {
                level: LevelLaw::Logarithm,
                fade: FadeLaw::Power,
            },
            parts: PartsSpec::default(),
        }
    }

    fn library(grid: &Grid, rate: PlayRate) -> Vec<u8> {
        let spec = TextureSpec {
            sample_rate_hz: rate.hz(),
            ..texture_spec("silk", Provenance::Recorded, grid).unwrap()
        };
        encode(&[spec]).unwrap()
    }

    /// Two resonances over a slope, by their reflection coefficients.
    fn resonances(rate_hz: f64) -> Vec<f64> {
        let mut polynomial = vec![1.0];
        for (radius, hertz) in [(0.97f64, 90.0f64), (0.9, 420.0)] {
            let angle = std::f64::consts::TAU * hertz / rate_hz;
            let factor = [1.0, -2.0 * radius * angle.cos(), radius * radius];
            let mut product = vec![0.0; polynomial.len() + 2];
            for (n, a) in polynomial.iter().enumerate() {
                for (k, b) in factor.iter().enumerate() {
                    product[n + k] += a * b;
                }
            }
            polynomial = product;
        }
        step_down(&polynomial[1..]).unwrap()
    }

    /// Power density at a frequency by the sum of the polynomial, which shares nothing with a transform.
    fn density(texture: &Texture<'_>, hertz: f64) -> f64 {
        let node = texture.node(0, 0);
        let rate_hz = f64::from(texture.sample_rate_hz());
        let polynomial = step_up(&stored::reflection(node.coefficients));
        let (mut re, mut im) = (1.0, 0.0);
        for (lag, a) in (1..).zip(polynomial) {
            let phase = std::f64::consts::TAU * hertz / rate_hz * f64::from(lag);
            re += a * phase.cos();
            im -= a * phase.sin();
        }
        f64::from(node.prediction_error_power) / (re * re + im * im) / rate_hz
    }

    #[test]
    fn the_density_stays_at_twice_the_rate_and_back() {
        let bytes = library(&grid(&resonances(5e3)), PlayRate::Hz5000);
        let original = Library::decode(&bytes).unwrap();
        let original = original.textures().next().unwrap();
        let there = at_rate(&original, PlayRate::Hz10000, Some(40)).unwrap();
        assert!(there.errors.largest_db < 0.5, "{:?}", there.errors);
        assert_eq!(there.spec.sample_rate_hz, 10_000);
        let bytes = encode(&[there.spec]).unwrap();
        let fast = Library::decode(&bytes).unwrap();
        let fast = fast.textures().next().unwrap();
        let back = at_rate(&fast, PlayRate::Hz5000, Some(40)).unwrap();
        let bytes = encode(&[back.spec]).unwrap();
        let slow = Library::decode(&bytes).unwrap();
        let slow = slow.textures().next().unwrap();
        for hertz in [20.0, 60.0, 90.0, 150.0, 300.0, 420.0, 700.0, 1000.0] {
            let before = density(&original, hertz);
            for moved in [&fast, &slow] {
                let error_db = 10.0 * (density(moved, hertz) / before).log10();
                assert!(error_db.abs() < 0.6, "{error_db} dB at {hertz} Hz");
            }
        }
    }

    #[test]
    fn the_order_goes_with_the_rate_up_to_the_highest() {
        use PlayRate::{Hz5000, Hz10000};
        let order = |stages: usize, from: PlayRate, to: PlayRate| {
            let reflection: Vec<f64> = (0..stages).map(|n| 0.3 / (n + 1) as f64).collect();
            let bytes = library(&grid(&reflection), from);
            let library = Library::decode(&bytes).unwrap();
            let texture = library.textures().next().unwrap();
            let moved = at_rate(&texture, to, None).unwrap();
            let bytes = encode(&[moved.spec]).unwrap();
            Library::decode(&bytes)
                .unwrap()
                .textures()
                .next()
                .unwrap()
                .max_order()
        };
        assert_eq!(order(31, Hz5000, Hz10000), 62);
        assert_eq!(order(31, Hz10000, Hz5000), 16);
        assert_eq!(order(300, Hz5000, Hz10000), 400);
    }

    #[test]
    fn what_is_of_its_rate_is_refused_by_name() {
        let mut fed = grid(&[0.5]);
        fed.parts.excitation = Some(ExcitationSpec {
            codebooks: vec![CodebookSpec {
                peak: 2.0,
                codes: [127, 0, -127, 0, 0, 0, 0, 0].repeat(125),
            }],
            of_nodes: vec![1],
        });
        for (grid, word) in [(fed, "codebooks"), (grid(&[0.5]), "5000 Hz already")] {
            let bytes = library(&grid, PlayRate::Hz5000);
            let library = Library::decode(&bytes).unwrap();
            let texture = library.textures().next().unwrap();
            let to = if word == "codebooks" {
                PlayRate::Hz10000
            } else {
                PlayRate::Hz5000
            };
            let error = at_rate(&texture, to, None).unwrap_err().to_string();
            assert!(error.contains("'silk'") && error.contains(word), "{error}");
        }
    }

    #[test]
    fn a_silent_node_stays_silent() {
        let mut silent = grid(&[0.5]);
        silent.models.push(Model::silent());
        silent.forces_n.push(2.0);
        silent.laws.level = LevelLaw::Amplitude;
        let bytes = library(&silent, PlayRate::Hz5000);
        let library = Library::decode(&bytes).unwrap();
        let texture = library.textures().next().unwrap();
        let moved = at_rate(&texture, PlayRate::Hz10000, None).unwrap();
        assert!(moved.spec.nodes[1].flags.contains(NodeFlags::SILENT));
        assert_eq!(moved.spec.laws, silent.laws);
    }
}
