//! Properties that every picture has, whatever it shows.

use model_format::NodeFlags;
use plotters::style::RGBColor;

use super::canvas::tests::{Text, texts};
use super::*;

const CAPTION: Caption<'_> = Caption {
    title: "a picture",
    simulated: true,
};

/// A signal of some seconds at 5 kHz that is not periodic.
fn signal(seed: f64) -> Vec<f64> {
    (0..12_000)
        .map(|n| {
            let n = f64::from(n);
            (0.31 * n + seed).sin() + 0.4 * (0.043 * n * (1.0 + 1e-5 * n)).sin()
        })
        .collect()
}

fn map() -> Svg {
    let speeds: Vec<f64> = (1..=15).map(|n| 20.0 * f64::from(n)).collect();
    let forces: Vec<f64> = (1..=7).map(|n| 0.2 * f64::from(n)).collect();
    let cells: Vec<GridCell> = (0..15 * 7)
        .map(|n| GridCell {
            value: (n % 11 != 0).then(|| f64::from(n) - 0.04),
            flags: [
                NodeFlags::NONE,
                NodeFlags::INTERPOLATED,
                NodeFlags::DOUBTFUL,
            ][n as usize % 3],
        })
        .collect();
    let map = GridMap {
        texture: "test",
        speeds_mm_s: &speeds,
        forces_n: &forces,
        cells: &cells,
        quantity: COST,
        scale: Scale::of(cells.iter().filter_map(|cell| cell.value)),
        decimals: 1,
    };
    grid_map(&CAPTION, &map).unwrap()
}

fn front() -> Svg {
    let point = |n: i32| FrontPoint {
        x: 300.0 * 1.2f64.powi(n),
        y: 6.0 / f64::from(1 + n),
        joined: true,
    };
    let series: Vec<FrontSeries> = (0..5)
        .map(|index| FrontSeries {
            name: format!("a structure, {index} bits"),
            points: (0..12).map(|n| point(n + index)).collect(),
            dashed: index % 2 == 0,
        })
        .collect();
    let line = |look| FrontLine {
        name: format!("front {look:?}"),
        look,
        points: (0..16)
            .map(|n| (point(n).x, point(n).y, format!("{} @ {n}", 10 * n)))
            .collect(),
    };
    let looks = [FrontLook::Ringed, FrontLook::Squared, FrontLook::Faded];
    front_chart(
        &CAPTION,
        (
            FrontAxis::octaves(Quantity::new("cycles", "1 per sample")),
            FrontAxis::from_zero(Quantity::new("RMS error", "dB")),
        ),
        &series,
        &looks.map(line),
    )
    .unwrap()
}

fn orders() -> Svg {
    let costs = [(0, 1.0), (50, 0.4), (400, 0.2)];
    let names = [
        "paper", "organza", "vinyl", "denim", "cork", "felt", "slate",
    ];
    let series = names.map(|name| OrderSeries {
        name,
        costs: &costs,
        chosen: Some(120),
    });
    order_against_cost(&CAPTION, &series).unwrap()
}

fn bands() -> Svg {
    let errors = std::array::from_fn(|band| Some((band as f64 * 1.7).sin() * 12.0 - 0.02));
    let mut errors: [Option<f64>; crate::dsp::spectrum::BAND_COUNT] = errors;
    (errors[0], errors[1]) = (None, Some(-0.04));
    band_error_chart(&CAPTION, &errors, None).unwrap()
}

/// Every kind of picture, by name.
pub fn pictures() -> Vec<(&'static str, Svg)> {
    let (one, two) = (signal(0.0), signal(1.0));
    let signals = [("recording", &one[..]), ("synthesis: Gaussian", &two[..])];
    let mut all = vec![
        ("map", map()),
        ("front", front()),
        ("orders", orders()),
        ("bands", bands()),
        (
            "spectra",
            time_and_frequency(&CAPTION, &one, &two, 5000.0, &SpectraView::default()).unwrap(),
        ),
        (
            "waveforms",
            waveforms(&CAPTION, &signals, 5000.0, None).unwrap(),
        ),
    ];
    #[cfg(feature = "spectrograms")]
    all.extend(with_bitmaps(&one, &two));
    all
}

#[cfg(feature = "spectrograms")]
fn with_bitmaps(one: &[f64], two: &[f64]) -> Vec<(&'static str, Svg)> {
    use crate::playing::motion::{Hand, MotionPath};
    use model_format::{MillimetresPerSecond, Newton};
    let nodes: Vec<(f64, f64, f64)> = (1..9).map(|n| (20.0 * f64::from(n), 0.4, 0.5)).collect();
    let motion = MotionPath::constant(MillimetresPerSecond(100.0), Newton(1.0)).unwrap();
    let view = SceneView {
        surface_names: &["smooth".to_owned(), "never touched".to_owned()],
        regions: &[],
        hand: Hand::new(&motion),
        samples_m_s2: one,
        rate_hz: 5000.0,
        highest_hz: 1000.0,
    };
    vec![
        (
            "prediction",
            forward_prediction(&CAPTION, &one[..500], &two[..500], 5000.0, None).unwrap(),
        ),
        (
            "motion",
            grid_and_motion(&CAPTION, "test", &nodes, &[(20.0, 0.2), (150.0, 1.0)], None).unwrap(),
        ),
        (
            "spectrograms",
            spectrograms(&CAPTION, one, two, 5000.0, 1000.0, None).unwrap(),
        ),
        ("scene", scene(&CAPTION, &view).unwrap()),
    ]
}

