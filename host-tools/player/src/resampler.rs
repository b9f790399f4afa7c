//! Resampling from the rate of a texture to any rate of a sound card, by a polyphase filter.
//!
//! The filter has the gain of a sinc with a Kaiser window: flat to 0.4 of the lower of the two rates, and 80 dB down
//! from half of it on (J. F. Kaiser, 1974). It has minimum phase, for a short delay, by the cepstrum of that gain
//! (A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, chapter 12). Each phase has its own row of
//! taps, so that an output sample is one scalar product.

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Attenuation that the window is designed for, dB: 80 and a margin for normalised rows and `f32`.
const DESIGN_DB: f64 = 86.0;

/// Width of the transition, as a fraction of the lower rate.
const TRANSITION: f64 = 0.1;

/// Middle of the transition, as a fraction of the lower rate.
const CUT: f64 = 0.45;

/// Band that passes, as a fraction of the lower rate.
const BAND: f64 = CUT - TRANSITION / 2.0;

/// Length of the filter, in samples of the lower rate, by Kaiser's estimate.
const LENGTH: usize = 2 * ((DESIGN_DB - 7.95) / (14.36 * TRANSITION) / 2.0).ceil() as usize;

/// Points of the prototype per sample of the lower rate.
const POINTS: usize = 8;

/// Frequencies at which the prototype's gain is taken. With so many, what folds over in the cepstrum changes the stop
/// band by less than 0.3 dB.
const FREQUENCIES: usize = 4096;

/// Impulse response that all filters are made of.
static PROTOTYPE: LazyLock<Vec<f64>> = LazyLock::new(minimum_phase);

/// A filter from one rate to another.
pub struct Filter {
    /// Taps of each phase, from the newest sample on.
    pub rows: Vec<f32>,
    /// Taps of a row.
    pub taps: usize,
    /// Phases per input sample.
    pub phases: usize,
    /// Phases per output sample.
    pub step: usize,
}

impl Filter {
    /// A filter from `from_hz` to `to_hz`, both above 0.
    pub fn new(from_hz: u32, to_hz: u32) -> Self {
        // Without the common divisor, 5000 to 48 000 Hz would have 48 000 phases in place of 48.
        let divisor = greatest_divisor(from_hz, to_hz);
        let (phases, step) = ((to_hz / divisor) as usize, (from_hz / divisor) as usize);
        // The transition is a fraction of the lower rate; taps are at the input's.
        let scale = f64::from(from_hz.min(to_hz)) / f64::from(from_hz);
        let taps = (LENGTH as f64 / scale).ceil() as usize;
        let rows = (0..phases).flat_map(|phase| row(phase as f64 / phases as f64, taps, scale));
        Self {
            rows: rows.collect(),
            taps,
            phases,
            step,
        }
    }
}

/// Delay of low frequencies, s. High ones come later: of a texture at 5 kHz, 1 kHz by 0.1 ms and 2 kHz by 1.2 ms.
pub fn delay_s(from_hz: u32, to_hz: u32) -> f64 {
    let weighted = PROTOTYPE.iter().enumerate().map(|(at, value)| at as f64 * value);
    let delay = weighted.sum::<f64>() / PROTOTYPE.iter().sum::<f64>() / POINTS as f64;
    delay / f64::from(from_hz.min(to_hz))
}

/// Band that passes within 0.1 dB, Hz, in which images and aliases are 80 dB down.
pub fn band_hz(from_hz: u32, to_hz: u32) -> f64 {
    BAND * f64::from(from_hz.min(to_hz))
}

/// An interpolator, with the samples that it still needs.
pub struct Resampler {
    filter: Filter,
    /// Phase of the next output sample, and number of input samples to take before it.
    phase: usize,
    missing: usize,
    /// The last samples, stored twice, so that any run of taps from the newest on is contiguous.
    past: Vec<f32>,
    newest: usize,
}

impl Resampler {
    /// Creates an interpolator from `from_hz` to `to_hz`, preceded by silence.
    pub fn new(from_hz: u32, to_hz: u32) -> Self {
        let filter = Filter::new(from_hz, to_hz);
        Self {
            phase: 0,
            missing: 1,
            past: vec![0.0; 2 * filter.taps],
            newest: 0,
            filter,
        }
    }

    /// Number of input samples after which an earlier one has no effect any more.
    pub fn memory(&self) -> u32 {
        self.filter.taps as u32
    }

    /// Forgets the input samples.
    pub fn reset(&mut self) {
        self.past.fill(0.0);
        (self.phase, self.missing) = (0, 1);
    }

    /// Returns the next sample, and takes the input samples that it needs from `source`.
    pub fn next(&mut self, mut source: impl FnMut() -> f32) -> f32 {
        let taps = self.filter.taps;
        for _ in 0..self.missing {
            self.newest = self.newest.checked_sub(1).unwrap_or(taps - 1);
            let sample = source();
            self.past[self.newest] = sample;
            self.past[self.newest + taps] = sample;
        }
        // Both run from the newest sample on, so the product needs no wrap.
        let row = &self.filter.rows[self.phase * taps..][..taps];
        let past = &self.past[self.newest..][..taps];
        self.phase += self.filter.step;
        (self.missing, self.phase) = (self.phase / self.filter.phases, self.phase % self.filter.phases);
        row.iter().zip(past).map(|(tap, sample)| tap * sample).sum()
    }
}

/// Returns the taps for an output sample that lies a fraction `phase` of an input sample after the newest one. An input
/// sample is `scale` of a sample of the lower rate.
fn row(phase: f64, taps: usize, scale: f64) -> Vec<f32> {
    let row = (0..taps).map(|age| prototype_at((age as f64 + phase) * scale));
    let row: Vec<f64> = row.collect();
    // Every row passes a constant unchanged, so that the phases do not modulate it.
    let sum: f64 = row.iter().sum();
    row.into_iter().map(|tap| (tap / sum) as f32).collect()
}

