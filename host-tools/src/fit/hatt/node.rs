//! All-pole models of the lowest order that holds a spectrum up to the models' own half rate.

use model_format::NodeFlags;

use super::between::{self, Between};
use super::toolkit::Toolkit;
use crate::dsp::log_spectrum::{LogSpectrum, STEP_HZ};
use crate::dsp::model::Model;
use crate::dsp::spectrum::{BAND_COUNT, band_edges_hz};

/// Worst error of a third octave that the order of a node may leave, dB.
pub const ORDER_TOLERANCE_DB: f64 = 0.4;

/// Orders that are tried. The last one is taken if none is within the tolerance.
const ORDERS: [usize; 17] = [
    6, 8, 10, 12, 14, 16, 18, 20, 23, 26, 30, 35, 42, 50, 65, 80, 100,
];

/// Returns the model at a speed, mm/s, and a force, N.
///
/// Its power between 0 Hz and the models' half rate is exactly theirs. A silent node keeps its shape, because shapes
/// are interpolated towards it.
pub(super) fn model(toolkit: &Toolkit, place: (f64, f64)) -> Model {
    let Between {
        shape,
        variance,
        is_extrapolated,
    } = between::at(toolkit, place);
    let mut flags = NodeFlags::NONE;
    if is_extrapolated {
        flags = flags.with(NodeFlags::EXTRAPOLATED);
    }
    let Some(shape) = shape else {
        return Model {
            flags: flags.with(NodeFlags::SILENT),
            ..Model::silent()
        };
    };
    let model = economical(&shape, 0.5 * toolkit.sample_rate_hz);
    let output_power = model.output_power * variance;
    if output_power as f32 <= 0.0 {
        flags = flags.with(NodeFlags::SILENT);
    }
    Model {
        output_power,
        flags,
        ..model
    }
}

fn economical(shape: &LogSpectrum, highest_hz: f64) -> Model {
    let full = shape.model(ORDERS[ORDERS.len() - 1]);
    let mut last = None;
    for order in ORDERS.map(|order| order.min(full.reflection.len())) {
        let model = Model {
            reflection: full.reflection[..order].to_vec(),
            ..full.clone()
        };
        let made = LogSpectrum::of_model(&model);
        let bands = shape.band_errors_db(&made);
        let own = (0..BAND_COUNT).filter(|&band| band_edges_hz(band).1 <= highest_hz);
        let is_near = own
            .filter_map(|band| bands[band])
            .all(|error| error.abs() <= ORDER_TOLERANCE_DB);
        let level = power_below(shape, highest_hz) / power_below(&made, highest_hz);
        last = Some(Model {
            output_power: model.output_power * level,
            ..model
        });
        if is_near {
            break;
        }
    }
    last.expect("there are orders")
}

/// Sum of the values below a frequency, which are proportional to power.
fn power_below(spectrum: &LogSpectrum, highest_hz: f64) -> f64 {
    let last = ((highest_hz / STEP_HZ).round() as usize).min(spectrum.values().len() - 1);
    let inner: f64 = spectrum.values()[1..last]
        .iter()
        .map(|value| value.exp())
        .sum();
    inner + 0.5 * (spectrum.values()[0].exp() + spectrum.values()[last].exp())
}
