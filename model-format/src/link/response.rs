//! Response of the actuator, as it was measured in the stylus, and the equaliser that corrects it.
//!
//! A response is proposed, verified with [`super::ProbeThrough::Proposed`], and then stored by its [`Response::id`]. A
//! proposed response is only in RAM, so that a calibration that fails or is interrupted changes nothing. Storing writes
//! the response and `output-gain` in one record.

use heapless::Vec;
use postcard_schema::Schema;
use postcard_schema::schema::{DataModelType, NamedType};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{LIBRARY_CRC, LinkId, Setting, SettingChange, SettingSet, Settings, SettingsError};
use crate::PlayRate;
use crate::scene::{Biquad, SceneProblem, check_equaliser, limits::MAX_RESPONSE_SECTIONS};

/// Number of third-octave bands of [`Response::bands_centi_db`]: the exact bands of base ten whose nominal centres are
/// 10 to 1000 Hz.
pub const RESPONSE_BANDS: usize = 21;

/// Length of a response in a message and in flash, bytes.
pub const RESPONSE_BYTES: usize = 348;

/// A cascade of up to [`MAX_RESPONSE_SECTIONS`] sections. Its encoded length is the same for any number of sections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sections {
    count: u8,
    /// Coefficients b0, b1, b2, a1, a2 of each section, little-endian, as in [`Biquad`].
    coefficients: [[u8; 20]; MAX_RESPONSE_SECTIONS],
}

impl Sections {
    /// No section.
    pub const NONE: Self = Self {
        count: 0,
        coefficients: [[0; 20]; MAX_RESPONSE_SECTIONS],
    };

    /// The cascade of `biquads`; none if there are more than [`MAX_RESPONSE_SECTIONS`].
    pub fn new(biquads: &[Biquad]) -> Option<Self> {
        let mut sections = Self::NONE;
        sections.count = biquads.len() as u8;
        let places = sections.coefficients.get_mut(..biquads.len())?;
        for (place, biquad) in places.iter_mut().zip(biquads) {
            let values = biquad.numerator.iter().chain(&biquad.denominator);
            for (word, value) in place.chunks_exact_mut(4).zip(values) {
                word.copy_from_slice(&value.to_le_bytes());
            }
        }
        Some(sections)
    }

    /// The sections.
    pub fn biquads(&self) -> Vec<Biquad, MAX_RESPONSE_SECTIONS> {
        let value = |bytes: &[u8; 20], at: usize| {
            let word = bytes[4 * at..].first_chunk();
            i32::from_le_bytes(word.copied().unwrap_or_default())
        };
        let of = |bytes: &[u8; 20]| Biquad {
            numerator: [0, 1, 2].map(|at| value(bytes, at)),
            denominator: [3, 4].map(|at| value(bytes, at)),
        };
        // Bytes from elsewhere may state more sections than there are.
        let there = self.coefficients.iter().take(self.count.into());
        there.map(of).collect()
    }
}

/// The actuator's response as it was measured, and its correction.
///
/// A message contains the response as [`Response::bytes`], because code for each of its fields would take some
/// kilobytes of the device's flash. Two responses are equal if their bytes are equal.
#[derive(Clone, Copy, Debug)]
pub struct Response {
    /// Equaliser for playing at 5 kHz.
    pub sections_5khz: Sections,
    /// Equaliser for playing at 10 kHz.
    pub sections_10khz: Sections,
    /// Time of the measurement, s since 1970-01-01 UTC.
    pub measured_at: u64,
    /// Largest deviation of the corrected response from flat, as measured in the verification, dB.
    pub worst_db: f32,
    /// RMS deviation of the corrected response from flat, as measured in the verification, dB.
    pub rms_db: f32,
    /// Frequency of the actuator's resonance, Hz.
    pub resonance_hz: f32,
    /// Damping ratio of the resonance.
    pub damping_ratio: f32,
    /// Delay from the tick that outputs a sample to the tick that records its effect, µs.
    pub delay_us: f32,
    /// Direction of the motion in the accelerometer's axes, of length 1.
    pub axis: [f32; 3],
    /// Acceleration per voltage at the DAC before correction, m/s² per V: the mean of the level over the band of the
    /// calibration.
    pub level_m_s2_per_volt: f32,
    /// Level of each third-octave band as measured before correction, in hundredths of a decibel re 1 m/s² per V.
    pub bands_centi_db: [i16; RESPONSE_BANDS],
    /// Bands that were measured with enough coherence for their level to be trusted, one bit each.
    pub trusted_bands: u32,
    /// Value of `output-gain` with which the tip has the requested acceleration. The device stores it with the
    /// response.
    pub output_gain: f32,
    /// Value of `amplifier-gain` in the measurement.
    pub amplifier_gain: f32,
    /// Value of `coil-resistance` in the measurement.
    pub coil_resistance: f32,
    /// Value of `hard-limit` in the measurement.
    pub hard_limit: f32,
}

