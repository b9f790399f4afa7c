//! Computes a response from recorded periods.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::multisine::{Multisine, spectrum};
use super::{BANDS, PERIOD, STEP_HZ, band_edges_hz, db};
use crate::fourier::Complex;

/// Frequency range from which the direction of motion is determined, Hz. In this range accelerometers are flat and
/// hands are steady.
const DIRECTION_HZ: [f64; 2] = [40.0, 500.0];

/// Largest standard deviation of the level of a trusted line, dB.
const MOST_DEVIATION_DB: f64 = 0.5;

/// Width of a point of [`MeasuredResponse::points`], octaves.
const POINT_OCTAVES: f64 = 1.0 / 12.0;

/// Spectra of three axes over whole periods.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectra {
    /// Mean over the periods, per axis and bin, m/s².
    pub mean: [Vec<Complex<f64>>; 3],
    /// Variance of a single period about the mean, per axis and bin, (m/s²)².
    pub variance: [Vec<f64>; 3],
    /// Number of periods.
    pub periods: usize,
}

impl Spectra {
    /// Returns the spectra of the whole periods in the recordings of three axes.
    pub fn of(axes: &[Vec<f64>; 3]) -> Self {
        let periods = axes[0].len() / PERIOD;
        let of_axis = |axis: &Vec<f64>| -> (Vec<Complex<f64>>, Vec<f64>) {
            let all: Vec<_> = axis.chunks_exact(PERIOD).map(spectrum).collect();
            let count = all.len().max(1) as f64;
            (0..=PERIOD / 2)
                .map(|bin| {
                    let mean = all.iter().map(|one| one[bin]).sum::<Complex<f64>>() / count;
                    let squares: f64 = all.iter().map(|one| (one[bin] - mean).norm_sqr()).sum();
                    // With one period, the variance is 0 rather than undefined.
                    (mean, squares / (count - 1.0).max(1.0))
                })
                .unzip()
        };
        let [x, y, z] = [0, 1, 2].map(|axis| of_axis(&axes[axis]));
        Self {
            mean: [x.0, y.0, z.0],
            variance: [x.1, y.1, z.1],
            periods,
        }
    }

    /// Returns the mean amplitude of a bin along `axis` over the periods, and the variance of this mean.
    fn along(&self, axis: [f64; 3], bin: usize, bandwidths: &Bandwidths) -> (Complex<f64>, f64) {
        let (mut mean, mut variance) = (Complex::default(), 0.0);
        for (n, direction) in axis.into_iter().enumerate() {
            let passed = bandwidths.passed(n, bin as f64 * STEP_HZ);
            mean += self.mean[n][bin] / passed * direction;
            variance += self.variance[n][bin] * direction * direction / passed.norm_sqr();
        }
        (mean, variance / self.periods.max(1) as f64)
    }

    /// Returns the direction in which the lines move, as a unit vector whose largest component is positive, and the
    /// fraction of the motion's power across this direction. Returns `None` without motion above the noise.
    fn direction(&self, lines: &[usize], bandwidths: &Bandwidths) -> Option<([f64; 3], f64)> {
        let [low, high] = DIRECTION_HZ.map(|hz| (hz / STEP_HZ) as usize);
        let mut sum = Matrix3::zeros();
        for &bin in lines.iter().filter(|bin| (low..=high).contains(*bin)) {
            let hz = bin as f64 * STEP_HZ;
            let parts = [0, 1, 2].map(|n| self.mean[n][bin] / bandwidths.passed(n, hz));
            for (row, column) in (0..9).map(|n| (n / 3, n % 3)) {
                sum[(row, column)] += (parts[row] * parts[column].conj()).re;
                // The noise of the mean adds its variance to the diagonal and would turn the direction.
                if row == column {
                    sum[(row, row)] -= self.variance[row][bin] / self.periods.max(1) as f64;
                }
            }
        }
        let eigen = SymmetricEigen::new(sum);
        let largest = eigen.eigenvalues.imax();
        let total: f64 = eigen.eigenvalues.iter().map(|value: &f64| value.max(0.0)).sum();
        let along: Vector3<f64> = eigen.eigenvectors.column(largest).into();
        let sign = along[along.iamax()].signum();
        let across = 1.0 - eigen.eigenvalues[largest] / total;
        (eigen.eigenvalues[largest] > 0.0).then(|| ((along * sign).into(), across))
    }
}

