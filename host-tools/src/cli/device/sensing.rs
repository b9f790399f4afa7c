//! The sensors, for the commands that record: their calibration, and levels in the line that shows progress.

use host_tools::link::Device;
use host_tools::link::capture::{Calibration, Level};
use host_tools::support::error::{Error, Result};
use model_format::Provenance;

/// Samples that a live level is the mean of: 0.1 s.
pub const LIVE_SAMPLES: usize = 500;

/// A level in a few words.
pub fn live(level: &Level) -> String {
    format!("{:7.3} m/s² {:5.1} mm/s", level.rms_m_s2, level.speed_mm_s)
}

/// Calibration and provenance of the stylus's sensors.
#[derive(clap::Args)]
pub struct Sensing {
    /// Scale of the accelerometer in place of the setting, in m/s² per volt: one for all axes, or X,Y,Z
    #[arg(
        long,
        value_name = "M_S2_PER_V",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    scale: Vec<f64>,
    /// Mark the recording as simulated, for a virtual stylus
    #[arg(long)]
    simulated: bool,
}

impl Sensing {
    /// The calibration by the device's settings, with the given scales in place of theirs.
    ///
    /// # Errors
    /// A link that broke, a number of scales other than one or three, or scales that are all zero.
    pub fn calibration(&self, device: &Device) -> Result<Calibration> {
        let calibration = Calibration::new(&device.settings()?, self.scale()?);
        let mut scales = calibration.m_s2_per_code.iter();
        if scales.all(|scale| scale.abs() <= 0.0) {
            return Err(Error::Request(
                "the accelerometer's scale is zero; set acceleration-per-volt-x, -y, -z, or give --scale"
                    .to_owned(),
            ));
        }
        Ok(calibration)
    }

    /// Provenance of the recording.
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