/// The prototype at `time`, in samples of the lower rate, by the polynomial through the six points around it.
fn prototype_at(time: f64) -> f64 {
    let at = time * POINTS as f64;
    let share = at.fract();
    let points = (-2..=3).map(|point: i32| {
        let index = (at as usize).checked_add_signed(point as isize);
        let value = index.and_then(|index| PROTOTYPE.get(index)).unwrap_or(&0.0);
        let others = (-2..=3).filter(|other| *other != point).map(f64::from);
        let weight: f64 = others
            .map(|other| (share - other) / (f64::from(point) - other))
            .product();
        value * weight
    });
    points.sum()
}

/// The impulse response of minimum phase with the gain of the windowed sinc.
fn minimum_phase() -> Vec<f64> {
    let half = LENGTH * POINTS / 2;
    // Kaiser's formula for attenuations above 50 dB.
    let beta = 0.1102 * (DESIGN_DB - 8.7);
    let sinc = |at: usize| {
        let turns = PI * 2.0 * CUT * at as f64 / POINTS as f64;
        let sinc = if at == 0 { 1.0 } else { turns.sin() / turns };
        sinc * bessel(beta * (1.0 - (at as f64 / half as f64).powi(2)).sqrt())
    };
    // Symmetric, like its spectrum and its cepstrum, so that a half and sums of cosines suffice.
    let linear: Vec<f64> = (0..=half).map(sinc).collect();
    let turn = |at: usize| 2.0 * PI * at as f64 / FREQUENCIES as f64;
    let cosines: Vec<f64> = (0..FREQUENCIES).map(|at| turn(at).cos()).collect();
    let transformed = |values: &[f64], at: usize| {
        let terms = values.iter().enumerate().skip(1);
        let terms = terms.map(|(index, value)| value * cosines[index * at % FREQUENCIES]);
        values[0] + 2.0 * terms.sum::<f64>()
    };
    // The logarithm of a gain that is zero by chance is none.
    let gain = |at| transformed(&linear, at).abs().max(1e-9);
    let mut logarithms: Vec<f64> = (0..=FREQUENCIES / 2).map(|at| gain(at).ln()).collect();
    // The highest frequency is the one that is there once.
    logarithms[FREQUENCIES / 2] /= 2.0;
    let cepstrum = (0..=2 * half).map(|at| transformed(&logarithms, at) / FREQUENCIES as f64);
    let cepstrum: Vec<f64> = cepstrum.collect();
    // The exponential of the causal cepstrum, whose values after the first are twice the others: by its derivative.
    let mut response = vec![cepstrum[0].exp()];
    for at in 1..=2 * half {
        let terms = (1..=at).map(|before| 2.0 * before as f64 * cepstrum[before] * response[at - before]);
        let sum: f64 = terms.sum();
        response.push(sum / at as f64);
    }
    response
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
        let skipped = to_hz as usize / 10;
        let samples = (0..count + skipped).map(|_| f64::from(resampler.next(&mut source)));
        samples.skip(skipped).collect()
    }

    const TO_HZ: [u32; 12] = [
        1000, 2500, 5000, 8000, 10_000, 11_025, 16_000, 22_050, 44_100, 48_000, 96_000, 192_000,
    ];

    #[test]
    fn it_is_flat_to_a_tenth_of_a_decibel_in_the_band_that_it_states() {
        for from_hz in [5000, 10_000] {
            for to_hz in TO_HZ.into_iter().filter(|to_hz| *to_hz != from_hz) {
                let band_hz = band_hz(from_hz, to_hz);
                assert!(band_hz >= f64::from(to_hz.min(5000)) * 0.4 - 1e-9);
                for share in [0.25, 0.5, 0.865, 1.0] {
                    let frequency_hz = share * band_hz;
                    let seconds = 250.0 / f64::from(to_hz.min(5000));
                    let samples = resampled(frequency_hz, from_hz, to_hz, seconds);
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
    fn the_delay_of_a_texture_at_5_khz_is_that_of_minimum_phase_at_every_frequency() {
        let filter = Filter::new(5000, 48_000);
        let times_s = (0..filter.rows.len()).map(|at| {
            let (phase, age) = (at / filter.taps, at % filter.taps);
            (age as f64 + phase as f64 / filter.phases as f64) / 5000.0
        });
        let taps: Vec<(f64, f64)> = times_s.zip(filter.rows.iter().copied().map(f64::from)).collect();
        for (frequency_hz, most_ms) in [(200.0, 0.54), (1000.0, 0.64), (1500.0, 0.85), (2000.0, 1.7)] {
            // The group delay: the real part of the spectrum of the response times its time over that of the response.
            let [mut plain, mut timed] = [(0.0, 0.0); 2];
            for (time_s, tap) in &taps {
                let (sine, cosine) = (2.0 * PI * frequency_hz * time_s).sin_cos();
                plain = (plain.0 + tap * cosine, plain.1 - tap * sine);
                timed = (timed.0 + time_s * tap * cosine, timed.1 - time_s * tap * sine);
            }
            let power = plain.0 * plain.0 + plain.1 * plain.1;
            let delay_ms = 1e3 * (timed.0 * plain.0 + timed.1 * plain.1) / power;
            assert!(
                delay_ms > 0.0 && delay_ms <= most_ms,
                "{frequency_hz} Hz: {delay_ms} ms"
            );
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
            // Up to the time of its last output.
            assert_eq!(first.0, 5000 * (to_hz - 1) / to_hz + 1, "{to_hz}");
            assert_eq!(run(), first, "{to_hz}");
        }
    }
}