/// Bandwidth of each axis of the accelerometer as a first-order low-pass, Hz; `None` if its roll-off is not corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bandwidths(pub [Option<f64>; 3]);

impl Bandwidths {
    /// Returns the response of the accelerometer's `axis` at `hz`, as a complex factor on the true acceleration.
    fn passed(&self, axis: usize, hz: f64) -> Complex<f64> {
        let one = Complex::new(1.0, 0.0);
        self.0[axis].map_or(one, |edge_hz| one / Complex::new(1.0, hz / edge_hz))
    }
}

/// The response at one frequency.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Line {
    /// Frequency, Hz.
    pub hz: f64,
    /// Complex response: acceleration of the tip per volt commanded at the pin, m/s² per V.
    #[serde(skip)]
    pub value: Complex<f64>,
    /// Level, dB re 1 m/s² per V.
    pub level_db: f64,
    /// Standard deviation of the level due to noise, dB.
    pub deviation_db: f64,
    /// Fraction of a period's power that is not noise.
    pub coherence: f64,
}

impl Line {
    /// Returns true if the noise is low enough for the line's level to be trusted.
    pub fn is_trusted(&self) -> bool {
        self.deviation_db < MOST_DEVIATION_DB
    }
}

/// The level in one third octave.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Band {
    /// Level, dB re 1 m/s² per V; 0 if the third octave has no line.
    pub level_db: f64,
    /// True if the third octave has lines, and all of them are trusted.
    pub trusted: bool,
}

/// A measured response.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MeasuredResponse {
    /// Lines of the response, ascending in frequency.
    pub lines: Vec<Line>,
    /// Direction of motion in the accelerometer's axes, as a unit vector whose largest component is positive.
    pub axis: [f64; 3],
    /// Fraction of the motion's power across that direction.
    pub across: f64,
    /// Distortion of even order: RMS of the even lines that were not played, relative to the RMS of the played lines.
    pub even: f64,
    /// Distortion of odd order, computed likewise from the odd lines that were not played.
    pub odd: f64,
    /// Power of the lines divided by the power of the noise in them: about 1 if nothing moves.
    pub over_noise: f64,
}

impl MeasuredResponse {
    /// Returns the response to `wave`, played with a peak of `volts`; `None` without motion above the noise.
    pub fn of(spectra: &Spectra, wave: &Multisine, volts: f64, bandwidths: &Bandwidths) -> Option<Self> {
        let (axis, across) = spectra.direction(&wave.lines, bandwidths)?;
        let asked = spectrum(&wave.samples);
        let (mut power, mut noise) = (0.0, 0.0);
        let lines = wave.lines.iter().map(|&bin| {
            let (value, variance) = spectra.along(axis, bin, bandwidths);
            power += value.norm_sqr() / wave.lines.len() as f64;
            noise += variance / wave.lines.len() as f64;
            let square = value.norm_sqr();
            let value = value / (asked[bin] * volts);
            let of_period = variance * spectra.periods as f64;
            Line {
                hz: bin as f64 * STEP_HZ,
                value,
                level_db: db(value.norm()),
                // Half of the noise power is along the line's phasor. One neper is 8.7 dB.
                deviation_db: db(std::f64::consts::E) * (0.5 * variance / square).sqrt(),
                coherence: (square / (square + of_period)).max(0.0),
            }
        });
        let lines: Vec<Line> = lines.collect();
        let left_out = |bins: &[usize]| {
            let powers = bins.iter().map(|&bin| {
                let (value, variance) = spectra.along(axis, bin, bandwidths);
                // Otherwise the noise would count as distortion.
                value.norm_sqr() - variance
            });
            (powers.sum::<f64>().max(0.0) / bins.len() as f64 / power).sqrt()
        };
        let last = wave.lines[wave.lines.len() - 1];
        let even: Vec<usize> = (wave.lines[0]..last)
            .step_by(2)
            .filter(|bin| !wave.lines.contains(bin))
            .collect();
        Some(Self {
            even: left_out(&even),
            odd: left_out(&wave.left_out),
            over_noise: power / noise,
            lines,
            axis,
            across,
        })
    }

