//! A capture as the WAV file of a trial.

use std::io::Cursor;

use hound::{SampleFormat, WavSpec, WavWriter};

use crate::link::capture::{Calibration, Capture};

/// Codes from the middle of the converter's range to its end.
const HALF_RANGE: f64 = 32_768.0;

/// Acceleration that half the range stands for on the axis with the largest scale, m/s². No sample of any axis then
/// exceeds 1.
pub(super) fn scale_m_s2(calibration: &Calibration) -> f64 {
    let largest = calibration
        .m_s2_per_code
        .iter()
        .fold(0.0, |a: f64, b| a.max(b.abs()));
    // A reader refuses a scale of zero. All samples are zero in that case, so that any other scale serves.
    if largest > 0.0 {
        largest * HALF_RANGE
    } else {
        1.0
    }
}

/// Returns the bytes of the file. A sample is its acceleration over `scale_m_s2`.
pub(super) fn encode(
    capture: &Capture,
    calibration: &Calibration,
    scale_m_s2: f64,
) -> hound::Result<Vec<u8>> {
    let spec = WavSpec {
        channels: 3,
        sample_rate: capture.rate_hz,
        bits_per_sample: 32,
        sample_format: SampleFormat::Float,
    };
    let mut file = Cursor::new(Vec::with_capacity(12 * capture.samples.len() + 128));
    let mut writer = WavWriter::new(&mut file, spec)?;
    for sample in &capture.samples {
        for acceleration_m_s2 in calibration.acceleration(sample) {
            writer.write_sample((acceleration_m_s2 / scale_m_s2) as f32)?;
        }
    }
    writer.finalize()?;
    Ok(file.into_inner())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use model_format::AdcCode;
    use model_format::link::{RecordSample, Settings};
    use proptest::prelude::*;

    use crate::link::capture::Loss;

    pub fn capture(codes: &[[u16; 3]]) -> Capture {
        let samples = codes.iter().map(|&[x, y, z]| RecordSample {
            acceleration: [AdcCode(x), AdcCode(y), AdcCode(z)],
            force: AdcCode(0),
            encoder_delta: 0,
        });
        Capture {
            interpolated: 0,
            samples: samples.collect(),
            rate_hz: 5000,
            first_tick: 0,
            loss: Loss::default(),
            holes: 0,
        }
    }

    pub fn calibration() -> Calibration {
        Calibration::new(&Settings::default(), Some([30.0, -60.0, 15.0]))
    }

    proptest! {
        #[test]
        fn no_sample_of_a_recording_is_beyond_full_scale(
            scales in prop::array::uniform3(-5000.0..5000.0f64),
            codes in prop::array::uniform3(any::<u16>()),
        ) {
            let calibration = Calibration::new(&Settings::default(), Some(scales));
            let scale = scale_m_s2(&calibration);
            for acceleration in calibration.acceleration(&capture(&[codes]).samples[0]) {
                prop_assert!((acceleration / scale).abs() <= 1.0 + 1e-12);
            }
        }
    }
}
