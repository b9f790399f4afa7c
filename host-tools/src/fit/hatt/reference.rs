//! The definition of a file, a second time: read, interpolated and turned into spectra by code that shares nothing with
//! the conversion, so that it can judge it.
//!
//! The definition is HaTT's own renderer's. At a speed and a force it takes the triangle around them, the barycentric
//! means of the corners' line spectral frequencies, variance and gain, and multiplies out the filters. It plays white
//! noise of the variance through gain · B/A at the file's rate. Speeds and forces above the highest count as the
//! highest.

use std::f64::consts::TAU;

use roxmltree::{Document, Node};

/// A file's models, as its definition has them.
#[derive(Clone, Debug)]
pub struct Reference {
    rate_hz: f64,
    highest: (f64, f64),
    corners: Vec<Corner>,
    triangles: Vec<[usize; 3]>,
}

/// A model.
#[derive(Clone, Debug)]
struct Corner {
    place: (f64, f64),
    variance: f64,
    gain: f64,
    /// Line spectral frequencies of A and B; none of a silent model without a shape.
    shape: Option<[Vec<f64>; 2]>,
}

impl Reference {
    /// Reads a file without the models whose indices are `left_out`, and without their triangles. Gives nothing if the
    /// file is not one that [`super::read::read`] accepts.
    pub fn of(text: &str, left_out: &[usize]) -> Option<Self> {
        let document = Document::parse(text).ok()?;
        let root = document.root_element();
        let number = |name: &'static str| values(&named(root, name).next()?)?.first().copied();
        let places = |name: &'static str| named(root, name).next().and_then(|list| values(&list));
        let (speeds, forces) = (places("speedList"), places("forceList"));
        let is_model = |node: &Node<'_, '_>| {
            direct(*node, "ARcoeff").is_some() || direct(*node, "ARlsf").is_some()
        };
        let mut corners = Vec::new();
        // Index of each model among those that are used.
        let mut used = Vec::new();
        for (index, model) in root.descendants().filter(is_model).enumerate() {
            if left_out.contains(&index) {
                used.push(None);
                continue;
            }
            let listed =
                |list: &Option<Vec<f64>>| list.as_ref().and_then(|list| list.get(index).copied());
            used.push(Some(corners.len()));
            corners.push(corner(model, listed(&speeds), listed(&forces))?);
        }
        let sizes = |corner: &Corner| {
            corner
                .shape
                .as_ref()
                .map(|shape| [shape[0].len(), shape[1].len()])
        };
        let common = corners
            .iter()
            .find(|corner| corner.variance > 0.0)
            .and_then(sizes);
        for corner in corners.iter_mut().filter(|corner| corner.variance <= 0.0) {
            // HaTT interpolates equal numbers only, so that other silent models have no shape to give.
            corner.shape = corner
                .shape
                .take()
                .filter(|shape| Some([shape[0].len(), shape[1].len()]) == common);
        }
        let mut indices = Vec::new();
        for triangle in named(root, "tri") {
            indices.extend(values(&triangle)?);
        }
        let base = if indices.contains(&0.0) { 0.0 } else { 1.0 };
        let mut triangles = Vec::new();
        for three in indices.chunks_exact(3) {
            let [a, b, c] = [three[0], three[1], three[2]]
                .map(|index| used.get((index - base) as usize).copied());
            if let (Some(a), Some(b), Some(c)) = (a?, b?, c?) {
                triangles.push([a, b, c]);
            }
        }
        let top = |of: fn(&Corner) -> f64| corners.iter().map(of).fold(0.0, f64::max);
        Some(Self {
            rate_hz: number("SampleRate").unwrap_or(1000.0),
            highest: (
                number("maxSpeed").unwrap_or_else(|| top(|c| c.place.0)),
                number("maxForce").unwrap_or_else(|| top(|c| c.place.1)),
            ),
            corners,
            triangles,
        })
    }

    /// Half the file's sample rate, Hz.
    pub fn nyquist_hz(&self) -> f64 {
        0.5 * self.rate_hz
    }

    /// Speeds, mm/s, and forces, N, of all models, those of silent ones included.
    pub fn model_places(&self) -> impl Iterator<Item = (f64, f64)> {
        self.corners.iter().map(|corner| corner.place)
    }

    /// Places in all triangles, with these barycentric weights of their corners.
    pub fn inside_triangles(&self, weights: [f64; 3]) -> impl Iterator<Item = (f64, f64)> {
        self.triangles.iter().map(move |triangle| {
            let sum = |of: fn(&Corner) -> f64| -> f64 {
                triangle
                    .iter()
                    .zip(weights)
                    .map(|(&corner, weight)| weight * of(&self.corners[corner]))
                    .sum()
            };
            (sum(|c| c.place.0), sum(|c| c.place.1))
        })
    }

