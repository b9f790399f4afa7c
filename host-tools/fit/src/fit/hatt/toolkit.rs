//! The models of a file.

use std::f64::consts::PI;
use std::path::Path;

use model_format::{PlayRate, SAMPLE_RATE_HZ};
use roxmltree::Node;
use stylus_dsp::line_spectral_frequencies as line_spectrum;
use stylus_dsp::linear_prediction::step_down;
use stylus_dsp::log_spectrum::STEP_HZ;
use stylus_dsp::spectrum::band_edges_hz;
use stylus_support::{Error, Result};

use super::elements::File;

/// A file's models.
#[derive(Clone, Debug, PartialEq)]
pub struct Toolkit {
    /// Sample rate of the models, Hz.
    pub sample_rate_hz: f64,
    /// Rate at which the stylus plays the converted models.
    pub play_rate: PlayRate,
    /// Highest speed of the recordings, mm/s.
    pub max_speed_mm_s: f64,
    /// Highest force of the recordings, N.
    pub max_force_n: f64,
    /// The models that can be used.
    pub models: Vec<ArmaModel>,
    /// Corners of triangles, as indices of `models`.
    pub triangles: Vec<[usize; 3]>,
    /// Notes on faults with which the file can still be used, and on parts that were left out.
    pub warnings: Vec<String>,
}

/// One model with its speed and force.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmaModel {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Variance of the excitation, (m/s²)²; zero means silence.
    pub variance: f64,
    /// Shape of the spectrum; a silent model may have none.
    pub timbre: Option<Timbre>,
}

/// Shape of an ARMA model's spectrum. All models of a file have the same number of line spectral frequencies.
#[derive(Clone, Debug, PartialEq)]
pub struct Timbre {
    /// Line spectral frequencies of the autoregressive part, rad, ascending.
    pub poles: Vec<f64>,
    /// Line spectral frequencies of the moving average, rad, ascending.
    pub zeros: Vec<f64>,
    /// Gain of the moving average: the file's gain times b(0).
    pub gain: f64,
}

impl ArmaModel {
    /// Returns true if the model is not silent.
    pub fn sounds(&self) -> bool {
        self.variance > 0.0 && self.timbre.as_ref().is_some_and(|timbre| timbre.gain > 0.0)
    }
}

impl Toolkit {
    /// Returns the highest frequency that both the file and the stylus have, Hz: half of the lower of their sample
    /// rates.
    pub fn highest_hz(&self) -> f64 {
        0.5 * self.sample_rate_hz.min(self.play_rate_hz())
    }

    /// Returns the sample rate of the playback, Hz.
    pub(super) fn play_rate_hz(&self) -> f64 {
        f64::from(self.play_rate.hz())
    }

    /// Returns the spacing of the frequencies of spectra at the played rate, Hz.
    pub(super) fn step_hz(&self) -> f64 {
        STEP_HZ * self.play_rate_hz() / f64::from(SAMPLE_RATE_HZ)
    }

    /// Returns the third octaves from 20 Hz to [`Self::highest_hz`], numbered like
    /// [`BAND_LABELS_HZ`](stylus_dsp::spectrum::BAND_LABELS_HZ) and beyond.
    pub(super) fn bands(&self) -> impl Iterator<Item = usize> + use<> {
        let highest_hz = self.highest_hz();
        (0..).take_while(move |&band| band_edges_hz(band).1 <= highest_hz)
    }

    /// Returns the speeds, mm/s, and forces, N, of all models, including silent ones.
    pub fn model_places(&self) -> impl Iterator<Item = (f64, f64)> {
        self.models.iter().map(|model| (model.speed_mm_s, model.force_n))
    }

    /// Returns the position in each triangle with these barycentric weights of its corners.
    pub fn inside_triangles(&self, weights: [f64; 3]) -> impl Iterator<Item = (f64, f64)> {
        self.triangles.iter().map(move |triangle| {
            let corners = triangle.map(|corner| &self.models[corner]);
            let mean = |of: fn(&ArmaModel) -> f64| -> f64 {
                corners
                    .iter()
                    .zip(weights)
                    .map(|(corner, weight)| weight * of(corner))
                    .sum()
            };
            (mean(|model| model.speed_mm_s), mean(|model| model.force_n))
        })
    }

    /// Removes the shape of silent models whose order differs from that of the models that are not silent.
    pub(super) fn check_orders(&mut self, path: &Path) -> Result<()> {
        let orders = |timbre: &Timbre| (timbre.poles.len(), timbre.zeros.len());
        let of_model = |model: &ArmaModel| model.timbre.as_ref().map(orders);
        let sounding: Vec<_> = self.models.iter().filter(|m| m.sounds()).collect();
        let Some(common) = sounding.first().and_then(|first| of_model(first)) else {
            return Ok(());
        };
        if let Some(other) = sounding.iter().find(|model| of_model(model) != Some(common)) {
            let (poles, zeros) = of_model(other).unwrap_or_default();
            let problem = format!(
                "the model at {} mm/s, {} N has {poles} poles and {zeros} zeros, others have {} and {}: HaTT \
                 interpolates equal numbers only",
                other.speed_mm_s, other.force_n, common.0, common.1
            );
            return Err(Error::file(path, problem));
        }
        for model in self.models.iter_mut().filter(|model| !model.sounds()) {
            model.timbre = model.timbre.take().filter(|timbre| orders(timbre) == common);
        }
        Ok(())
    }
}

