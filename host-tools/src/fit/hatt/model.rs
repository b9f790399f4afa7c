//! One model of a file: its lists, checked, as line spectral frequencies.

use std::f64::consts::PI;

use roxmltree::Node;

use super::elements::File;
use super::toolkit::{ArmaModel, Timbre};
use crate::dsp::line_spectral_frequencies as line_spectrum;
use crate::dsp::linear_prediction::step_down;
use crate::support::error::Result;

/// Most coefficients of AR and of MA, without those of lag 0. The published models have some ten.
const MOST_COEFFICIENTS: usize = 100;

/// A model that can be used.
pub(super) struct Found {
    pub model: ArmaModel,
    /// Largest difference between its line spectral frequencies and those of its coefficients, rad; infinite if the
    /// coefficients have none.
    pub lsf_error_rad: f64,
}

/// A model, or why it cannot be used.
type Read<T> = std::result::Result<T, String>;

/// Reads the model at `node`. `place` is the speed and force that the file's lists have for it, `stated`
/// the numbers of AR and MA coefficients that it states.
///
/// # Errors
/// Text that is not a number.
pub(super) fn found(
    file: &File<'_>,
    node: Node<'_, '_>,
    place: (Option<f64>, Option<f64>),
    stated: [Option<f64>; 2],
) -> Result<Read<Found>> {
    let one =
        |name: &str| -> Result<Option<f64>> { Ok(file.list_in(node, name)?.first().copied()) };
    let poles = Lists {
        name: "AR",
        coefficients: file.list_in(node, "ARcoeff")?,
        lines: file.list_in(node, "ARlsf")?,
        stated: stated[0],
    };
    let zeros = Lists {
        name: "MA",
        coefficients: file.list_in(node, "MAcoeff")?,
        lines: file.list_in(node, "MAlsf")?,
        stated: stated[1],
    };
    let (variance, gain) = (one("var")?, one("gain")?.unwrap_or(1.0));
    let speed = one("speedMod")?.or(place.0);
    let force = one("forceMod")?.or(place.1);
    Ok(checked(&poles, &zeros, variance, gain, (speed, force)))
}

/// Lists of one half of a model.
struct Lists {
    name: &'static str,
    coefficients: Vec<f64>,
    lines: Vec<f64>,
    /// Number of coefficients that the file states, without the leading one.
    stated: Option<f64>,
}

/// One half of a model.
struct Half {
    /// The coefficient of lag 0.
    first: f64,
    lines: Vec<f64>,
    error_rad: f64,
}

fn checked(
    poles: &Lists,
    zeros: &Lists,
    variance: Option<f64>,
    gain: f64,
    (speed, force): (Option<f64>, Option<f64>),
) -> Read<Found> {
    for half in [poles, zeros] {
        if half.coefficients.len() > MOST_COEFFICIENTS + 1 || half.lines.len() > MOST_COEFFICIENTS {
            return Err(format!(
                "more than {MOST_COEFFICIENTS} {} coefficients",
                half.name
            ));
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
    if poles.coefficients.is_empty() && poles.lines.is_empty() && variance > 0.0 {
        return Err("ARcoeff is empty".into());
    }
    let (poles, zeros) = (poles.half()?, zeros.half()?);
    let model = ArmaModel {
        speed_mm_s,
        force_n,
        variance,
        timbre: Some(Timbre {
            poles: poles.lines,
            zeros: zeros.lines,
            gain: gain * zeros.first.abs(),
        }),
    };
    let lsf_error_rad = poles.error_rad.max(zeros.error_rad);
    Ok(Found {
        model,
        lsf_error_rad,
    })
}

impl Lists {
    fn half(&self) -> Read<Half> {
        let name = self.name;
        let (first, rest) = self.split()?;
        if !(first.is_finite() && rest.iter().all(|c| c.is_finite())) {
            return Err(format!("{name}coeff is not finite"));
        }
        let monic: Vec<f64> = rest.iter().map(|c| c / first).collect();
        let own = step_down(&monic).map(|reflection| line_spectrum::frequencies(&reflection));
        if self.lines.is_empty() {
            let lines = own.ok_or_else(|| match name {
                "AR" => "its coefficients are unstable".to_owned(),
                _ => "MAcoeff has a zero outside of the unit circle, and so no line spectral frequencies".to_owned(),
            })?;
            return Ok(Half {
                first,
                lines,
                error_rad: 0.0,
            });
        }
        let inside = |omega: &f64| *omega > 0.0 && *omega < PI;
        if !self.lines.iter().all(inside) || self.lines.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(format!(
                "{name}lsf do not ascend between 0 and π, so that it is unstable"
            ));
        }
        let difference = |own: &[f64]| {
            let pairs = own.iter().zip(&self.lines);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        let error_rad = match own {
            _ if self.coefficients.is_empty() => 0.0,
            Some(own) => difference(&own),
            None => f64::INFINITY,
        };
        Ok(Half {
            first,
            lines: self.lines.clone(),
            error_rad,
        })
    }

    /// The coefficient of lag 0 and those after it. As many coefficients as line spectral frequencies, or as the file
    /// states, are without the first, which is 1.
    fn split(&self) -> Read<(f64, &[f64])> {
        let (name, count) = (self.name, self.coefficients.len());
        let lines = Some(self.lines.len()).filter(|&lines| lines > 0);
        let stated = self.stated.map(|stated| stated as usize);
        let Some((&first, rest)) = self.coefficients.split_first() else {
            return Ok((1.0, &[]));
        };
        match lines.or(stated) {
            Some(order) if order == count => Ok((1.0, &self.coefficients)),
            Some(order) if order + 1 != count => Err(format!(
                "{name}coeff has {count} values for an order of {order}"
            )),
            _ if first == 0.0 || (name == "AR" && first != 1.0) => {
                Err(format!("{name}coeff begins with {first}, not with 1"))
            }
            _ => Ok((first, rest)),
        }
    }
}
