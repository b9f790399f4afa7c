//! Reduction of three axes to one.
//!
//! One axis is enough to play a texture, because hands do not perceive the direction of high-frequency vibrations.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::fourier::{self, Complex};
use crate::sums::{dot, energy, mean};

/// A method of reduction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Reduction {
    /// Projection on the first principal component, as in the paper.
    Pca,
    /// DFT321 (Landin, Romano, McMahan, Kuchenbecker, EuroHaptics 2010): at each frequency the power is the sum of the
    /// axes' powers, and the phase is that of the axes' sum. Keeps all of the energy.
    Dft321,
    /// The first channel alone.
    X,
    /// The second channel alone.
    Y,
    /// The third channel alone.
    Z,
}

/// A signal of one axis, with the fraction of the energy that it kept.
#[derive(Clone, Debug)]
pub struct Reduced {
    /// Signal with a mean of zero, m/s².
    pub signal: Vec<f64>,
    /// Energy as a fraction of the energy of all axes about their means; 1 if the axes have no energy.
    pub energy_share: f64,
    /// Direction on which several axes were projected, one component per axis; empty for other reductions.
    pub direction: Vec<f64>,
}

/// The requested axis does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("axis {wanted} does not exist: the recording has {channels} in all; reduce it by pca or dft321")]
pub struct NoSuchAxis {
    /// Number of the requested axis, from 1.
    pub wanted: usize,
    /// Number of channels.
    pub channels: usize,
}

/// Reduces `axes`, one to three signals of equal length in m/s², to one signal. Removes the mean of each axis in place.
pub fn reduce(axes: &mut [Vec<f64>], by: Reduction) -> Result<Reduced, NoSuchAxis> {
    for axis in axes.iter_mut() {
        remove_mean(axis);
    }
    let total: f64 = axes.iter().map(|axis| energy(axis)).sum();
    let direction = match by {
        Reduction::Pca if axes.len() > 1 => weights(axes),
        _ => Vec::new(),
    };
    let mut signal = match by {
        Reduction::Pca if axes.len() > 1 => projected(axes, &direction),
        Reduction::Pca => axes.first().cloned().unwrap_or_default(),
        Reduction::Dft321 => dft321(axes),
        Reduction::X => single(axes, 0)?,
        Reduction::Y => single(axes, 1)?,
        Reduction::Z => single(axes, 2)?,
    };
    remove_mean(&mut signal);
    let energy_share = if total > 0.0 {
        // Round-off may make the projection stronger than all axes.
        (energy(&signal) / total).min(1.0)
    } else {
        1.0
    };
    Ok(Reduced {
        signal,
        energy_share,
        direction,
    })
}

/// The way in which a recording was reduced, so that other recordings of the same sensor can be reduced alike.
#[derive(Clone, Debug)]
pub struct View {
    by: Reduction,
    /// Number of axes of the recording.
    channels: usize,
    /// Principal direction of the recording; empty for other reductions than the projection on this direction.
    direction: Vec<f64>,
}

impl View {
    /// Creates the view of a recording whose `axes`, about their means, are reduced by the method `by`.
    pub fn of(axes: &[Vec<f64>], by: Reduction) -> Self {
        let direction = match by {
            Reduction::Pca => weights(axes),
            _ => Vec::new(),
        };
        Self {
            by,
            channels: axes.len(),
            direction,
        }
    }

    /// Number of the recording's axes.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Reduces `axes`, as many as the recording has and about their means, in the same way.
    pub fn reduce(&self, axes: &[Vec<f64>]) -> Result<Vec<f64>, NoSuchAxis> {
        match self.by {
            Reduction::Pca => Ok(projected(axes, &self.direction)),
            by => Ok(reduce(&mut axes.to_vec(), by)?.signal),
        }
    }
}

fn single(axes: &[Vec<f64>], index: usize) -> Result<Vec<f64>, NoSuchAxis> {
    let missing = NoSuchAxis {
        wanted: index + 1,
        channels: axes.len(),
    };
    axes.get(index).cloned().ok_or(missing)
}

/// Subtracts the mean. A constant becomes exactly zero.
pub fn remove_mean(signal: &mut [f64]) {
    let mean = mean(signal);
    for sample in signal {
        *sample -= mean;
    }
}

/// Components of the principal direction, one per axis.
fn weights(axes: &[Vec<f64>]) -> Vec<f64> {
    principal_direction(axes).iter().copied().take(axes.len()).collect()
}

fn projected(axes: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    let mut signal = vec![0.0; axes.first().map_or(0, Vec::len)];
    for (axis, weight) in axes.iter().zip(weights) {
        for (sum, sample) in signal.iter_mut().zip(axis) {
            *sum += weight * sample;
        }
    }
    signal
}

/// Returns the angle between the principal axes of two recordings, degrees, from 0 to 90. Both have the same axes,
/// about their means.
pub fn angle_deg(one: &[Vec<f64>], other: &[Vec<f64>]) -> f64 {
    principal_direction(one)
        .dot(&principal_direction(other))
        .abs()
        .min(1.0)
        .acos()
        .to_degrees()
}

