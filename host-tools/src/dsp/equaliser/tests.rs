use model_format::scene::limits::MAX_SECTIONS;
use proptest::prelude::*;

use super::*;

const RATE_HZ: f64 = 5000.0;

fn response(points: &[(f64, f64)]) -> Response {
    Response::new(points.to_vec()).unwrap()
}

/// A voice coil as a mass on a spring: a resonance, and the roll-off of mass and inductance above it.
fn coil() -> Response {
    let points: Vec<(f64, f64)> = (0..80)
        .map(|n| {
            let hz = 20.0 * 60f64.powf(f64::from(n) / 79.0);
            let share = hz / 140.0;
            let resonance =
                share * share / ((1.0 - share * share).powi(2) + (share / 3.0).powi(2)).sqrt();
            let inductance = 1.0 / (1.0 + (hz / 900.0).powi(2)).sqrt();
            (hz, 20.0 * (resonance * inductance).log10())
        })
        .collect();
    response(&points)
}

fn request(max_gain_db: f64, max_sections: usize) -> Request {
    Request {
        max_gain_db,
        max_sections,
        lowest_hz: None,
        highest_hz: None,
    }
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
            let level: f64 = biquads
                .iter()
                .map(|b| stored_level_db(b, hz / RATE_HZ))
                .sum();
            (hz, level)
        })
        .collect();
    let found = design(&response(&points), RATE_HZ, &request(18.0, MAX_SECTIONS)).unwrap();
    assert!(found.before.rms_db > 3.0, "{found:?}");
    assert!(found.after.rms_db < 0.1, "{:?}", found.after);
}

#[test]
fn a_voice_coil_is_flattened_as_far_as_the_limit_lets() {
    for max_gain_db in [6.0, 12.0, 20.0] {
        let found = design(&coil(), RATE_HZ, &request(max_gain_db, MAX_SECTIONS)).unwrap();
        assert!(
            found.max_gain_db <= max_gain_db + 2e-3,
            "{}",
            found.max_gain_db
        );
        assert!(found.before.rms_db > 8.0, "{:?}", found.before);
        // The residual exceeds the deviation that the limit leaves by little more than half a decibel.
        let left = found.after.rms_db - found.limit_leaves.rms_db;
        assert!(
            left < 0.6,
            "{max_gain_db}: {:?} {:?}",
            found.after,
            found.limit_leaves
        );
    }
}

#[test]
fn more_sections_come_nearer_and_a_flat_response_takes_none() {
    let left: Vec<f64> = (1..=MAX_SECTIONS)
        .map(|most| {
            design(&coil(), RATE_HZ, &request(12.0, most))
                .unwrap()
                .after
                .rms_db
        })
        .collect();
    assert!(
        left.windows(2).all(|pair| pair[1] <= pair[0] + 0.3),
        "{left:?}"
    );
    assert!(left[7] < left[0] - 0.5, "{left:?}");
    let flat = response(&[
        (20.0, -31.0),
        (100.0, -31.0),
        (500.0, -31.0),
        (2000.0, -31.0),
    ]);
    let found = design(&flat, RATE_HZ, &request(12.0, 8)).unwrap();
    assert!(found.sections.is_empty(), "{found:?}");
    assert!((found.mean_level_db + 31.0).abs() < 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn any_response_gives_sections_that_the_format_takes_within_the_limit(
        steps in prop::collection::vec((1.02..1.6f64, -60.0..60.0f64), 4..24),
        max_gain_db in 0.0..24.0f64, max_sections in 1..=MAX_SECTIONS,
    ) {
        let mut hz = 15.0;
        let points: Vec<(f64, f64)> = steps
            .iter()
            .map(|(factor, level_db)| {
                hz *= factor;
                (hz, *level_db)
            })
            .collect();
        match design(&response(&points), RATE_HZ, &request(max_gain_db, max_sections)) {
            Err(fault) => prop_assert_eq!(fault.key, "response"),
            Ok(found) => {
                prop_assert!(found.sections.len() <= max_sections);
                prop_assert!(found.max_gain_db <= max_gain_db + 2e-3);
                prop_assert!(found.biquads.iter().all(model_format::scene::Biquad::poles_are_within_limit));
                prop_assert!(found.after.rms_db.is_finite());
            }
        }
    }
}

#[test]
fn requests_that_cannot_be_are_refused_by_their_key() {
    let narrow = response(&[(100.0, 0.0), (101.0, 1.0), (102.0, 2.0), (103.0, 3.0)]);
    for (response, request, key) in [
        (coil(), request(-1.0, 8), "max_gain_db"),
        (coil(), request(f64::NAN, 8), "max_gain_db"),
        (coil(), request(25.0, 8), "max_gain_db"),
        (coil(), request(12.0, 0), "max_sections"),
        (coil(), request(12.0, 9), "max_sections"),
        (
            coil(),
            Request {
                lowest_hz: Some(5.0),
                ..request(12.0, 8)
            },
            "lowest_hz",
        ),
        (
            coil(),
            Request {
                highest_hz: Some(9000.0),
                ..request(12.0, 8)
            },
            "highest_hz",
        ),
        (
            coil(),
            Request {
                highest_hz: Some(25.0),
                ..request(12.0, 8)
            },
            "highest_hz",
        ),
        (narrow, request(12.0, 8), "response"),
    ] {
        assert_eq!(design(&response, RATE_HZ, &request).unwrap_err().key, key);
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