impl Response {
    /// Equaliser for playing at `rate`.
    pub const fn sections(&self, rate: PlayRate) -> &Sections {
        match rate {
            PlayRate::Hz5000 => &self.sections_5khz,
            PlayRate::Hz10000 => &self.sections_10khz,
        }
    }

    /// A hash of the whole response: CRC-32 of its bytes.
    pub fn id(&self) -> u32 {
        LIBRARY_CRC.checksum(&self.bytes())
    }

    /// The response in bytes: all fields in their order, little-endian.
    pub fn bytes(&self) -> [u8; RESPONSE_BYTES] {
        let mut bytes = Vec::<u8, RESPONSE_BYTES>::new();
        // All fields fit in the capacity; a test writes and reads them.
        let mut put = |value: &[u8]| drop(bytes.extend_from_slice(value));
        for sections in [&self.sections_5khz, &self.sections_10khz] {
            put(&[sections.count]);
            put(sections.coefficients.as_flattened());
        }
        put(&self.measured_at.to_le_bytes());
        for figure in self.figures() {
            put(&figure.to_le_bytes());
        }
        for band in self.bands_centi_db {
            put(&band.to_le_bytes());
        }
        put(&self.trusted_bands.to_le_bytes());
        bytes.into_array().unwrap_or([0; RESPONSE_BYTES])
    }

    /// Reads a response from its bytes.
    pub fn from_bytes(bytes: &[u8; RESPONSE_BYTES]) -> Self {
        let mut rest = &bytes[..];
        let sections_5khz = sections(&mut rest);
        let sections_10khz = sections(&mut rest);
        let measured_at = u64::from_le_bytes(take(&mut rest));
        let mut figures = [0.0; FIGURES];
        for figure in &mut figures {
            *figure = f32::from_le_bytes(take(&mut rest));
        }
        let mut bands_centi_db = [0; RESPONSE_BANDS];
        for band in &mut bands_centi_db {
            *band = i16::from_le_bytes(take(&mut rest));
        }
        let [worst_db, rms_db, resonance_hz, damping_ratio, delay_us, x, y, z, ..] = figures;
        let [.., level, output_gain, amplifier_gain, coil_resistance, hard_limit] = figures;
        Self {
            sections_5khz,
            sections_10khz,
            measured_at,
            worst_db,
            rms_db,
            resonance_hz,
            damping_ratio,
            delay_us,
            axis: [x, y, z],
            level_m_s2_per_volt: level,
            bands_centi_db,
            trusted_bands: u32::from_le_bytes(take(&mut rest)),
            output_gain,
            amplifier_gain,
            coil_resistance,
            hard_limit,
        }
    }

    const fn figures(&self) -> [f32; FIGURES] {
        let [x, y, z] = self.axis;
        [
            self.worst_db,
            self.rms_db,
            self.resonance_hz,
            self.damping_ratio,
            self.delay_us,
            x,
            y,
            z,
            self.level_m_s2_per_volt,
            self.output_gain,
            self.amplifier_gain,
            self.coil_resistance,
            self.hard_limit,
        ]
    }

    /// The setting that is stored with the response.
    pub const fn change(&self) -> SettingChange {
        SettingChange {
            setting: Setting::OutputGain,
            value: self.output_gain,
        }
    }

    /// Returns which of `output-gain`, `amplifier-gain` and `coil-resistance` differ from the values for which the
    /// response was made. If any does, the response no longer describes the tip's motion.
    pub fn stale(&self, settings: &Settings) -> SettingSet {
        let made_for = [
            (Setting::OutputGain, self.output_gain),
            (Setting::AmplifierGain, self.amplifier_gain),
            (Setting::CoilResistance, self.coil_resistance),
        ];
        made_for.into_iter().fold(SettingSet::NONE, |set, (of, value)| {
            // Bit for bit, because values are copied from the settings and never computed.
            set.with(of, settings.get(of).to_bits() != value.to_bits())
        })
    }

