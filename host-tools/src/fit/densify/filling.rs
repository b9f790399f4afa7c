//! The nodes that are filled in, and those that are left out.

use model_format::NodeFlags;
use serde::Serialize;

use crate::dsp::log_spectrum::LogSpectrum;
use crate::dsp::model::Model;
use crate::texture::grid::{Grid, as_written};
use crate::texture::recorded_spectra::spectra::RecordedSpectra;

/// Worst error of a third octave that a densified node's order may leave, dB: well below the amplitude JND.
pub const ECONOMY_DB: f64 = 0.5;

/// A recorded node that filling in would make worse: with its recording taken out, C is higher in the denser grid than
/// in the fitted one. Nothing is filled in beside it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// The texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// C as the device interpolates in the fitted grid, and in the denser one if it were filled in here.
    pub costs: [f64; 2],
}

/// The filled nodes of one texture: where they may be, and up to which order.
#[derive(Clone, Debug)]
pub struct Filling {
    /// The speeds of the denser grid, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// The forces of the denser grid, N.
    pub forces_n: Vec<f32>,
    /// The highest order of the recorded nodes, which no filled one exceeds.
    pub highest_order: usize,
    /// Speeds, mm/s, and forces, N, between which, exclusively, nothing is filled in.
    closed: Vec<[(f64, f64); 2]>,
}

impl Filling {
    /// The filling of `grid`, which is that of `texture` as it was fitted.
    pub(super) fn of(texture: &str, grid: &Grid, left_out: &[LeftOut]) -> Self {
        let of_it = left_out.iter().filter(|node| node.texture == texture);
        let closed = of_it.map(|node| {
            [
                around(&grid.speeds_mm_s, node.speed_mm_s),
                around(&grid.forces_n, node.force_n),
            ]
        });
        Self {
            speeds_mm_s: grid.speeds_mm_s.clone(),
            forces_n: grid.forces_n.clone(),
            highest_order: highest_order(grid),
            closed: closed.collect(),
        }
    }

    /// The model to be filled in at a speed, mm/s, and a force, N; `None` where it is left out or not known.
    pub fn model_at(
        &self,
        field: &RecordedSpectra,
        speed_mm_s: f64,
        force_n: f64,
    ) -> Option<Model> {
        if !self.allows(speed_mm_s, force_n) {
            return None;
        }
        let spectrum = field.at(speed_mm_s, force_n)?;
        Some(filled_model(&spectrum, self.highest_order))
    }

    /// True if nothing that is left out is beside the place.
    pub fn allows(&self, speed_mm_s: f64, force_n: f64) -> bool {
        let inside = |(low, high): (f64, f64), value: f64| low < value && value < high;
        !(self.closed.iter())
            .any(|[speeds, forces]| inside(*speeds, speed_mm_s) && inside(*forces, force_n))
    }
}

/// The model that is filled in where `spectrum` is what the recordings tell.
pub(super) fn filled_model(spectrum: &LogSpectrum, highest_order: usize) -> Model {
    Model {
        flags: NodeFlags::INTERPOLATED,
        ..spectrum.economical_model(ECONOMY_DB, highest_order)
    }
}

/// The highest order among the recorded nodes of `grid`.
pub fn highest_order(grid: &Grid) -> usize {
    let filled = [NodeFlags::INTERPOLATED, NodeFlags::EXTRAPOLATED];
    let recorded =
        (grid.models.iter()).filter(|model| !filled.iter().any(|&flag| model.flags.contains(flag)));
    let orders = recorded.map(|model| model.reflection.len());
    orders.max().unwrap_or(0)
}

/// The values of an axis before and after `value`, or infinity.
fn around(axis: &[f32], value: f64) -> (f64, f64) {
    let known = || axis.iter().map(|&known| as_written(known));
    let is_it = |known: f64| (known - value).abs() < 1e-6;
    let below = known().rfind(|&known| known < value && !is_it(known));
    let above = known().find(|&known| known > value && !is_it(known));
    (
        below.unwrap_or(f64::NEG_INFINITY),
        above.unwrap_or(f64::INFINITY),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::Laws;

    fn grid() -> Grid {
        let orders = [3, 9, 4, 2, 5, 1, 7, 6, 2];
        let model = |&order: &usize| Model {
            reflection: vec![0.1; order],
            output_power: 1.0,
            flags: if order == 9 {
                NodeFlags::INTERPOLATED
            } else {
                NodeFlags::NONE
            },
        };
        Grid {
            speeds_mm_s: vec![50.0, 100.0, 150.0],
            forces_n: vec![0.2, 0.4, 0.6],
            models: orders.iter().map(model).collect(),
            parts: model_format::PartsSpec::default(),
            laws: Laws::default(),
        }
    }

    #[test]
    fn nothing_is_filled_in_beside_what_is_left_out_and_all_else_is() {
        let node = |texture: &str| LeftOut {
            texture: texture.into(),
            speed_mm_s: 100.0,
            force_n: 0.2,
            costs: [0.2, 0.3],
        };
        let filling = Filling::of("felt", &grid(), &[node("felt")]);
        for (speed_mm_s, force_n, allowed) in [
            (75.0, 0.2, false),
            (100.0, 0.3, false),
            (125.0, 0.3, false),
            (50.0, 0.3, true),
            (150.0, 0.3, true),
            (75.0, 0.4, true),
            (125.0, 0.5, true),
        ] {
            assert_eq!(
                filling.allows(speed_mm_s, force_n),
                allowed,
                "{speed_mm_s} {force_n}"
            );
        }
        assert!(Filling::of("felt", &grid(), &[node("wool")]).allows(75.0, 0.2));
        // What was filled in before does not count.
        assert_eq!(filling.highest_order, 7);
    }
}
