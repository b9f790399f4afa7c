//! Resonances of the hand-held tool, and the force that a surface gives at its tip.

use std::f64::consts::TAU;

use realfft::num_complex::Complex;

use super::contact::Contact;
use super::description::Mode;

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
    /// The tool with these modes.
    pub fn new(modes: &[Mode]) -> Self {
        Self {
            modes: modes.to_vec(),
        }
    }

    /// The response at `frequency_hz`, which must be above zero, in the convention e^{+iωt}.
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
    /// Dynamic force per micrometre of mean height under the contact, N/µm: k / (1 + kG) with k(1 + iη) for k.
    pub fn force_per_height(&self, contact: &Contact, loss_factor: Option<f64>) -> Complex<f64> {
        let stiffness =
            Complex::new(1.0, loss_factor.unwrap_or(0.0)) * contact.stiffness_n_per_um();
        stiffness / (stiffness * self.tip_um_per_n + 1.0)
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "zeros and sums must be exact")]
mod tests {
    use super::*;

    fn mode(tip: Option<f64>) -> Mode {
        Mode {
            frequency_hz: 40.0,
            damping_ratio: 0.3,
            participation_m_s2_per_n: [0.0, 5.0, 50.0],
            tip_participation_m_s2_per_n: tip,
        }
    }

    #[test]
    fn well_above_resonance_a_mode_is_a_mass_and_well_below_a_spring() {
        let tool = ToolResponse::new(&[mode(Some(50.0))]);
        let above = tool.at(40e4);
        assert!((above.acceleration_per_force[2] - 50.0).norm() < 0.01);
        assert!((above.acceleration_per_force[1] - 5.0).norm() < 0.01);
        assert_eq!(above.acceleration_per_force[0].norm(), 0.0);
        let below = tool.at(40e-4);
        let compliance_um_per_n = 1e6 * 50.0 / (TAU * 40.0).powi(2);
        assert!((below.tip_um_per_n / compliance_um_per_n - 1.0).norm() < 1e-3);
    }

    #[test]
    fn a_tip_that_gives_way_follows_a_stiff_surface() {
        // With a contact far stiffer than the tool, the tip's acceleration is -ω² times the height.
        let contact = Contact::hertz(1.5, 1e9, 1.0).unwrap();
        let omega = TAU * 100.0;
        let response = ToolResponse::new(&[mode(Some(50.0))]).at(100.0);
        let acceleration_per_um =
            response.force_per_height(&contact, None) * response.acceleration_per_force[2];
        let expected = -omega * omega * 1e-6;
        assert!((acceleration_per_um / expected - 1.0).norm() < 1e-3);
    }

    #[test]
    fn a_rigid_tip_gets_the_whole_contact_force() {
        let contact = Contact::hertz(1.5, 500.0, 1.0).unwrap();
        let response = ToolResponse::new(&[mode(None)]).at(100.0);
        let force = response.force_per_height(&contact, Some(0.2));
        let expected = Complex::new(1.0, 0.2) * contact.stiffness_n_per_um();
        assert!((force - expected).norm() < 1e-12);
    }
}