    /// Returns the density on one side of the spectrum, (m/s²)²/Hz, at these frequencies, at most half the file's rate.
    /// Gives nothing outside of all triangles and where the file is silent.
    pub fn density(&self, place: (f64, f64), frequencies_hz: &[f64]) -> Option<Vec<f64>> {
        let place = (place.0.min(self.highest.0), place.1.min(self.highest.1));
        let (triangle, weights) = self.around(place)?;
        let corner = |k: usize| &self.corners[triangle[k]];
        let mean =
            |of: &dyn Fn(&Corner) -> f64| (0..3).map(|k| weights[k] * of(corner(k))).sum::<f64>();
        let shaped: f64 = mean(&|c| f64::from(u8::from(c.shape.is_some())));
        let variance = mean(&|c| c.variance);
        let gain = mean(&|c| if c.shape.is_some() { c.gain } else { 0.0 }) / shaped;
        // Edges of silence are not silent by more than the weights' rounding.
        let power = variance * gain * gain;
        if power.is_nan() || power <= 1e-15 {
            return None;
        }
        let polynomials = [0, 1].map(|half| {
            let count = (0..3)
                .filter_map(|k| corner(k).shape.as_ref())
                .map(|shape| shape[half].len())
                .max();
            let lines: Vec<f64> = (0..count.unwrap_or(0))
                .map(|i| {
                    mean(&|c| {
                        c.shape
                            .as_ref()
                            .map_or(0.0, |shape| shape[half].get(i).copied().unwrap_or(0.0))
                    })
                })
                .map(|sum| sum / shaped)
                .collect();
            multiplied_out(&lines)
        });
        let density = |&frequency_hz: &f64| {
            let omega = TAU * frequency_hz / self.rate_hz;
            let [poles, zeros] = [&polynomials[0], &polynomials[1]].map(|p| power_at(p, omega));
            2.0 / self.rate_hz * variance * gain * gain * zeros / poles
        };
        Some(frequencies_hz.iter().map(density).collect())
    }

    /// The triangle around a place, and the weights of its corners.
    fn around(&self, (speed, force): (f64, f64)) -> Option<([usize; 3], [f64; 3])> {
        let mut best: Option<([usize; 3], [f64; 3], f64)> = None;
        for &triangle in &self.triangles {
            // Areas of the triangles that the place makes with two corners each, as shares of the whole.
            let [a, b, c] = triangle.map(|corner| self.corners[corner].place);
            let twice = |p: (f64, f64), q: (f64, f64), r: (f64, f64)| {
                p.0 * (q.1 - r.1) + q.0 * (r.1 - p.1) + r.0 * (p.1 - q.1)
            };
            let (place, whole) = ((speed, force), twice(a, b, c));
            if whole == 0.0 {
                continue;
            }
            let weights = [twice(place, b, c), twice(a, place, c), twice(a, b, place)]
                .map(|area| area / whole);
            let least = weights.iter().copied().fold(f64::INFINITY, f64::min);
            if best.as_ref().is_none_or(|best| least > best.2) {
                best = Some((triangle, weights, least));
            }
        }
        // Values of axes have 24 binary digits.
        best.filter(|best| best.2 > -1e-5)
            .map(|(triangle, weights, _)| (triangle, weights))
    }
}

/// Elements of that name, in any case of letters.
fn named<'a, 'b: 'a>(root: Node<'a, 'b>, name: &'static str) -> impl Iterator<Item = Node<'a, 'b>> {
    root.descendants()
        .filter(move |node| node.tag_name().name().eq_ignore_ascii_case(name))
}

fn direct<'a, 'b>(node: Node<'a, 'b>, name: &str) -> Option<Node<'a, 'b>> {
    node.children()
        .find(|inner| inner.tag_name().name().eq_ignore_ascii_case(name))
}

/// All numbers in an element.
fn values(node: &Node<'_, '_>) -> Option<Vec<f64>> {
    let text: Vec<&str> = node
        .descendants()
        .filter(Node::is_text)
        .filter_map(|n| n.text())
        .collect();
    let text = text.join(" ").replace([',', ';'], " ");
    text.split_whitespace()
        .map(|word| word.parse().ok())
        .collect()
}

fn corner(model: Node<'_, '_>, speed: Option<f64>, force: Option<f64>) -> Option<Corner> {
    let list = |name: &str| direct(model, name).map_or(Some(Vec::new()), |node| values(&node));
    let number = |name: &str| list(name)?.first().copied();
    let variance = number("var")?;
    let halves = [("ARcoeff", "ARlsf"), ("MAcoeff", "MAlsf")];
    let mut lead = 1.0;
    let mut shape = [Vec::new(), Vec::new()];
    for (half, (coefficients, lines)) in shape.iter_mut().zip(halves) {
        let (coefficients, lines) = (list(coefficients)?, list(lines)?);
        let has_lead = coefficients.len() != lines.len();
        if has_lead && let Some(&first) = coefficients.first() {
            lead = first;
        }
        *half = if lines.is_empty() && !coefficients.is_empty() {
            line_frequencies(&coefficients)?
        } else {
            lines
        };
    }
    let is_empty = shape.iter().all(Vec::is_empty);
    Some(Corner {
        place: (number("speedMod").or(speed)?, number("forceMod").or(force)?),
        variance,
        gain: number("gain").unwrap_or(1.0) * lead.abs(),
        shape: (!is_empty || variance > 0.0).then_some(shape),
    })
}

