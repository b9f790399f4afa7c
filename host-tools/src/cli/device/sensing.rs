//! What the sensors' codes stand for, for the commands that record.

use host_tools::link::Device;
use host_tools::link::capture::Calibration;
use host_tools::support::error::{Error, Result};
use model_format::Provenance;

/// How what a stylus senses is to be understood.
#[derive(clap::Args)]
pub struct Sensing {
    /// Scales of the accelerometer's axes instead of the settings', in m/s² per volt: one for all, or X,Y,Z
    #[arg(
        long,
        value_name = "M_S2_PER_V",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    scale: Vec<f64>,
    /// The stylus is a virtual one: mark what is recorded as simulated
    #[arg(long)]
    simulated: bool,
}

impl Sensing {
    /// By the device's settings, with what was given in place of theirs.
    ///
    /// # Errors
    /// A link that broke, a number of scales that is neither one nor three, or scales that are all zero.
    pub fn calibration(&self, device: &Device) -> Result<Calibration> {
        let calibration = Calibration::new(&device.settings()?, self.scale()?);
        let mut scales = calibration.m_s2_per_code.iter();
        if scales.all(|scale| scale.abs() <= 0.0) {
            return Err(Error::Request(
                "the accelerometer's scale is zero: set acceleration-per-volt-x, -y, -z, or give --scale"
                    .to_owned(),
            ));
        }
        Ok(calibration)
    }

    /// Whether it is recorded from a real stylus.
    pub fn provenance(&self) -> Provenance {
        if self.simulated {
            Provenance::Simulated
        } else {
            Provenance::Recorded
        }
    }

    fn scale(&self) -> Result<Option<[f64; 3]>> {
        match self.scale.as_slice() {
            [] => Ok(None),
            [all] => Ok(Some([*all; 3])),
            [x, y, z] => Ok(Some([*x, *y, *z])),
            other => Err(Error::Request(format!(
                "--scale takes one value or three, not {}",
                other.len()
            ))),
        }
    }
}
