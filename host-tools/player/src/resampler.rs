//! Resampling from the rate of a texture to any rate of a sound card, by a polyphase filter.
//!
//! The filter's prototype is a sinc with a Kaiser window, flat to 0.4 of the lower of the two rates and 80 dB down from
//! half of it on (J. F. Kaiser, 1974). Each phase has its own row of taps, so that an output sample is one scalar
//! product.

use std::f64::consts::PI;

/// Attenuation that the window is designed for, dB: 80 and a margin for normalised rows and `f32`.
const DESIGN_DB: f64 = 86.0;

/// Width of the transition, as a fraction of the lower rate.
const TRANSITION: f64 = 0.1;

/// Middle of the transition, as a fraction of the lower rate.
const CUT: f64 = 0.45;

/// An interpolator, with the samples that it still needs.
pub struct Resampler {
    /// Taps of each phase, from the newest sample on.
    rows: Vec<f32>,
    taps: usize,
    /// Phases per input sample, and phases per output sample.
    phases: usize,
    step: usize,
    /// Phase of the next output sample, and number of input samples to take before it.
    phase: usize,
    missing: usize,
    /// The last samples, stored twice, so that any run of `taps` samples from the newest on is contiguous.
    past: Vec<f32>,
    newest: usize,
}

impl Resampler {
    /// Creates an interpolator from `from_hz` to `to_hz`, preceded by silence.
    pub fn new(from_hz: u32, to_hz: u32) -> Self {
        // Without the common divisor, 5000 to 48 000 Hz would have 48 000 phases in place of 48.
        let divisor = greatest_divisor(from_hz, to_hz);
        let (phases, step) = ((to_hz / divisor) as usize, (from_hz / divisor) as usize);
        let taps = taps(from_hz, to_hz);
        let rows = (0..phases).flat_map(|phase| row(phase as f64 / phases as f64, from_hz, to_hz));
        Self {
            rows: rows.collect(),
            taps,
            phases,
            step,
            phase: 0,
            missing: 1,
            past: vec![0.0; 2 * taps],
            newest: 0,
        }
    }

    /// Number of input samples after which an earlier one has no effect any more.
    pub fn memory(&self) -> u32 {
        self.taps as u32
    }

    /// Forgets the input samples.
    pub fn reset(&mut self) {
        self.past.fill(0.0);
        (self.phase, self.missing) = (0, 1);
    }

    /// Returns the next sample, and takes the input samples that it needs from `source`.
    pub fn next(&mut self, mut source: impl FnMut() -> f32) -> f32 {
        for _ in 0..self.missing {
            self.newest = self.newest.checked_sub(1).unwrap_or(self.taps - 1);
            let sample = source();
            self.past[self.newest] = sample;
            self.past[self.newest + self.taps] = sample;
        }
        // Both run from the newest sample on, so the product needs no wrap.
        let row = &self.rows[self.phase * self.taps..][..self.taps];
        let past = &self.past[self.newest..][..self.taps];
        self.phase += self.step;
        (self.missing, self.phase) = (self.phase / self.phases, self.phase % self.phases);
        row.iter().zip(past).map(|(tap, sample)| tap * sample).sum()
    }
}

/// Delay, s. It is the same at all frequencies.
pub fn delay_s(from_hz: u32, to_hz: u32) -> f64 {
    (taps(from_hz, to_hz) / 2) as f64 / f64::from(from_hz)
}

/// Number of taps of a row. It is even, so that the delay is a whole number of input samples.
fn taps(from_hz: u32, to_hz: u32) -> usize {
    let lower = f64::from(from_hz.min(to_hz)) / f64::from(from_hz);
    // Kaiser's estimate of the length; the transition is a fraction of the lower rate, the taps are at the input's
    // rate.
    let length = (DESIGN_DB - 7.95) / (14.36 * TRANSITION * lower);
    2 * (length / 2.0).ceil() as usize
}

/// Returns the taps for an output sample that lies a fraction `phase` of a sample after the newest input sample, less
/// the delay.
fn row(phase: f64, from_hz: u32, to_hz: u32) -> Vec<f32> {
    let lower = f64::from(from_hz.min(to_hz)) / f64::from(from_hz);
    let taps = taps(from_hz, to_hz);
    let half = taps as f64 / 2.0;
    // Kaiser's formula for attenuations above 50 dB.
    let beta = 0.1102 * (DESIGN_DB - 8.7);
    let tap = |age: usize| {
        let at = age as f64 + phase - half;
        let turns = 2.0 * CUT * lower * at;
        let sinc = if turns == 0.0 {
            1.0
        } else {
            (PI * turns).sin() / (PI * turns)
        };
        let inside = (1.0 - (at / half).powi(2)).max(0.0).sqrt();
        sinc * bessel(beta * inside)
    };
    let row: Vec<f64> = (0..taps).map(tap).collect();
    // Every row passes a constant unchanged, so that the phases do not modulate it.
    let sum: f64 = row.iter().sum();
    row.into_iter().map(|tap| (tap / sum) as f32).collect()
}

/// The modified Bessel function of the first kind and order 0, by its series.
fn bessel(at: f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 1.0;
    // From the 25th on, the terms are below a round-off for the arguments here, up to 8.5.
    for index in 1..64 {
        term *= (at / (2.0 * f64::from(index))).powi(2);
        sum += term;
    }
    sum
}