#[test]
fn no_text_of_a_picture_covers_another() {
    for (name, svg) in pictures() {
        let texts = texts(&svg);
        for (index, text) in texts.iter().enumerate() {
            for other in &texts[index + 1..] {
                assert!(
                    !text.frame.meets(&other.frame),
                    "{name}: {text:?} covers {other:?}"
                );
            }
        }
    }
}

/// Names of quantities that are ratios or counts.
const WITHOUT_UNIT: [&str; 3] = [
    "order of the model",
    "largest pole radius",
    "largest reflection |k|",
];

/// Returns whether a text names a quantity with its unit, one without, or is a line of one in two lines.
fn is_quantity(text: &str, others: &[&Text]) -> bool {
    let is_line_of_two = || {
        others.iter().any(|other| {
            let is_name = other.words.ends_with(',') && !text.ends_with(',');
            let is_unit = text.ends_with(',') && !other.words.ends_with(',');
            other.runs_up && (is_name || is_unit)
        })
    };
    let has_unit = text
        .rsplit_once(", ")
        .is_some_and(|(name, unit)| !name.is_empty() && !unit.is_empty() && unit.len() < 24);
    WITHOUT_UNIT.contains(&text) || has_unit || is_line_of_two()
}

#[test]
fn every_axis_and_every_bar_has_a_quantity_with_its_unit() {
    for (name, svg) in pictures() {
        let texts = texts(&svg);
        let upwards: Vec<&Text> = texts.iter().filter(|text| text.runs_up).collect();
        assert!(!upwards.is_empty(), "{name}");
        for text in &upwards {
            assert!(is_quantity(&text.words, &upwards), "{name}: {}", text.words);
        }
        // The lowest text is the name of the horizontal axis.
        let lowest = texts.iter().filter(|text| !text.runs_up);
        let lowest = lowest.max_by_key(|text| text.frame.bottom).unwrap();
        assert!(is_quantity(&lowest.words, &[]), "{name}: {}", lowest.words);
        // A map's colours have a bar: one more text that runs upwards than axes do.
        let is_map = ["map", "spectrograms", "scene"];
        if is_map.iter().any(|map| name.starts_with(map)) {
            let right = upwards.iter().map(|text| text.frame.right).max().unwrap();
            assert!(right > canvas::at(960 - canvas::BAR), "{name} has no bar");
        }
    }
}

#[test]
fn no_number_is_minus_zero_and_no_order_is_called_n() {
    for (name, svg) in pictures() {
        for text in texts(&svg) {
            let is_zero = text.words.parse::<f64>().is_ok_and(|value| value == 0.0);
            assert!(
                !(is_zero && text.words.starts_with(['-', '+'])),
                "{name}: {}",
                text.words
            );
            assert!(!text.words.contains("n = "), "{name}: {}", text.words);
        }
    }
}

/// Counts the colours of series that are drawn as lines or bars, and those that stand in the legend.
#[test]
fn the_legend_has_an_entry_for_each_curve_that_is_drawn_and_for_no_other() {
    let nothing = FrontSeries {
        name: "nothing to draw".to_owned(),
        points: vec![FrontPoint {
            x: 3.0,
            y: f64::NAN,
            joined: true,
        }],
        dashed: false,
    };
    let one = FrontSeries {
        name: "one".to_owned(),
        points: vec![FrontPoint {
            x: 3.0,
            y: 2.0,
            joined: true,
        }],
        dashed: false,
    };
    let axis = |name| FrontAxis::from_zero(Quantity::new(name, "dB"));
    let svg = front_chart(&CAPTION, (axis("x"), axis("y")), &[nothing, one], &[]).unwrap();
    let has = |svg: &Svg, name: &str| texts(svg).iter().any(|text| text.words == name);
    assert!(has(&svg, "one") && !has(&svg, "nothing to draw"));

    let costs = [(0, f64::NAN), (5, f64::NAN)];
    let series = OrderSeries {
        name: "unknown",
        costs: &costs,
        chosen: Some(5),
    };
    let svg = order_against_cost(&CAPTION, &[series]).unwrap();
    assert!(!has(&svg, "unknown (order 5)") && !has(&svg, "the library's order there"));

    let beyond = "error beyond";
    assert!(has(&bands(), beyond));
    let small = band_error_chart(
        &CAPTION,
        &[Some(0.5); crate::dsp::spectrum::BAND_COUNT],
        None,
    );
    assert!(!has(&small.unwrap(), beyond));
}

#[test]
fn no_colour_of_a_line_is_drawn_that_a_dark_screen_does_not_replace() {
    for (name, svg) in pictures() {
        for stroke in svg.as_str().split("stroke=\"#").skip(1) {
            let hex = &stroke[..6];
            let part = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
            let colour = RGBColor(part(0), part(2), part(4));
            let is_replaced = colours::dark_style().contains(&format!("[stroke='#{hex}']"));
            // Marks on the cells of a map.
            let is_on_cell = [colours::ON_PALE, RGBColor(255, 255, 255)].contains(&colour);
            assert!(is_replaced || is_on_cell, "{name}: #{hex}");
        }
    }
}
