//! The direct form: its accuracy, and its shortcoming compared with the lattice.

use model_format::Texture;
use stylus_hard_cases::Deviation;
use stylus_kernel::direct_form::{self, DirectFrame, DirectState};
use stylus_kernel::excitation::{Excitation, FRACTION_BITS};
use stylus_kernel::grid::GridPoint;
use stylus_kernel::level::Levels;

use crate::models::{Model, fixture, motion, single, texture};

const DEVIATION: f64 = (1u32 << FRACTION_BITS) as f64;

/// Output power of every model here, (m/s²)².
const POWER: f32 = 100.0;

/// The texture of a library of one node, and its grid point at that node.
fn located(bytes: &[u8]) -> (Texture<'_>, GridPoint) {
    let texture = texture(bytes);
    (texture, GridPoint::locate(&texture, motion(100.0, 1.0)))
}

/// Exponent of codes that hold the predictors of all fixtures here.
const EXPONENT: u32 = 8;

fn codes(model: &Model) -> Vec<i32> {
    let one = f64::from(1 << (direct_form::COEFFICIENT_FRACTION_BITS - EXPONENT));
    let code = |h: &f64| (h * one).round() as i32;
    model.predictor.iter().map(code).collect()
}

/// Compares the direct form of a model with float64's own recursion on the same excitation.
#[test]
fn a_direct_form_is_its_recursion_in_float64() {
    for name in ["H1a", "H1b"] {
        let (model, codes) = (fixture(name), codes(&fixture(name)));
        let bytes = single(model.node(POWER));
        let (texture, point) = located(&bytes);
        let mut frame = DirectFrame::silent(&texture, EXPONENT);
        frame.update(&texture, &point, [&codes; 4], Levels::SILENT, 1);
        let (mut state, mut noise) = (DirectState::new(), Excitation::new(5));
        let (mut history, mut deviation) = (Vec::<f64>::new(), Deviation::default());
        for _ in 0..20_000 {
            let excitation = noise.next_sample();
            let (output, saturated) = state.next_sample(&frame, excitation, 0);
            assert!(!saturated, "{name}");
            let past = model.predictor.iter().zip(history.iter().rev());
            let driven = f64::from(excitation) / DEVIATION * (f64::from(POWER) * model.error).sqrt();
            let exact = driven + past.map(|(h, y)| h * y).sum::<f64>();
            history.push(exact);
            deviation.add(exact, f64::from(output.metres_per_second_squared().0));
        }
        assert!(deviation.snr_db() > 70.0, "{name}: {}", deviation.snr_db());
    }
}