/// Line spectral frequencies of coefficients with their leading one, found as changes of sign.
///
/// On the unit circle e^(jω(n+1)/2) A is real where Q is zero, and imaginary where P is (Itakura 1975).
fn line_frequencies(coefficients: &[f64]) -> Option<Vec<f64>> {
    const STEPS: usize = 20_000;
    let half = 0.5 * coefficients.len() as f64;
    let parts = |omega: f64| {
        let terms = coefficients
            .iter()
            .enumerate()
            .map(|(lag, c)| (c, omega * (half - lag as f64)));
        terms.fold((0.0, 0.0), |sum: (f64, f64), (c, angle)| {
            (sum.0 + c * angle.cos(), sum.1 + c * angle.sin())
        })
    };
    let mut found = Vec::new();
    for part in [|p: (f64, f64)| p.0, |p: (f64, f64)| p.1] {
        for step in 0..STEPS {
            let angle = |step: usize| 0.5 * TAU * (step as f64 + 0.5) / (STEPS + 1) as f64;
            let [mut low, mut high] = [step, step + 1].map(angle);
            let sign = part(parts(low)) > 0.0;
            if sign == (part(parts(high)) > 0.0) {
                continue;
            }
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                if (part(parts(middle)) > 0.0) == sign {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            found.push(low);
        }
    }
    found.sort_by(f64::total_cmp);
    (found.len() + 1 == coefficients.len()).then_some(found)
}

/// The polynomial, from the power 0 of z⁻¹ up, whose line spectral frequencies are `lines`: the mean of a sum and a
/// difference filter, whose zeros they are in turn.
fn multiplied_out(lines: &[f64]) -> Vec<f64> {
    let mut halves = [vec![1.0], vec![1.0]];
    for (index, line) in lines.iter().enumerate() {
        let half = &mut halves[index % 2];
        *half = product(half, &[1.0, -2.0 * line.cos(), 1.0]);
    }
    let ends: [&[f64]; 2] = if lines.len().is_multiple_of(2) {
        [&[1.0, 1.0], &[1.0, -1.0]]
    } else {
        [&[1.0], &[1.0, 0.0, -1.0]]
    };
    let [sum, difference] = [product(&halves[0], ends[0]), product(&halves[1], ends[1])];
    let mut mean: Vec<f64> = sum
        .iter()
        .zip(&difference)
        .map(|(a, b)| 0.5 * (a + b))
        .collect();
    mean.truncate(lines.len() + 1);
    mean
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut result = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            result[i + j] += x * y;
        }
    }
    result
}

/// |p(e^(-jω))|².
fn power_at(polynomial: &[f64], omega: f64) -> f64 {
    let (cos, sin) = (omega.cos(), omega.sin());
    let (mut re, mut im) = (0.0, 0.0);
    for coefficient in polynomial.iter().rev() {
        (re, im) = (re * cos + im * sin + coefficient, im * cos - re * sin);
    }
    re * re + im * im
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn densities_are_those_in_closed_form_at_models_and_between_them() {
        let reference = Reference::of(&fixture::whole(), &[]).unwrap();
        let frequencies_hz = [0.0, 40.0, 133.0, 250.0, 499.0];
        for models in [
            vec![(4, 1.0)],
            vec![(3, 1.0)],
            vec![(1, 0.2), (3, 0.3), (5, 0.5)],
            vec![(0, 0.6), (4, 0.4)],
        ] {
            let sum = |of: fn((f64, f64, f64)) -> f64| -> f64 {
                models
                    .iter()
                    .map(|&(i, w)| w * of(fixture::PLACES[i]))
                    .sum()
            };
            let density = reference
                .density((sum(|p| p.0), sum(|p| p.1)), &frequencies_hz)
                .unwrap();
            for (got, frequency_hz) in density.iter().zip(frequencies_hz) {
                let wanted = fixture::density(&models, frequency_hz);
                assert!(
                    (got / wanted - 1.0).abs() < 1e-6,
                    "{models:?} {frequency_hz}: {got} {wanted}"
                );
            }
        }
    }

    #[test]
    fn silence_has_no_density_and_the_highest_speed_counts_above_it() {
        let reference = Reference::of(&fixture::whole(), &[]).unwrap();
        assert!(reference.density((0.0, 1.0), &[100.0]).is_none());
        assert!(reference.density((50.0, 0.0), &[100.0]).is_none());
        assert_eq!(
            reference.density((900.0, 9.0), &[100.0]),
            reference.density((200.0, 2.0), &[100.0])
        );
    }
}
