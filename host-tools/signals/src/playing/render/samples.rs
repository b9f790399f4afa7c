//! Samples of a rendering, one by one or in memory.

use model_format::{OutputSample, Texture};
use stylus_kernel::scene::{Plan, ScenePlayer};
use stylus_kernel::update_interval_samples;
use stylus_support::{Error, Result};

use crate::playing::motion::{Hand, MotionPath};
use crate::playing::wavefront::Wavefront;

/// Iterator over the samples of a texture or scene along a motion. It stores the samples of one update interval.
///
/// The same library, motion and seed give the same samples on every computer. As on a stylus, a texture starts at its
/// full level, without fading in, as soon as there is contact.
#[derive(Clone, Debug)]
pub struct Rendering<'a> {
    player: ScenePlayer<'a, Wavefront>,
    hand: Hand<'a>,
    clock: SampleClock,
    /// The samples up to the next update.
    block: Vec<OutputSample>,
    /// Number of samples of `block` that were returned.
    taken: usize,
}

impl<'a> Rendering<'a> {
    /// Creates a rendering of `seconds` of `texture`, from rest without contact, with the plan that a stylus makes for
    /// this texture.
    ///
    /// # Errors
    /// A duration that is not a number, is shorter than a sample, or is longer than
    /// [`MAX_SECONDS`].
    pub fn new(texture: Texture<'a>, motion: &'a MotionPath, seconds: f64, seed: u64) -> Result<Self> {
        Self::of_plan(Plan::of_texture(texture), motion, seconds, seed)
    }

    /// Creates a rendering of `seconds` of `plan`, from rest without contact.
    pub fn of_plan(plan: Plan<'a>, motion: &'a MotionPath, seconds: f64, seed: u64) -> Result<Self> {
        let clock = SampleClock::new(seconds, plan.sample_rate_hz())?;
        Ok(Self {
            block: vec![OutputSample::SILENCE; clock.block_samples() as usize],
            clock,
            player: ScenePlayer::new(plan, seed),
            hand: Hand::new(motion),
            taken: 0,
        })
    }

    /// Returns the number of samples at the kernel's full scale, up to the next update.
    pub fn saturations(&self) -> u32 {
        self.player.saturations()
    }

    /// Sample rate, Hz.
    pub fn sample_rate_hz(&self) -> u32 {
        self.clock.sample_rate_hz()
    }

    /// Stores the samples that `collect` returns in memory.
    pub fn rendered(mut self, collect: impl FnOnce(&mut Self) -> Vec<OutputSample>) -> Rendered {
        Rendered {
            // Saturations are counted while samples are collected, so the samples come first.
            samples: collect(&mut self),
            sample_rate_hz: self.sample_rate_hz(),
            saturations: self.saturations(),
        }
    }
}

impl Iterator for Rendering<'_> {
    type Item = OutputSample;

    fn next(&mut self) -> Option<OutputSample> {
        let left = self.clock.len();
        if let Some(time_s) = self.clock.next()? {
            let interaction = self.hand.for_block(time_s, self.clock.block_s());
            let samples = self.clock.block_samples();
            self.player.follow(interaction, samples);
            // A rendering may end within its last block.
            self.block.truncate(left.min(samples as usize));
            self.player.next_block(&mut self.block);
            self.taken = 0;
        }
        self.taken += 1;
        Some(self.block[self.taken - 1])
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.clock.size_hint()
    }
}

impl ExactSizeIterator for Rendering<'_> {}

/// A rendering in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rendered {
    /// Sample rate, Hz.
    pub sample_rate_hz: u32,
    /// Samples that the stylus plays.
    pub samples: Vec<OutputSample>,
    /// Number of samples at the kernel's full scale.
    pub saturations: u32,
}

impl Rendered {
    /// Returns the samples in m/s², without rounding.
    pub fn accelerations_m_s2(&self) -> Vec<f64> {
        self.samples.iter().map(|&sample| exact_m_s2(sample)).collect()
    }
}

/// Converts a sample to m/s², without rounding because double precision represents every sample exactly.
pub(super) fn exact_m_s2(sample: OutputSample) -> f64 {
    f64::from(sample.0) / f64::from(1u32 << OutputSample::FRACTION_BITS)
}

/// Renders `seconds` of `texture` along `motion` into memory. For more than a few minutes, use
/// [`render_wav`](super::render_wav).
pub fn render(texture: Texture<'_>, motion: &MotionPath, seconds: f64, seed: u64) -> Result<Rendered> {
    Ok(Rendering::new(texture, motion, seconds, seed)?.rendered(|samples| samples.collect()))
}

/// Longest rendering, s: one day.
pub const MAX_SECONDS: f64 = 24.0 * 3600.0;

