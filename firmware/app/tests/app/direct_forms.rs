//! Direct forms whose certificate has nothing behind it: the device proves them itself, or refuses them.

use embassy_futures::block_on;
use model_format::{
    CodeSpec, Laws, NodeFlags, NodeSpec, Provenance, SAMPLE_RATE_HZ, Structure, TextureSpec, encode,
};
use stylus_app::slots::SlotStore;
use stylus_app::upload::Uploader;

use fake_stylus::flash::SimulatedFlash;
use fake_stylus::library::upload;

/// A node of these predictor coefficients.
fn node(predictor: &[f64]) -> NodeSpec {
    /// Binary exponent: coefficients below 8.
    const EXPONENT: u8 = 3;
    let code = |h: &f64| (h * 2f64.powi(15 - i32::from(EXPONENT))).round() as i16;
    NodeSpec {
        output_power: 1.0,
        prediction_error_power: 0.01,
        flags: NodeFlags::NONE,
        codes: CodeSpec::Direct16 {
            exponent: EXPONENT,
            codes: predictor.iter().map(code).collect(),
        },
    }
}

/// A library of one texture with these nodes along the speed axis. Its certificate is well formed and claims `margin`
/// for each cell.
fn forged(predictors: &[&[f64]], margin: u8) -> Vec<u8> {
    let cells = (predictors.len() - 1).max(1);
    let spec = TextureSpec {
        name: "forged".to_owned(),
        sample_rate_hz: SAMPLE_RATE_HZ,
        structure: Structure::DirectForm16,
        provenance: Provenance::Simulated,
        laws: Laws::default(),
        speed_axis_mm_s: (1..=predictors.len()).map(|speed| speed as f32).collect(),
        force_axis_n: vec![1.0],
        nodes: predictors.iter().map(|predictor| node(predictor)).collect(),
        cell_margins: vec![margin; cells],
    };
    encode(&[spec]).expect("the certificate is well formed")
}

/// The fate of an upload of `bytes`: the refusal, or none.
fn refusal(bytes: &[u8]) -> Option<String> {
    let mut flash = SimulatedFlash::two_slots();
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        let committed = upload(&mut Uploader::new(), &mut store, bytes, 512).await;
        let newest = store.newest();
        assert_eq!(committed.is_ok(), newest.is_some());
        committed.err().map(|error| error.to_string())
    })
}

/// Margin that claims next to nothing: 2^-63.
const LEAST: u8 = 252;

#[test]
fn an_unstable_direct_form_with_a_forged_certificate_is_refused() {
    for predictor in [&[1.5][..], &[2.5, -1.0], &[0.0, -1.001], &[1.0]] {
        let refusal = refusal(&forged(&[predictor], LEAST)).expect("it is unstable");
        assert!(refusal.contains("forged"), "{refusal}");
    }
}

/// The means of (1 - 0.9 z⁻¹)³ and (1 + 0.9 z⁻¹)³ have poles of radius up to 1.56.
const STABLE_ALONE: [&[f64]; 2] = [&[2.7, -2.43, 0.729], &[-2.7, -2.43, -0.729]];

#[test]
fn a_direct_form_that_is_stable_at_its_nodes_and_not_between_is_refused() {
    assert!(refusal(&forged(&STABLE_ALONE, LEAST)).is_some());
    for predictor in STABLE_ALONE {
        assert_eq!(refusal(&forged(&[predictor], LEAST)), None);
    }
}

#[test]
fn a_direct_form_with_a_claim_beyond_its_margin_is_refused() {
    // |1 - 0.9 e^(-jω)| is at least 0.1, which is 2^-3.32.
    let claimed = |margin: u8| refusal(&forged(&[&[0.9], &[0.9]], margin));
    assert_eq!(claimed(16), None);
    assert!(claimed(12).is_some());
}