    /// Returns the frequency, Hz, and the level, dB, of the trusted lines. They are averaged over a twelfth of an
    /// octave where lines are denser than that.
    pub fn points(&self) -> Vec<(f64, f64)> {
        let trusted: Vec<&Line> = self.lines.iter().filter(|line| line.is_trusted()).collect();
        let mut points = Vec::new();
        let mut rest = trusted.as_slice();
        while let Some(first) = rest.first() {
            let end = first.hz * POINT_OCTAVES.exp2();
            let (group, after) = rest.split_at(rest.partition_point(|line| line.hz < end).max(1));
            let mean = |value: fn(&Line) -> f64| group.iter().map(|line| value(line)).sum::<f64>() / group.len() as f64;
            points.push((mean(|line| line.hz.ln()).exp(), mean(|line| line.level_db)));
            rest = after;
        }
        points
    }

    /// Returns the levels in third-octave bands from 10 Hz to 1 kHz.
    pub fn bands(&self) -> [Band; BANDS] {
        std::array::from_fn(|band| {
            let [low, high] = band_edges_hz(band);
            let within = self.lines.iter().filter(|line| (low..high).contains(&line.hz));
            let (mut count, mut sum, mut trusted) = (0.0, 0.0, true);
            for line in within {
                count += 1.0;
                sum += line.value.norm_sqr();
                trusted &= line.is_trusted();
            }
            Band {
                level_db: if count > 0.0 { 10.0 * (sum / count).log10() } else { 0.0 },
                trusted: trusted && count > 0.0,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::noise;

    /// Spectra of `wave` played at 2 V through a gain of 3 along `axis`, with quadratic and cubic distortion and noise.
    fn recorded(wave: &Multisine, axis: [f64; 3], [square, cube]: [f64; 2], level: f64) -> Spectra {
        let axes = [0, 1, 2].map(|n| {
            let hiss = noise(n as u64, 8 * PERIOD);
            let sample = |(at, hiss): (usize, f64)| {
                let x = 2.0 * wave.samples[at % PERIOD];
                axis[n] * 3.0 * (x + square * x * x + cube * x * x * x) + level * hiss
            };
            hiss.into_iter().enumerate().map(sample).collect()
        });
        Spectra::of(&axes)
    }

    #[test]
    fn gain_direction_confidence_and_distortion_are_those_of_what_moved() {
        let wave = Multisine::new(3, |_| 1.0);
        let axis = [0.36, -0.8, 0.48];
        let measured = |spectra: &Spectra| MeasuredResponse::of(spectra, &wave, 2.0, &Bandwidths::default());
        let found = measured(&recorded(&wave, axis, [0.0; 2], 0.05)).unwrap();
        for (found, true_part) in found.axis.into_iter().zip(axis) {
            assert!((found + true_part).abs() < 2e-3, "the largest part is positive");
        }
        let off = |line: &Line| (line.level_db - db(3.0)) / line.deviation_db;
        let squares: f64 = found.lines.iter().map(|line| off(line).powi(2)).sum();
        let scatter = (squares / found.lines.len() as f64).sqrt();
        assert!(
            (0.8..1.25).contains(&scatter),
            "deviations are what they say: {scatter}"
        );
        assert!(found.lines.iter().all(|line| line.value.re < 0.0 && line.is_trusted()));
        assert!(found.even < 0.02 && found.odd < 0.02 && found.across < 1e-3);
        assert!(
            found
                .bands()
                .iter()
                .all(|band| (band.level_db - db(3.0)).abs() < 0.2 && band.trusted)
        );
        let of = |distortion| measured(&recorded(&wave, axis, distortion, 0.0)).unwrap();
        let (even, odd) = (of([0.1, 0.0]), of([0.0, 0.1]));
        // The few even lines that are played spread a little power of each order of distortion into the other order's
        // lines.
        assert!(
            even.even > 0.03 && even.even > 2.0 * even.odd,
            "{} {}",
            even.even,
            even.odd
        );
        assert!(odd.odd > 0.03 && odd.odd > 2.0 * odd.even, "{} {}", odd.even, odd.odd);
        let mut still = recorded(&wave, [0.0; 3], [0.0; 2], 1.0);
        still.mean.iter_mut().flatten().for_each(|bin| *bin *= 0.5);
        assert!(measured(&still).is_none());
    }
}
