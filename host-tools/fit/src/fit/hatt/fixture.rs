//! Invented model files in `HaTT`'s format, and their spectra in closed form.
//!
//! The models are defined by their line spectral frequencies, and the coefficients are computed by multiplying out.
//! Nothing here uses the code under test.

#![allow(dead_code, reason = "each test uses a part of it")]

use std::f64::consts::{PI, TAU};

/// Positions of [`whole`], mm/s and N, with the variance of each: three silent corners, one corner that is not silent,
/// and two models within.
pub const PLACES: [(f64, f64, f64); 6] = [
    (0.0, 0.0, 0.0),
    (200.0, 0.0, 0.0),
    (0.0, 2.0, 0.0),
    (200.0, 2.0, 0.02),
    (60.0, 0.5, 0.004),
    (140.0, 1.3, 0.01),
];

/// Triangles of [`whole`], from 1. They cover all speeds up to 200 mm/s and forces up to 2 N.
pub const TRIANGLES: [[usize; 3]; 6] = [[1, 2, 5], [2, 6, 5], [2, 4, 6], [3, 5, 6], [3, 6, 4], [1, 5, 3]];

/// Returns a file of [`PLACES`] and [`TRIANGLES`].
pub fn whole() -> String {
    file(&PLACES, &TRIANGLES)
}

/// Returns a file of `count` models, all with different speeds and forces, in a band of triangles.
pub fn scattered(count: usize) -> String {
    let places: Vec<(f64, f64, f64)> = (1..=count)
        .map(|i| {
            let aside = if i % 2 == 0 { 0.3 } else { 0.0 };
            (4.0 * i as f64, 0.05 * i as f64 + aside, 0.01)
        })
        .collect();
    let triangles: Vec<[usize; 3]> = (1..count - 1).map(|i| [i, i + 1, i + 2]).collect();
    file(&places, &triangles)
}

/// Returns the line spectral frequencies of A and B of the model at a speed, rad. Silent models at rest have those of
/// 60 mm/s.
pub fn lines(speed: f64) -> [Vec<f64>; 2] {
    let moved = if speed <= 0.0 { 60.0 } else { speed } / 1000.0;
    let own = |lines: &[f64]| lines.iter().map(|line| line + moved * (PI - line)).collect();
    [own(&[0.25, 0.4, 1.1, 1.5]), own(&[0.5, 1.9])]
}

/// Returns the gain of the model at a speed.
pub fn gain(speed: f64) -> f64 {
    4.0 + if speed <= 0.0 { 60.0 } else { speed } / 100.0
}

/// Returns the one-sided density, (m/s²)²/Hz, of a mean of models, given as indices of [`PLACES`] with weights that add
/// up to one.
///
/// |A|² = 2ⁿ (cos² ω/2 Π (cos ω - cos l)² + sin² ω/2 Π (cos ω - cos l)²) for an even order n. The first product is over
/// the first, third ... line spectral frequency l, the second over the others.
pub fn density(models: &[(usize, f64)], frequency_hz: f64) -> f64 {
    let mean = |of: &dyn Fn((f64, f64, f64)) -> f64| models.iter().map(|&(i, w)| w * of(PLACES[i])).sum::<f64>();
    let omega = TAU * frequency_hz / 1000.0;
    let power = |half: usize| {
        let order = lines(0.0)[half].len();
        let mut products = [(omega / 2.0).cos().powi(2), (omega / 2.0).sin().powi(2)];
        for index in 0..order {
            let line = mean(&|place| lines(place.0)[half][index]);
            products[index % 2] *= (omega.cos() - line.cos()).powi(2);
        }
        2f64.powi(order as i32) * (products[0] + products[1])
    };
    let (variance, gain) = (mean(&|place| place.2), mean(&|place| gain(place.0)));
    2.0 / 1000.0 * variance * gain * gain * power(1) / power(0)
}

/// Returns the coefficients, including the leading one, of a filter with an even number of line spectral frequencies.
pub fn coefficients(lines: &[f64]) -> Vec<f64> {
    let times = |a: &[f64], b: &[f64]| {
        let mut product = vec![0.0; a.len() + b.len() - 1];
        for (i, x) in a.iter().enumerate() {
            for (j, y) in b.iter().enumerate() {
                product[i + j] += x * y;
            }
        }
        product
    };
    let mut halves = [vec![1.0, 1.0], vec![1.0, -1.0]];
    for (index, line) in lines.iter().enumerate() {
        halves[index % 2] = times(&halves[index % 2], &[1.0, -2.0 * line.cos(), 1.0]);
    }
    let mean = halves[0].iter().zip(&halves[1]).map(|(a, b)| 0.5 * (a + b));
    mean.take(lines.len() + 1).collect()
}

fn list(values: &[f64]) -> String {
    let elements: Vec<String> = values
        .iter()
        .map(|value| format!("<value>{value:.9}</value>\n"))
        .collect();
    elements.concat()
}

/// Returns a file of models at `places` (mm/s, N, variance) with `triangles` over them, counted from 1.
pub fn file(places: &[(f64, f64, f64)], triangles: &[[usize; 3]]) -> String {
    let column = |of: fn(&(f64, f64, f64)) -> f64| places.iter().map(of).collect::<Vec<f64>>();
    let (speeds, forces) = (column(|p| p.0), column(|p| p.1));
    let highest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<modelSet texture=\"7\">\n<material>Felt</material>\n\
         <AccelUnits>m/s^2</AccelUnits>\n<SpeedUnits>mm/s</SpeedUnits>\n<ForceUnits>N</ForceUnits>\n\
         <SampleRate>1000</SampleRate>\n<mu>0.3</mu>\n<numMod>{}</numMod>\n<numTri>{}</numTri>\n\
         <maxSpeed>{}</maxSpeed>\n<maxForce>{}</maxForce>\n<speedList type=\"array\">{}</speedList>\n\
         <forceList type=\"array\">{}</forceList>\n",
        places.len(),
        triangles.len(),
        highest(&speeds),
        highest(&forces),
        list(&speeds),
        list(&forces),
    );
    for [a, b, c] in triangles {
        text.push_str(&format!(
            "<tri type=\"array\">\n<value>{a}</value>\n<value>{b}</value>\n<value>{c}</value>\n</tri>\n"
        ));
    }
    text.push_str("<numARCoeff>4</numARCoeff>\n<numMACoeff>2</numMACoeff>\n");
    for (index, &(speed, force, variance)) in places.iter().enumerate() {
        let [poles, zeros] = lines(speed);
        text.push_str(&format!(
            "<model>\n<modNum>{}</modNum>\n<ARcoeff>{}</ARcoeff>\n<ARlsf>{}</ARlsf>\n<MAcoeff>{}</MAcoeff>\n\
             <MAlsf>{}</MAlsf>\n<var>{variance}</var>\n<gain>{}</gain>\n<speedMod>{speed}</speedMod>\n\
             <forceMod>{force}</forceMod>\n</model>\n",
            index + 1,
            list(&coefficients(&poles)),
            list(&poles),
            list(&coefficients(&zeros)),
            list(&zeros),
            gain(speed),
        ));
    }
    text + "</modelSet>\n"
}