    /// Checks that the equalisers are stable and within the limit of gain, that every figure is finite, and that none
    /// of `settings` makes the response stale, see [`Response::stale`].
    pub fn check(&self, settings: &Settings) -> Result<(), ResponseError> {
        for rate in PlayRate::ALL {
            check_equaliser(&self.sections(rate).biquads()).map_err(|(section, problem)| {
                let (section, rate_hz) = (section as u8, rate.hz());
                match problem {
                    SceneProblem::PoleRadius => ResponseError::Poles { rate_hz, section },
                    _ => ResponseError::Gain { rate_hz, section },
                }
            })?;
        }
        if !self.figures().iter().all(|figure| figure.is_finite()) {
            return Err(ResponseError::NotFinite);
        }
        // The response brings its own output gain, which is stored with it.
        let settings = settings.with(self.change())?;
        let differing = self.stale(&settings);
        if differing.is_empty() {
            Ok(())
        } else {
            Err(ResponseError::Stale { differing })
        }
    }
}

/// Number of `f32` figures in a response.
const FIGURES: usize = 13;

/// Splits encoded sections off the beginning of `rest`.
fn sections(rest: &mut &[u8]) -> Sections {
    let [count] = take(rest);
    let mut coefficients = [[0; 20]; MAX_RESPONSE_SECTIONS];
    for place in &mut coefficients {
        *place = take(rest);
    }
    Sections { count, coefficients }
}

/// Splits the first `N` bytes off `rest` and returns them; returns zeros if `rest` is shorter.
fn take<const N: usize>(rest: &mut &[u8]) -> [u8; N] {
    let Some((value, behind)) = rest.split_first_chunk() else {
        return [0; N];
    };
    *rest = behind;
    *value
}

impl PartialEq for Response {
    fn eq(&self, other: &Self) -> bool {
        self.bytes() == other.bytes()
    }
}

impl Serialize for Response {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.bytes())
    }
}

impl<'de> Deserialize<'de> for Response {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let bytes = <&[u8]>::deserialize(deserializer)?;
        let bytes = bytes.try_into().map_err(D::Error::custom)?;
        Ok(Self::from_bytes(bytes))
    }
}

impl Schema for Response {
    const SCHEMA: &'static NamedType = &NamedType {
        name: "Response",
        ty: &DataModelType::ByteArray,
    };
}

/// The response that is stored.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct StoredResponse {
    /// The response.
    pub response: Response,
    /// [`Response::id`] of this response.
    pub id: u32,
    /// [`Response::stale`] for the settings in force. The equaliser of a stale response stays in use, because an
    /// equaliser for another level is better than none, and because a change of a setting must not switch the equaliser
    /// off unnoticed.
    pub stale: SettingSet,
}

/// Responses in the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
pub struct ResponseState {
    /// The stored response. Its equaliser is applied to every texture and scene that is played.
    pub stored: Option<StoredResponse>,
    /// [`Response::id`] of the response that was proposed and not yet stored.
    pub proposed: Option<u32>,
}

/// Change of the stored response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ResponseChange {
    /// Stores the response with this [`Response::id`] and its `output_gain`. The same link must have proposed the
    /// response.
    Store {
        /// Hash of the response to store.
        id: u32,
    },
    /// Removes the stored response. Settings stay as they are.
    Clear {
        /// Hash of the response to remove.
        id: u32,
    },
}

/// Reason for which a response is not accepted or stored. The previously stored response stays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum ResponseError {
    #[error("section {section} of the equaliser at {rate_hz} Hz has poles beyond the limit: design it anew")]
    Poles {
        /// Sample rate of the equaliser, Hz.
        rate_hz: u32,
        /// Index of the section.
        section: u8,
    },
    #[error("the equaliser at {rate_hz} Hz is above the limit of gain from section {section} on: design it anew")]
    Gain {
        /// Sample rate of the equaliser, Hz.
        rate_hz: u32,
        /// Index of the section.
        section: u8,
    },
    #[error("a figure of the response is not finite: measure it again")]
    NotFinite,
    #[error("{differing} has changed since the response was measured: measure it again")]
    Stale {
        /// The settings that differ.
        differing: SettingSet,
    },
    #[error("no response with the hash {id:08x} waits or is stored: it was replaced, or the device has restarted")]
    NoSuchResponse { id: u32 },
    #[error("{from} has proposed this response, and it alone stores it")]
    OtherLink {
        /// The link that proposed the response.
        from: LinkId,
    },
    /// A reason that also prevents changes of settings.
    #[error("{0}")]
    Settings(#[from] SettingsError),
}