/// Iterator over the samples of a rendering. Its items are the times, s, at which the motion must be read before the
/// sample, or `None` between two updates.
///
/// An update is due every [`update_interval_samples`], as on the device.
#[derive(Clone, Debug)]
pub struct SampleClock {
    sample_rate_hz: u32,
    position: usize,
    len: usize,
}

impl SampleClock {
    /// Creates a clock over `seconds`, from the first sample.
    ///
    /// # Errors
    /// A duration that is not a number, is shorter than a sample, or is longer than [`MAX_SECONDS`].
    pub fn new(seconds: f64, sample_rate_hz: u32) -> Result<Self> {
        let samples = (seconds * f64::from(sample_rate_hz)).round();
        // The comparisons are false for a NaN.
        if !(seconds <= MAX_SECONDS && samples >= 1.0) {
            return Err(Error::Request(format!(
                "cannot render {seconds} s: give at least the duration of one sample and at most {MAX_SECONDS} s"
            )));
        }
        Ok(Self {
            sample_rate_hz,
            position: 0,
            len: samples as usize,
        })
    }

    /// Time from a block's first sample to its last one, s.
    pub fn block_s(&self) -> f64 {
        f64::from(self.block_samples() - 1) / f64::from(self.sample_rate_hz)
    }

    /// Number of samples of a block.
    pub fn block_samples(&self) -> u32 {
        update_interval_samples(self.sample_rate_hz)
    }

    /// Sample rate, Hz.
    pub fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }
}

impl Iterator for SampleClock {
    type Item = Option<f64>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.position == self.len {
            return None;
        }
        let is_due = self.position.is_multiple_of(self.block_samples() as usize);
        let time_s = self.position as f64 / f64::from(self.sample_rate_hz);
        self.position += 1;
        Some(is_due.then_some(time_s))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.len - self.position;
        (left, Some(left))
    }
}

impl ExactSizeIterator for SampleClock {}

/// Motions that several tests of this crate use, over the grid of [`test_helpers::library`].
#[cfg(test)]
pub(crate) mod test_motions {
    use model_format::{MillimetresPerSecond, Newton};

    use crate::playing::motion::MotionPath;

    pub fn constant(speed_mm_s: f32, force_n: f32) -> MotionPath {
        MotionPath::constant(MillimetresPerSecond(speed_mm_s), Newton(force_n)).unwrap()
    }

    /// A motion across the whole grid and down to rest.
    pub fn sweep() -> MotionPath {
        let file = tempfile::NamedTempFile::new().unwrap();
        let rows = "time_s,speed_mm_s,force_n\n0,0,0.2\n0.2,120,1.1\n0.3,60,0.4\n0.4,0,0\n";
        std::fs::write(file.path(), rows).unwrap();
        MotionPath::from_csv(file.path()).unwrap()
    }
}

#[cfg(test)]
mod tests {
    use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
    use stylus_kernel::scene::{ContactDetector, ContactThreshold, Interaction};

    use super::test_motions::{constant, sweep};
    use super::*;
    use stylus_support::Error;
    use test_helpers::{library, texture};

    #[test]
    fn a_rendering_is_what_the_kernel_plays_when_it_follows_the_motion_every_two_milliseconds() {
        for (rate_hz, interval) in [(5000, UPDATE_INTERVAL_SAMPLES), (10_000, 20)] {
            let library = library(rate_hz);
            let motion = sweep();
            let rendered = render(texture(&library), &motion, 0.4, 11).unwrap();
            let plan = Plan::of_texture(texture(&library));
            let mut kernel: ScenePlayer<'_> = ScenePlayer::new(plan, 11);
            let mut contact = ContactDetector::new();
            let mut played = Vec::new();
            for update in 0..200 {
                let motion = motion.at(f64::from(update) * 0.002);
                let contact = contact.touches(motion, ContactThreshold::LEAST);
                let interaction = Interaction::new(motion, 0.0, contact).unwrap();
                kernel.follow(interaction, interval);
                played.extend((0..interval).map(|_| kernel.next_sample()));
            }
            assert_eq!(rendered.samples, played);
            assert_eq!(rendered.sample_rate_hz, rate_hz);
            assert_eq!(rendered.saturations, 0);
        }
    }

    #[test]
    fn durations_that_make_no_sense_are_refused() {
        let library = library(5000);
        for seconds in [0.0, -1.0, 1e-5, f64::NAN, f64::INFINITY, MAX_SECONDS * 1.001] {
            let error = render(texture(&library), &constant(80.0, 0.7), seconds, 1).unwrap_err();
            assert!(matches!(error, Error::Request(_)), "{seconds}");
        }
        let motion = constant(80.0, 0.7);
        assert_eq!(
            Rendering::new(texture(&library), &motion, MAX_SECONDS, 1)
                .unwrap()
                .len(),
            432_000_000
        );
    }
}
