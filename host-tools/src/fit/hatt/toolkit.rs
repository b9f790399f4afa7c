//! The models of a file.

use std::path::Path;

use crate::support::error::{Error, Result};

/// A file's models.
#[derive(Clone, Debug, PartialEq)]
pub struct Toolkit {
    /// Samples per second at which the models hold.
    pub sample_rate_hz: f64,
    /// Highest speed of the recordings, mm/s.
    pub max_speed_mm_s: f64,
    /// Highest force of the recordings, N.
    pub max_force_n: f64,
    /// Kinetic friction coefficient; the stylus does not play it.
    pub friction: Option<f64>,
    /// The models that can be used.
    pub models: Vec<ArmaModel>,
    /// Corners of triangles, as indices of `models`.
    pub triangles: Vec<[usize; 3]>,
    /// Faults that leave the file usable, and parts that were left out.
    pub warnings: Vec<String>,
}

/// One model at its place.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmaModel {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Variance of the excitation, (m/s²)²; zero is silence.
    pub variance: f64,
    /// Shape of the spectrum; a silent model may have none.
    pub timbre: Option<Timbre>,
}

/// Shape of an ARMA model's spectrum. Models of one file have equal numbers of line spectral frequencies.
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
    /// Returns true if the model has power.
    pub fn sounds(&self) -> bool {
        self.variance > 0.0 && self.timbre.as_ref().is_some_and(|timbre| timbre.gain > 0.0)
    }
}

impl Toolkit {
    /// Half the file's sample rate, Hz.
    pub fn nyquist_hz(&self) -> f64 {
        0.5 * self.sample_rate_hz
    }

    /// Speeds, mm/s, and forces, N, of all models, those of silent ones included.
    pub fn model_places(&self) -> impl Iterator<Item = (f64, f64)> {
        self.models
            .iter()
            .map(|model| (model.speed_mm_s, model.force_n))
    }

    /// Places in all triangles, with these barycentric weights of their corners.
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

    /// Removes the shape of silent models whose order is not that of the models that sound.
    ///
    /// # Errors
    /// Models that sound with different orders.
    pub(super) fn check_orders(&mut self, path: &Path) -> Result<()> {
        let orders = |timbre: &Timbre| (timbre.poles.len(), timbre.zeros.len());
        let of_model = |model: &ArmaModel| model.timbre.as_ref().map(orders);
        let sounding: Vec<_> = self.models.iter().filter(|m| m.sounds()).collect();
        let Some(common) = sounding.first().and_then(|first| of_model(first)) else {
            return Ok(());
        };
        if let Some(other) = sounding
            .iter()
            .find(|model| of_model(model) != Some(common))
        {
            let (poles, zeros) = of_model(other).unwrap_or_default();
            let problem = format!(
                "the model at {} mm/s, {} N has {poles} poles and {zeros} zeros, others have {} and {}: HaTT \
                 interpolates equal numbers only",
                other.speed_mm_s, other.force_n, common.0, common.1
            );
            return Err(Error::file(path, problem));
        }
        for model in self.models.iter_mut().filter(|model| !model.sounds()) {
            model.timbre = model
                .timbre
                .take()
                .filter(|timbre| orders(timbre) == common);
        }
        Ok(())
    }

    /// A remark if the triangles' area is not that of all speeds and forces up to the highest.
    pub(super) fn uncovered(&self) -> Option<String> {
        let place = |index: usize| {
            let model = &self.models[index];
            (
                model.speed_mm_s / self.max_speed_mm_s,
                model.force_n / self.max_force_n,
            )
        };
        let area = |triangle: &[usize; 3]| {
            let [a, b, c] = triangle.map(place);
            0.5 * ((b.0 - a.0) * (c.1 - a.1) - (c.0 - a.0) * (b.1 - a.1)).abs()
        };
        let percent = 100.0 * self.triangles.iter().map(area).sum::<f64>();
        let of = format!(
            "speeds up to {} mm/s and forces up to {} N",
            self.max_speed_mm_s, self.max_force_n
        );
        match percent {
            p if p < 99.0 => Some(format!(
                "the triangles cover {p:.0} % of {of}; beyond them the nearest place within counts"
            )),
            p if p > 101.0 => Some(format!(
                "the triangles overlap: they cover {p:.0} % of {of}"
            )),
            _ => None,
        }
    }
}
