use model_format::scene::limits::MAX_RESPONSE_SECTIONS;
use proptest::prelude::*;

use super::*;

const RATE_HZ: f64 = 5000.0;

fn response(points: &[(f64, f64)]) -> Response {
    Response::new(points.to_vec()).unwrap()
}

/// A voice coil as a mass on a spring: a resonance, and above it the roll-off caused by mass and inductance.
fn coil() -> Response {
    let points: Vec<(f64, f64)> = (0..80)
        .map(|n| {
            let hz = 20.0 * 60f64.powf(f64::from(n) / 79.0);
            let share = hz / 140.0;
            let resonance = share * share / ((1.0 - share * share).powi(2) + (share / 3.0).powi(2)).sqrt();
            let inductance = 1.0 / (1.0 + (hz / 900.0).powi(2)).sqrt();
            (hz, 20.0 * (resonance * inductance).log10())
        })
        .collect();
    response(&points)
}

/// RMS deviation from a flat response, dB, of `response` through `sections` from 22 to 950 Hz. A level that is more
/// than `most_db` below the mean counts as that far below it, because no frequency is raised by more.
fn deviation_db(response: &Response, sections: &[Biquad], most_db: f64) -> f64 {
    let hz = |n: u32| 22.0 * (950.0f64 / 22.0).powf(f64::from(n) / 299.0);
    let own: Vec<f64> = (0..300).map(|n| response.level_db(hz(n))).collect();
    let mean = own.iter().sum::<f64>() / 300.0;
    let off = (0..)
        .zip(&own)
        .map(|(n, own)| own.max(mean - most_db) - mean + cascade_db(sections, RATE_HZ, hz(n)));
    (off.map(|off| off * off).sum::<f64>() / 300.0).sqrt()
}

#[test]
fn the_inverse_of_sections_is_those_sections() {
    let known = [
        Section {
            kind: SectionKind::Peaking,
            frequency_hz: 150.0,
            q: 2.0,
            gain_db: 9.0,
        },
        Section {
            kind: SectionKind::HighShelf,
            frequency_hz: 700.0,
            q: 0.7,
            gain_db: -6.0,
        },
    ];
    let biquads = known.map(|section| section.biquad(RATE_HZ).unwrap());
    let points: Vec<(f64, f64)> = (0..300)
        .map(|n| {
            let hz = 20.0 * 100f64.powf(f64::from(n) / 299.0);
            let level: f64 = biquads.iter().map(|b| stored_level_db(b, hz / RATE_HZ)).sum();
            (hz, level)
        })
        .collect();
    let response = response(&points);
    let found = design(&response, RATE_HZ, 18.0).unwrap();
    assert!(deviation_db(&response, &[], 60.0) > 2.0, "{found:?}");
    let after_db = deviation_db(&response, &found.biquads, 60.0);
    assert!(after_db < 0.1, "{after_db}");
}

#[test]
fn a_voice_coil_is_flattened_as_far_as_the_limit_lets() {
    for (max_gain_db, most_left_db) in [(6.0, 0.6), (12.0, 0.6), (20.0, 0.85)] {
        let found = design(&coil(), RATE_HZ, max_gain_db).unwrap();
        assert!(found.max_gain_db <= max_gain_db + 2e-3, "{}", found.max_gain_db);
        assert!(deviation_db(&coil(), &[], 60.0) > 8.0);
        // This deviation does not count what the limit on the gain prevents. With six sections, it is less than the
        // decibel that a calibration may leave.
        let left_db = deviation_db(&coil(), &found.biquads, max_gain_db);
        assert!(left_db < most_left_db, "{max_gain_db}: {left_db} dB");
    }
}

#[test]
fn a_flat_response_takes_no_section() {
    let flat = response(&[(20.0, -31.0), (100.0, -31.0), (500.0, -31.0), (2000.0, -31.0)]);
    assert_eq!(design(&flat, RATE_HZ, 12.0).unwrap().sections, []);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn any_response_gives_sections_that_the_format_takes_within_the_limit(
        steps in prop::collection::vec((1.02..1.6f64, -60.0..60.0f64), 4..24),
        max_gain_db in 0.0..24.0f64,
    ) {
        let mut hz = 15.0;
        let points: Vec<(f64, f64)> = steps
            .iter()
            .map(|(factor, level_db)| {
                hz *= factor;
                (hz, *level_db)
            })
            .collect();
        match design(&response(&points), RATE_HZ, max_gain_db) {
            Err(fault) => {
                prop_assert!(matches!(fault, ResponseFault::Band { .. }), "{}", fault);
            }
            Ok(found) => {
                prop_assert!(found.sections.len() <= MAX_RESPONSE_SECTIONS);
                prop_assert!(found.max_gain_db <= max_gain_db + 2e-3);
                prop_assert!(found.biquads.iter().all(model_format::scene::Biquad::poles_are_within_limit));
            }
        }
    }
}

#[test]
fn gains_and_sections_out_of_their_range_are_refused() {
    for max_gain_db in [-1.0, f64::NAN, 25.0] {
        let fault = design(&coil(), RATE_HZ, max_gain_db).unwrap_err();
        assert!(matches!(fault, ResponseFault::Gain { .. }), "{fault}");
    }
    for section in [
        Section {
            kind: SectionKind::Peaking,
            frequency_hz: f64::NAN,
            q: 1.0,
            gain_db: 1.0,
        },
        Section {
            kind: SectionKind::Peaking,
            frequency_hz: 2400.0,
            q: 1.0,
            gain_db: 1.0,
        },
        Section {
            kind: SectionKind::LowShelf,
            frequency_hz: 100.0,
            q: 0.0,
            gain_db: 1.0,
        },
        Section {
            kind: SectionKind::HighShelf,
            frequency_hz: 100.0,
            q: 1.0,
            gain_db: f64::INFINITY,
        },
    ] {
        assert!(section.biquad(RATE_HZ).is_err(), "{section:?}");
    }
}
