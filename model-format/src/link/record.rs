//! Recording: the converters' codes of each tick, in numbered blocks.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::AdcCode;

/// Number of samples in a block.
pub const BLOCK_SAMPLES: usize = 32;

/// Number of codes at either end of the converter's range in which a force sensor counts as open, shorted or
/// overloaded.
///
/// At the rail, noise moves a pin's code by up to 64 codes: 4 standard deviations of 16 codes each. 64 codes are 3.2 mV
/// of 3.3 V. The codes of a sensor at no force and at its greatest force must lie between these two ranges.
pub const RAIL_CODES: u16 = 64;

/// Codes of the converters in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordSample {
    /// Codes of the accelerometer's axes X, Y and Z.
    pub acceleration: [AdcCode; 3],
    /// Code of the force sensor.
    pub force: AdcCode,
    /// Change of the encoder's count since the tick before.
    pub encoder_delta: i16,
}

/// A sample as it is sent: five little-endian numbers of 16 bits, so that every block has the same length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct PackedSample([u8; Self::BYTES]);

impl PackedSample {
    /// Length of a sample, bytes.
    pub const BYTES: usize = 10;

    /// All zeros.
    pub const ZERO: Self = Self([0; Self::BYTES]);
}

impl From<RecordSample> for PackedSample {
    #[inline(always)]
    fn from(sample: RecordSample) -> Self {
        let [x, y, z] = sample.acceleration.map(|code| code.0.to_le_bytes());
        let force = sample.force.0.to_le_bytes();
        let delta = sample.encoder_delta.to_le_bytes();
        Self([
            x[0], x[1], y[0], y[1], z[0], z[1], force[0], force[1], delta[0], delta[1],
        ])
    }
}

impl From<PackedSample> for RecordSample {
    fn from(packed: PackedSample) -> Self {
        let bytes = packed.0;
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Self {
            acceleration: [0, 2, 4].map(|at| AdcCode(word(at))),
            force: AdcCode(word(6)),
            encoder_delta: word(8) as i16,
        }
    }
}

/// A block of samples of successive ticks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct RecordBlock {
    /// Number of the block, from 0 at the start of a recording. A missing number is a block that the device lost.
    pub sequence: u32,
    /// Tick of the first sample, counted from the device's start; a tick is 200 µs.
    pub first_tick: u64,
    /// Blocks that the device lost since the start of the recording.
    pub lost_blocks: u32,
    /// Samples whose conversions do not all belong to their tick, because the tick read them too early or too late. Bit
    /// n stands for sample n. The encoder steps of these samples are right.
    pub torn: u32,
    /// The samples.
    pub samples: [PackedSample; BLOCK_SAMPLES],
}

const _: () = assert!(BLOCK_SAMPLES <= u32::BITS as usize);

impl RecordBlock {
    /// Returns true if the conversions of sample `index` all belong to its tick.
    pub const fn is_whole(&self, index: usize) -> bool {
        self.torn & (1 << index) == 0
    }
}

/// A recording that has begun: block 0 comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct RecordStarted {
    /// Sample rate, Hz.
    pub sample_rate_hz: u32,
    /// [`BLOCK_SAMPLES`] of the device.
    pub block_samples: u32,
}

/// A recording that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct RecordStopped {
    /// Number of blocks of the recording, including lost blocks.
    pub blocks: u32,
    /// Number of these blocks that the device lost.
    pub lost_blocks: u32,
}

/// Reason for which a recording does not start or stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum RecordError {
    /// A recording is under way, which perhaps another link has started.
    #[error("a recording is under way: stop it first")]
    Recording,
    /// No recording is under way.
    #[error("no recording is under way: start one")]
    NotRecording,
}
