//! Tests of properties that every kind of picture must have.

use model_format::NodeFlags;
use plotters::style::RGBColor;

use super::figure::Kind;
use super::*;

const CAPTION: Caption<'_> = Caption::new("a picture", true);

/// A signal of 2.4 s at 5 kHz that is not periodic.
fn signal(seed: f64) -> Vec<f64> {
    (0..12_000)
        .map(|n| {
            let n = f64::from(n);
            (0.31 * n + seed).sin() + 0.4 * (0.043 * n * (1.0 + 1e-5 * n)).sin()
        })
        .collect()
}

/// Values that a picture must tolerate.
const ODD: [f64; 6] = [0.0, f64::NAN, f64::INFINITY, 1e300, -1e300, 3.0];

fn map(speeds: usize, forces: usize, value: impl Fn(usize) -> Option<f64>) -> Svg {
    let axis = |count: usize, step: f64| (1..=count).map(move |n| step * n as f64);
    let flags = [NodeFlags::NONE, NodeFlags::INTERPOLATED, NodeFlags::DOUBTFUL];
    let cells: Vec<GridCell> = (0..speeds * forces)
        .map(|n| GridCell {
            value: value(n),
            flags: flags[n % 3],
        })
        .collect();
    let map = GridMap {
        texture: "test",
        speeds_mm_s: &axis(speeds, 20.0).collect::<Vec<_>>(),
        forces_n: &axis(forces, 0.2).collect::<Vec<_>>(),
        cells: &cells,
        quantity: COST,
        scale: Scale::of(cells.iter().filter_map(|cell| cell.value)),
    };
    grid_map(&CAPTION, &map, WIDE).unwrap()
}

fn front(in_octaves: bool, value: impl Fn(i32) -> f64) -> Svg {
    let series = |index: i32| FrontSeries {
        name: format!("a structure, {index} bits"),
        points: (0..12)
            .map(|n| FrontPoint {
                x: 300.0 * 1.2f64.powi(n + index),
                y: value(n + index),
                name: format!("{n} @ 2 ms"),
            })
            .collect(),
        dashed: index % 2 == 0,
    };
    let all: Vec<FrontSeries> = (0..6).map(series).collect();
    let axes = (
        Quantity::new("cycles", "1 per sample"),
        Quantity::new("RMS error", "dB"),
    );
    let place = &all[5].points[0];
    let names = [("thrifty", place.x, place.y)];
    front_chart(&CAPTION, axes, in_octaves, (&all[..5], &all[5..]), &names).unwrap()
}

/// Levels of a fall of 12 dB per octave, and of silence.
fn with_densities() -> Svg {
    let points: Vec<(f64, f64)> = (16..1000)
        .map(|hz| (f64::from(hz), -40.0 * f64::from(hz).log10()))
        .collect();
    let silent: Vec<(f64, f64)> = points.iter().map(|point| (point.0, f64::NEG_INFINITY)).collect();
    let curves = [("recorded", &points), ("synthesised", &silent)].map(|(name, points)| Curve { name, points });
    densities(&CAPTION, &curves).unwrap()
}

/// Pictures with typical data, by name: every kind but responses and empty axes.
pub fn pictures() -> Vec<(&'static str, Svg)> {
    let (one, two) = (signal(0.0), signal(1.0));
    let signals = [("recording", &one[..]), ("synthesis: Gaussian", &two[..])];
    vec![
        ("map", map(15, 7, |n| (n % 11 != 0).then_some(n as f64 + 0.01))),
        ("front", front(true, |n| 6.0 / f64::from(1 + n))),
        ("spectra", spectra(&CAPTION, (&one, &two), 5000.0, 20.0).unwrap()),
        ("waveforms", waveforms(&CAPTION, &signals, 5000.0).unwrap()),
        ("densities", with_densities()),
        (
            "spectrograms",
            spectrograms(&CAPTION, (&one, &two), 5000.0, 1000.0).unwrap(),
        ),
    ]
}

/// Pictures without data, of one value, and of values that are not finite.
fn odd_pictures() -> Vec<(&'static str, Svg)> {
    let mut all = vec![
        ("map of one", map(1, 1, |_| Some(1.0))),
        ("odd front", front(true, |n| ODD[n as usize % 6])),
        ("even front", front(false, |_| f64::NAN)),
    ];
    let zeros = vec![0.0; 5000];
    for signal in [&[][..], &[1.0], &zeros, &ODD] {
        all.push(("odd waves", waveforms(&CAPTION, &[("one", signal)], 5000.0).unwrap()));
        all.push((
            "odd spectra",
            spectra(&CAPTION, (signal, signal), 5000.0, 20.0).unwrap(),
        ));
    }
    all
}