/// Returns the unit vector in the direction of the greatest variance. Its largest component is positive, so that the
/// sign does not depend on the eigenvalue solver.
fn principal_direction(axes: &[Vec<f64>]) -> Vector3<f64> {
    let mut covariance = Matrix3::zeros();
    for (row, a) in axes.iter().enumerate() {
        for (column, b) in axes.iter().enumerate().skip(row) {
            let sum = dot(a, b);
            covariance[(row, column)] = sum;
            covariance[(column, row)] = sum;
        }
    }
    let eigen = covariance.symmetric_eigen();
    let direction: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
    let largest = direction[direction.iamax()];
    if largest < 0.0 { -direction } else { direction }
}

fn dft321(axes: &[Vec<f64>]) -> Vec<f64> {
    let length = axes.first().map_or(0, Vec::len);
    if length == 0 {
        return Vec::new();
    }
    let mut power = vec![0.0; length / 2 + 1];
    let mut sum = vec![Complex::new(0.0, 0.0); length / 2 + 1];
    for axis in axes {
        let spectrum = fourier::forward(&mut axis.clone());
        for ((power, sum), bin) in power.iter_mut().zip(&mut sum).zip(spectrum) {
            *power += bin.norm_sqr();
            *sum += bin;
        }
    }
    for (bin, power) in sum.iter_mut().zip(power) {
        // A sum of zero has no phase; a phase of 0 then keeps the energy.
        let magnitude = bin.norm();
        *bin = if magnitude > 0.0 {
            *bin * (power.sqrt() / magnitude)
        } else {
            Complex::new(power.sqrt(), 0.0)
        };
    }
    let mut signal = fourier::inverse(&mut sum, length);
    for sample in &mut signal {
        *sample /= length as f64;
    }
    signal
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::{near, noise};

    fn centred_energy(axes: &[Vec<f64>]) -> f64 {
        let mut axes = axes.to_vec();
        axes.iter_mut().for_each(|axis| remove_mean(axis));
        axes.iter().map(|axis| energy(axis)).sum()
    }

    proptest! {
        #[test]
        fn dft321_keeps_all_energy(seed: u64, length in 2usize..600, channels in 1usize..=3) {
            let mut axes: Vec<_> = (0..channels as u64).map(|c| noise(seed ^ c, length)).collect();
            let before = centred_energy(&axes);
            let reduced = reduce(&mut axes, Reduction::Dft321).unwrap();
            prop_assert!((energy(&reduced.signal) / before - 1.0).abs() < 1e-9);
            prop_assert!((reduced.energy_share - 1.0).abs() < 1e-9);
        }

        #[test]
        fn pca_keeps_at_least_any_single_axis_and_at_most_all(seed: u64, gain in 0.0..4.0) {
            let mut axes: Vec<_> = (0..3).map(|c| noise(seed ^ c, 200)).collect();
            axes[1].iter_mut().for_each(|x| *x *= gain);
            let total = centred_energy(&axes);
            let largest = axes.iter().map(|a| centred_energy(std::slice::from_ref(a))).fold(0.0, f64::max);
            let reduced = reduce(&mut axes, Reduction::Pca).unwrap();
            prop_assert!(energy(&reduced.signal) >= largest * (1.0 - 1e-9));
            prop_assert!(energy(&reduced.signal) <= total * (1.0 + 1e-9));
        }
    }

    #[test]
    fn pca_finds_the_direction_of_motion_on_a_line() {
        let base = noise(3, 500);
        let scaled = |gain: f64| base.iter().map(|x| gain * x + 7.0).collect::<Vec<_>>();
        let mut axes = vec![scaled(1.0), scaled(-2.0), scaled(2.0)];
        let reduced = reduce(&mut axes, Reduction::Pca).unwrap();
        near(reduced.energy_share, 1.0, 1e-12);
        let expected = centred_energy(&[base]) * 9.0;
        near(energy(&reduced.signal) / expected, 1.0, 1e-9);
    }

    /// A magnitude without its phase would make the signal one-sided. The sum of opposite axes is zero, so it has no
    /// phase.
    #[test]
    fn dft321_of_opposite_axes_is_neither_rectified_nor_lost() {
        let x = noise(5, 1000);
        let mut axes = vec![x.clone(), x.iter().map(|v| -v).collect()];
        let reduced = reduce(&mut axes, Reduction::Dft321).unwrap();
        near(energy(&reduced.signal) / (2.0 * centred_energy(&[x])), 1.0, 1e-9);
        assert!(reduced.signal.iter().any(|&v| v < 0.0) && reduced.signal.iter().any(|&v| v > 0.0));
        let mut same = vec![noise(6, 1000); 3];
        let alone = same[0].clone();
        let tripled = reduce(&mut same, Reduction::Dft321).unwrap().signal;
        let mut expected = alone;
        remove_mean(&mut expected);
        for (got, want) in tripled.iter().zip(expected) {
            near(*got, want * 3f64.sqrt(), 1e-9);
        }
    }

    #[test]
    fn an_axis_that_is_not_there_is_said() {
        let failure = reduce(&mut [vec![1.0, 2.0]], Reduction::Z).unwrap_err();
        assert_eq!(failure, NoSuchAxis { wanted: 3, channels: 1 });
    }

    #[test]
    fn nothing_is_left_of_a_constant() {
        for by in [Reduction::Pca, Reduction::Dft321, Reduction::X] {
            let reduced = reduce(&mut [vec![0.1; 1001]], by).unwrap();
            assert!(reduced.signal.iter().all(|&x| x.abs() <= 0.0), "{by:?}");
        }
    }
}
