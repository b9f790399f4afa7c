//! A probe's waveform, played unchanged.
//!
//! The waveform is tied to the device's ticks, so that a recording is aligned with it even if ticks were missed. Once
//! per block, its samples are copied from the waveform's memory; in the tick, a stage adds one per sample.

use core::sync::atomic::{AtomicI16, Ordering};

use model_format::OutputSample;

/// Samples of the longest block: 2 ms at 10 kHz.
pub(super) const MAX_BLOCK_SAMPLES: usize = 20;

/// A periodic waveform with a beginning and an end.
#[derive(Clone, Copy, Debug)]
pub struct Wave<'a> {
    /// Samples of one period.
    pub samples: &'a [AtomicI16],
    /// Number of samples of all periods together.
    pub total: u32,
    /// Acceleration of a sample of value `i16::MAX`, m/s², below the output's full scale.
    pub peak_m_s2: f32,
    /// Tick of the first sample.
    pub first_tick: u64,
}

impl Wave<'_> {
    /// Fills `block` with the samples from number `from` on, the last one first, and with zeros before the wave begins
    /// and after its end. Returns false if no sample belongs to the wave.
    pub(super) fn fill(&self, from: i64, block: &mut [i32]) -> bool {
        let one = (1u32 << OutputSample::FRACTION_BITS) as f32;
        let step = self.peak_m_s2 * one / f32::from(i16::MAX);
        let mut sounds = false;
        for (place, number) in block.iter_mut().rev().zip(from..) {
            let number = u32::try_from(number).ok().filter(|&number| number < self.total);
            let sample = number.and_then(|number| {
                let at = (number as usize).checked_rem(self.samples.len())?;
                Some(self.samples[at].load(Ordering::Relaxed))
            });
            sounds |= sample.is_some();
            *place = (f32::from(sample.unwrap_or(0)) * step) as i32;
        }
        sounds
    }
}