/// Largest number of coefficients of AR and of MA, without those of lag 0. The published models have some ten.
const MOST_COEFFICIENTS: usize = 100;

/// A model, or the reason why it cannot be used.
type Read<T> = std::result::Result<T, String>;

/// Reads the model at `node`. `place` is its speed and force according to the file's lists.
pub(super) fn found(file: &File<'_>, node: Node<'_, '_>, place: (Option<f64>, Option<f64>)) -> Result<Read<ArmaModel>> {
    let one = |name: &str| -> Result<Option<f64>> { Ok(file.list_in(node, name)?.first().copied()) };
    let poles = Lists {
        name: "AR",
        coefficients: file.list_in(node, "ARcoeff")?,
        lines: file.list_in(node, "ARlsf")?,
    };
    let zeros = Lists {
        name: "MA",
        coefficients: file.list_in(node, "MAcoeff")?,
        lines: file.list_in(node, "MAlsf")?,
    };
    let (variance, gain) = (one("var")?, one("gain")?.unwrap_or(1.0));
    // What a model states of itself wins over the file's lists.
    let speed = one("speedMod")?.or(place.0);
    let force = one("forceMod")?.or(place.1);
    Ok(checked(&poles, &zeros, variance, gain, (speed, force)))
}

/// Lists of one half of a model.
struct Lists {
    name: &'static str,
    coefficients: Vec<f64>,
    lines: Vec<f64>,
}

/// One half of a model.
struct Half {
    /// The coefficient of lag 0.
    first: f64,
    lines: Vec<f64>,
}

fn checked(
    poles: &Lists,
    zeros: &Lists,
    variance: Option<f64>,
    gain: f64,
    (speed, force): (Option<f64>, Option<f64>),
) -> Read<ArmaModel> {
    for half in [poles, zeros] {
        if half.coefficients.len() > MOST_COEFFICIENTS + 1 || half.lines.len() > MOST_COEFFICIENTS {
            return Err(format!("more than {MOST_COEFFICIENTS} {} coefficients", half.name));
        }
    }
    let finite = |what: &str, value: Option<f64>| match value {
        None => Err(format!("no {what}")),
        Some(value) if value.is_finite() && value >= 0.0 => Ok(value),
        Some(value) => Err(format!("{what} is {value}")),
    };
    let variance = finite("var", variance)?;
    let speed_mm_s = finite("speedMod", speed)?;
    let force_n = finite("forceMod", force)?;
    let gain = finite("gain", Some(gain))?;
    // A silent model needs no shape.
    if poles.coefficients.is_empty() && poles.lines.is_empty() && variance > 0.0 {
        return Err("ARcoeff is empty".into());
    }
    let (poles, zeros) = (poles.half()?, zeros.half()?);
    Ok(ArmaModel {
        speed_mm_s,
        force_n,
        variance,
        timbre: Some(Timbre {
            poles: poles.lines,
            zeros: zeros.lines,
            // The sign of b(0) inverts the signal, which leaves its spectrum as it is.
            gain: gain * zeros.first.abs(),
        }),
    })
}

impl Lists {
    fn half(&self) -> Read<Half> {
        let name = self.name;
        let (first, rest) = self.split()?;
        if !(first.is_finite() && rest.iter().all(|c| c.is_finite())) {
            return Err(format!("{name}coeff is not finite"));
        }
        // A common factor of the coefficients is a gain, and no part of the shape.
        let monic: Vec<f64> = rest.iter().map(|c| c / first).collect();
        if self.lines.is_empty() {
            let reflection = step_down(&monic).ok_or_else(|| match name {
                "AR" => "its coefficients are unstable".to_owned(),
                _ => "MAcoeff has a zero outside of the unit circle, and so no line spectral frequencies".to_owned(),
            })?;
            let lines = line_spectrum::frequencies(&reflection);
            return Ok(Half { first, lines });
        }
        // Strictly ascending frequencies are those of a minimum-phase polynomial, and only those (Soong and Juang,
        // ICASSP 1984).
        let inside = |omega: &f64| *omega > 0.0 && *omega < PI;
        if !self.lines.iter().all(inside) || self.lines.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(format!(
                "{name}lsf do not ascend between 0 and π, so that it is unstable"
            ));
        }
        // They are used whatever the coefficients are, like in HaTT's renderer.
        let lines = self.lines.clone();
        Ok(Half { first, lines })
    }

    /// Returns the coefficient of lag 0 and those after it. If there are only as many coefficients as line spectral
    /// frequencies, the first one, which is 1, is missing.
    fn split(&self) -> Read<(f64, &[f64])> {
        let (name, count) = (self.name, self.coefficients.len());
        let lines = Some(self.lines.len()).filter(|&lines| lines > 0);
        let Some((&first, rest)) = self.coefficients.split_first() else {
            return Ok((1.0, &[]));
        };
        match lines {
            Some(order) if order == count => Ok((1.0, &self.coefficients)),
            Some(order) if order + 1 != count => Err(format!("{name}coeff has {count} values for an order of {order}")),
            // The first coefficient of AR is 1 by definition; that of MA is a factor of the gain.
            _ if first == 0.0 || (name == "AR" && first != 1.0) => {
                Err(format!("{name}coeff begins with {first}, not with 1"))
            }
            _ => Ok((first, rest)),
        }
    }
}