/// A text of a picture, with the frame that it approximately fills and its direction.
struct Text {
    words: String,
    frame: figure::Frame,
    runs_up: bool,
}

/// Returns all texts of a picture, with the text sizes that the layout assumes.
fn texts(svg: &Svg) -> Vec<Text> {
    let elements = svg.as_str().split("<text ").skip(1);
    let text = |element: &str| {
        let (attributes, rest) = element.split_once('>').unwrap();
        let words = rest.split('<').next().unwrap().trim().to_owned();
        let attribute = |name: &str| {
            let (_, rest) = attributes.split_once(&format!("{name}=\"")).unwrap();
            rest.split('"').next().unwrap()
        };
        let number = |name| attribute(name).parse::<f64>().unwrap();
        let (x, y, size) = (number("x") as i32, number("y") as i32, number("font-size"));
        let width = (words.chars().count() as f64 * size * 0.56) as i32;
        let height = size as i32;
        let runs_up = attributes.contains("rotate(270");
        let shift = match attribute("text-anchor") {
            "start" => width / 2,
            "end" => -width / 2,
            _ => 0,
        };
        let lift = match attribute("dy") {
            "0.76em" => height / 2,
            "-0.5ex" => -height / 2,
            _ => 0,
        };
        let ((x, y), (width, height)) = if runs_up {
            ((x + lift, y - shift), (height, width))
        } else {
            ((x + shift, y + lift), (width, height))
        };
        let frame = figure::Frame {
            left: x - width / 2,
            top: y - height / 2,
            right: x + width / 2,
            bottom: y + height / 2,
        };
        Text { words, frame, runs_up }
    };
    elements.map(text).filter(|text| !text.words.is_empty()).collect()
}

fn meet(a: figure::Frame, b: figure::Frame) -> bool {
    a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom
}

#[test]
fn no_text_stands_on_curves_or_levels_and_levels_fill_their_axes() {
    let is_named = |own: &figure::Series| matches!(own.kind, Kind::Points | Kind::Cells);
    for (name, svg) in pictures() {
        for panel in svg.panels().iter().filter(|panel| !panel.series.iter().any(is_named)) {
            for text in texts(&svg) {
                assert!(!meet(text.frame, panel.frame), "{name}: '{}'", text.words);
            }
            if let Some(figure::Bitmap { x: [first, step], .. }) = panel.bitmap {
                assert!((first - 0.5 * step - panel.x.from).abs() < 1e-9, "{name}");
            }
        }
    }
}

#[test]
fn no_text_of_a_picture_covers_another_and_no_number_is_minus_zero() {
    for (name, svg) in pictures() {
        let texts = texts(&svg);
        for (index, text) in texts.iter().enumerate() {
            let is_zero = text.words.parse::<f64>().is_ok_and(|value| value == 0.0);
            assert!(!(is_zero && text.words.starts_with(['-', '+'])), "{name}");
            for other in &texts[index + 1..] {
                let meets = meet(text.frame, other.frame);
                assert!(!meets, "{name}: '{}' covers '{}'", text.words, other.words);
            }
        }
    }
}

#[test]
fn every_axis_and_every_bar_has_a_quantity_with_its_unit() {
    for (name, svg) in pictures() {
        for panel in svg.panels() {
            let thirds = panel.series.iter().filter_map(|series| series.z.as_ref());
            for own in [panel.x.quantity, panel.y.quantity]
                .into_iter()
                .chain(thirds.map(|third| third.quantity))
            {
                assert!(!own.name.is_empty() && !own.unit.is_empty(), "{name}: {own:?}");
                let written = |wanted: &str| texts(&svg).iter().any(|text| text.words == wanted);
                let is_in_two = written(&format!("{},", own.name)) && written(own.unit);
                assert!(written(&own.label()) || is_in_two, "{name}: {own:?}");
            }
        }
        assert!(texts(&svg).iter().any(|text| text.runs_up), "{name}");
    }
}