const fn greatest_divisor(mut one: u32, mut other: u32) -> u32 {
    while other != 0 {
        (one, other) = (other, one % other);
    }
    one
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Level of `samples` at `frequency_hz`, as the amplitude of a sine, with a window whose side lobes are below
    /// 120 dB.
    fn amplitude(samples: &[f64], frequency_hz: f64, rate_hz: f64) -> f64 {
        let count = samples.len() as f64;
        let half = count / 2.0;
        let beta = 0.1102 * (130.0 - 8.7);
        let (mut real, mut imaginary, mut weight) = (0.0, 0.0, 0.0);
        for (index, sample) in samples.iter().enumerate() {
            let at = (index as f64 + 0.5 - half) / half;
            let window = bessel(beta * (1.0 - at * at).max(0.0).sqrt());
            let (sine, cosine) = (2.0 * PI * frequency_hz * index as f64 / rate_hz).sin_cos();
            real += window * sample * cosine;
            imaginary += window * sample * sine;
            weight += window / 2.0;
        }
        real.hypot(imaginary) / weight
    }

    /// A sine of amplitude 1 at `frequency_hz`, from `from_hz` to `to_hz`.
    fn resampled(frequency_hz: f64, from_hz: u32, to_hz: u32, seconds: f64) -> Vec<f64> {
        let mut resampler = Resampler::new(from_hz, to_hz);
        let mut index = 0.0;
        let mut source = || {
            index += 1.0;
            (2.0 * PI * frequency_hz * (index - 1.0) / f64::from(from_hz)).sin() as f32
        };
        let count = (f64::from(to_hz) * seconds) as usize;
        let skipped = to_hz as usize / 20;
        let samples = (0..count + skipped).map(|_| f64::from(resampler.next(&mut source)));
        samples.skip(skipped).collect()
    }

    const TO_HZ: [u32; 10] = [
        5000, 8000, 10_000, 11_025, 16_000, 22_050, 44_100, 48_000, 96_000, 192_000,
    ];

    #[test]
    fn it_is_flat_to_a_tenth_of_a_decibel_up_to_2_khz() {
        for from_hz in [5000, 10_000] {
            for to_hz in TO_HZ.into_iter().filter(|to_hz| *to_hz != from_hz) {
                for frequency_hz in [250.0, 990.0, 1730.0, 2000.0] {
                    let samples = resampled(frequency_hz, from_hz, to_hz, 0.05);
                    let level = amplitude(&samples, frequency_hz, f64::from(to_hz));
                    let level_db = 20.0 * level.log10();
                    assert!(level_db.abs() < 0.1, "{from_hz} {to_hz} {frequency_hz}: {level_db}");
                }
            }
        }
    }

    /// Images lie around the multiples of the texture's rate. Content above half of a lower output rate returns as an
    /// alias.
    #[test]
    fn images_and_aliases_are_80_db_down_at_every_frequency() {
        for from_hz in [5000u32, 10_000] {
            for to_hz in TO_HZ.into_iter().filter(|to_hz| *to_hz != from_hz) {
                let lower = f64::from(from_hz.min(to_hz));
                for share in [0.002, 0.0513, 0.2, 0.33, 0.399, 0.43, 0.47, 0.499] {
                    let frequency_hz = share * f64::from(from_hz);
                    let samples = resampled(frequency_hz, from_hz, to_hz, 0.1);
                    let rate_hz = f64::from(to_hz);
                    let folded = |hz: f64| (hz - rate_hz * (hz / rate_hz).round()).abs();
                    let own_hz = folded(frequency_hz);
                    let images = (0..5).flat_map(|times| {
                        let multiple = f64::from(times) * f64::from(from_hz);
                        [multiple - frequency_hz, multiple + frequency_hz]
                    });
                    let unwanted = images.filter(|hz| hz.abs() >= lower / 2.0);
                    for image_hz in unwanted.map(folded) {
                        let is_own = frequency_hz < lower / 2.0 && (image_hz - own_hz).abs() < 200.0;
                        let level_db = 20.0 * amplitude(&samples, image_hz, rate_hz).log10();
                        assert!(
                            is_own || level_db < -80.0,
                            "{from_hz} {to_hz} {frequency_hz}: {level_db} dB at {image_hz}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn the_delay_is_the_one_that_is_stated_at_every_frequency() {
        for (from_hz, to_hz) in [(5000, 48_000), (10_000, 44_100), (10_000, 5000), (5000, 8000)] {
            for frequency_hz in [50.0, 700.0, 1900.0] {
                let samples = resampled(frequency_hz, from_hz, to_hz, 0.05);
                let begin = f64::from(to_hz / 20);
                let expected = |index: usize| {
                    let time_s = (begin + index as f64) / f64::from(to_hz);
                    let time_s = time_s - delay_s(from_hz, to_hz);
                    (2.0 * PI * frequency_hz * time_s).sin()
                };
                let errors = samples.iter().enumerate();
                let worst = errors.map(|(index, sample)| (sample - expected(index)).abs());
                let worst = worst.fold(0.0, f64::max);
                assert!(worst < 2e-4, "{from_hz} {to_hz} {frequency_hz}: {worst}");
            }
        }
    }

    #[test]
    fn it_takes_exactly_as_much_as_it_gives_and_repeats_itself_after_a_reset() {
        for to_hz in TO_HZ {
            let mut resampler = Resampler::new(5000, to_hz);
            let mut run = || {
                let mut taken = 0;
                let given: Vec<f32> = (0..to_hz)
                    .map(|_| {
                        resampler.next(|| {
                            taken += 1;
                            (taken % 7) as f32
                        })
                    })
                    .collect();
                resampler.reset();
                (taken, given)
            };
            let first = run();
            assert_eq!(first.0, 5000, "{to_hz}");
            assert_eq!(run(), first, "{to_hz}");
        }
    }
}
