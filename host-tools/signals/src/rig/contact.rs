//! Hertz contact of a spherical tip with a surface.

use std::f64::consts::TAU;

use stylus_dsp::fourier::Complex;

use super::Mode;

/// A tip pressed on a surface by a static force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    radius_mm: f64,
    stiffness_n_per_um: f64,
}

impl Contact {
    /// Returns the contact of a tip of `tip_radius_mm` on a surface of effective modulus `effective_modulus_mpa`,
    /// pressed by `force_n`; `None` if the force is not above zero.
    ///
    /// a = (3FR / 4E*)^{1/3}, k = 2E*a (Johnson 1985, eq. 4.22 and the derivative of 4.23).
    pub fn hertz(tip_radius_mm: f64, effective_modulus_mpa: f64, force_n: f64) -> Option<Self> {
        (force_n > 0.0).then(|| {
            // 1 MPa is 1 N/mm².
            let radius_mm = (0.75 * force_n * tip_radius_mm / effective_modulus_mpa).cbrt();
            let stiffness_n_per_mm = 2.0 * effective_modulus_mpa * radius_mm;
            Self {
                radius_mm,
                stiffness_n_per_um: stiffness_n_per_mm * 1e-3,
            }
        })
    }

    /// Radius of the circle of contact, mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Normal stiffness, N/µm.
    pub fn stiffness_n_per_um(&self) -> f64 {
        self.stiffness_n_per_um
    }

    /// Returns the gain from a profile of `wavenumber_rad_per_mm` to the mean height under the contact, weighted by the
    /// pressure: 3(sin u - u cos u)/u³. The Hertz pressure, integrated across the track, is a parabola along the track;
    /// this is its Fourier transform. The gain is 1 for long waves and within ±3/u² for short ones.
    pub fn patch_response(&self, wavenumber_rad_per_mm: f64) -> f64 {
        let u = wavenumber_rad_per_mm * self.radius_mm;
        if u < 0.05 {
            // The quotient suffers from cancellation here. The next term of the series is u⁶/15120 < 2e-12.
            let square = u * u;
            return 1.0 - square / 10.0 + square * square / 280.0;
        }
        let (sine, cosine) = u.sin_cos();
        3.0 * (sine - u * cosine) / (u * u * u)
    }
}

/// The tool in the hand, as a sum of modes.
#[derive(Debug, Clone)]
pub struct ToolResponse {
    modes: Vec<Mode>,
}

/// Response of the tool at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Acceleration at the accelerometer for a force at the tip, (m/s²)/N, on x, y, z.
    pub acceleration_per_force: [Complex<f64>; 3],
    /// Displacement of the tip for a force at the tip, µm/N.
    pub tip_um_per_n: Complex<f64>,
}

impl ToolResponse {
    /// Creates the tool with these modes.
    pub fn new(modes: &[Mode]) -> Self {
        Self { modes: modes.to_vec() }
    }

    /// Returns the response at `frequency_hz`, which must be above zero, in the convention e^{+iωt}.
    pub fn at(&self, frequency_hz: f64) -> Response {
        let omega = TAU * frequency_hz;
        let mut response = Response {
            acceleration_per_force: [Complex::default(); 3],
            tip_um_per_n: Complex::default(),
        };
        for mode in &self.modes {
            let natural = TAU * mode.frequency_hz;
            let receptance = Complex::new(
                natural * natural - omega * omega,
                2.0 * mode.damping_ratio * natural * omega,
            )
            .inv();
            let axes = mode.participation_m_s2_per_n;
            for (total, participation) in response.acceleration_per_force.iter_mut().zip(axes) {
                *total -= receptance * (omega * omega * participation);
            }
            if let Some(participation) = mode.tip_participation_m_s2_per_n {
                response.tip_um_per_n += receptance * (1e6 * participation);
            }
        }
        response
    }
}

impl Response {
    /// Returns the dynamic force per micrometre of mean height under the contact, N/µm: k / (1 + kG), with the complex
    /// stiffness k(1 + iη) in place of k.
    pub fn force_per_height(&self, contact: &Contact, loss_factor: Option<f64>) -> Complex<f64> {
        let stiffness = Complex::new(1.0, loss_factor.unwrap_or(0.0)) * contact.stiffness_n_per_um();
        stiffness / (stiffness * self.tip_um_per_n + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::near;

    #[test]
    fn the_patch_response_is_the_mean_over_the_pressure() {
        let contact = Contact::hertz(1.5, 300.0, 1.0).unwrap();
        let a = contact.radius_mm();
        for wavenumber in [1e-3, 0.2, 0.04 / a, 0.06 / a, 1.0 / a, 4.0 / a, 20.0 / a] {
            // Reference: the midpoint rule over the square around the contact, applied to the pressure itself.
            let cells = 800;
            let (mut weighted, mut total) = (0.0, 0.0);
            for row in 0..cells {
                for column in 0..cells {
                    let x = (2.0 * (f64::from(row) + 0.5) / f64::from(cells) - 1.0) * a;
                    let y = (2.0 * (f64::from(column) + 0.5) / f64::from(cells) - 1.0) * a;
                    let pressure = (1.0 - (x * x + y * y) / (a * a)).max(0.0).sqrt();
                    weighted += pressure * (wavenumber * x).cos();
                    total += pressure;
                }
            }
            let response = contact.patch_response(wavenumber);
            assert!(
                (response - weighted / total).abs() < 2e-5,
                "{wavenumber}: {response} against {}",
                weighted / total
            );
        }
    }

    #[test]
    fn stiffness_is_the_slope_of_the_hertz_law() {
        // δ = (9F² / 16 R E*²)^{1/3}, Johnson 1985, eq. 4.23.
        let indentation_um = |force_n: f64| 1e3 * (9.0 * force_n * force_n / (16.0 * 1.5 * 300.0_f64.powi(2))).cbrt();
        for force_n in [0.2, 0.7, 1.4] {
            let slope = 2e-4 / (indentation_um(force_n + 1e-4) - indentation_um(force_n - 1e-4));
            let contact = Contact::hertz(1.5, 300.0, force_n).unwrap();
            near(contact.stiffness_n_per_um() / slope, 1.0, 1e-6);
        }
    }

    #[test]
    fn a_rigid_tip_gets_the_whole_contact_force() {
        let contact = Contact::hertz(1.5, 500.0, 1.0).unwrap();
        let response = ToolResponse::new(&[Mode {
            frequency_hz: 40.0,
            damping_ratio: 0.3,
            participation_m_s2_per_n: [0.0, 5.0, 50.0],
            tip_participation_m_s2_per_n: None,
        }])
        .at(100.0);
        let force = response.force_per_height(&contact, Some(0.2));
        let expected = Complex::new(1.0, 0.2) * contact.stiffness_n_per_um();
        assert!((force - expected).norm() < 1e-12);
    }
}