#[test]
fn every_axis_of_values_has_three_numbers_at_least() {
    let scale = |index: i32| 1.37f64.powi(index);
    let wave: Vec<f64> = signal(0.0).into_iter().take(600).collect();
    let of_levels = (-20..20).map(|index| {
        let wave: Vec<f64> = wave.iter().map(|value| scale(index) * value).collect();
        let svg = waveforms(&CAPTION, &[("one", &wave)], 5000.0).unwrap();
        ("waves of a level", svg)
    });
    let fronts = (-8..8).map(|index| ("front", front(true, |n| scale(index + n))));
    let live = (1..20).map(|index| ("live", waveform_axes(&CAPTION, scale(index)).unwrap()));
    for (name, svg) in pictures().into_iter().chain(of_levels).chain(fronts).chain(live) {
        let numbers = texts(&svg)
            .into_iter()
            .filter(|text| text.words.parse::<f64>().is_ok() && !text.runs_up);
        let places: Vec<(i32, i32)> = numbers
            .map(|text| {
                let figure::Frame {
                    left,
                    top,
                    right,
                    bottom,
                } = text.frame;
                (i32::midpoint(left, right), i32::midpoint(top, bottom))
            })
            .collect();
        let panels = svg.panels();
        let has_values = |panel: &&figure::Panel| panel.x.scale != figure::AxisScale::Names;
        for panel in panels.iter().filter(has_values) {
            let figure::Frame {
                left,
                top,
                right,
                bottom,
            } = panel.frame;
            // Of panels one below the other, only the lowest has numbers.
            let lowest = panels
                .iter()
                .filter(|other| other.frame.left == left)
                .map(|other| other.frame.bottom)
                .max()
                .unwrap();
            let along = places.iter().filter(|(x, y)| (left..=right).contains(x) && *y > lowest);
            let beside = places
                .iter()
                .filter(|(x, y)| (left - canvas::at(canvas::LEFT)..left).contains(x) && (top..=bottom).contains(y));
            let counts = [along.count(), beside.count()];
            assert!(counts.iter().all(|count| *count >= 3), "{name}: {counts:?}");
        }
    }
}

#[test]
fn the_legend_has_an_entry_for_each_curve_that_is_drawn_and_for_no_other() {
    let has = |svg: &Svg, name: &str| texts(svg).iter().any(|text| text.words == name);
    let half = front(true, |n| if n > 12 { 1.0 } else { f64::NAN });
    assert!(has(&half, "a structure, 5 bits") && !has(&half, "a structure, 1 bits"));
}

#[test]
fn no_colour_of_a_line_is_drawn_that_a_dark_screen_does_not_replace() {
    for (name, svg) in pictures() {
        for stroke in svg.as_str().split("stroke=\"#").skip(1) {
            let hex = &stroke[..6];
            let part = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
            let colour = RGBColor(part(0), part(2), part(4));
            let is_replaced = colours::dark_style().contains(&format!("[stroke='#{hex}']"));
            // Exempt: marks on the cells of a map.
            let is_on_cell = [colours::ON_PALE, RGBColor(255, 255, 255)].contains(&colour);
            assert!(is_replaced || is_on_cell, "{name}: #{hex}");
        }
    }
}

#[test]
fn pictures_of_anything_stay_small_and_within_their_frames_and_say_where_they_are_from() {
    for (name, svg) in pictures().into_iter().chain(odd_pictures()) {
        let text = svg.as_str();
        assert!(text.len() < 1_200_000, "{name}: {}", text.len());
        assert!(
            text.contains("SIMULATED") && text.trim_end().ends_with("</svg>"),
            "{name}"
        );
        let (opening, content) = text.split_once('\n').unwrap();
        let (_, size) = opening.split_once("viewBox=\"0 0 ").unwrap();
        let (width, height) = size.split_once(' ').unwrap();
        let height = height.split('"').next().unwrap();
        let within = |value: &str, most: &str| {
            let value: i64 = value.parse().unwrap_or_else(|_| panic!("{name}: {value}"));
            assert!((0..=most.parse().unwrap()).contains(&value), "{name}: {value}");
        };
        for element in content.split('<') {
            for attribute in element.split("=\"").collect::<Vec<_>>().windows(2) {
                let value = attribute[1].split('"').next().unwrap();
                match attribute[0].rsplit([' ', '"']).next().unwrap() {
                    "x" | "x1" | "x2" | "cx" => within(value, width),
                    "y" | "y1" | "y2" | "cy" => within(value, height),
                    "points" => {
                        for point in value.split_whitespace() {
                            let (x, y) = point.split_once(',').unwrap();
                            within(x, width);
                            within(y, height);
                        }
                    }
                    _ => {}
                }
            }
        }
    }
}
