//! What samples pass before they leave: the device's safety stages, as far as a computer can have them.
//!
//! ```text
//! kernel -> DC blocker -> interpolator -> gain -> thermal limiter -> limit -> slew limit -> caller
//! ```
//! Thermal and slew limit need a coil's values, by [`crate::Mover::set_coil`]. The coil is that of the device's
//! `safety/thermal.rs`: one thermal mass, whose gain falls from three quarters of its final warmth on.

use model_format::{OutputSample, PlayRate};
use stylus_kernel::dc_blocker::{ALPHA, ALPHA_OF_PAIR, DcBlocker};

/// Largest voltage, in units of the RMS voltage at the power limit. A Gaussian signal at the limit is cut at four times
/// its RMS, as on the device.
const PEAK: f64 = 4.0;

/// Largest slew, in units of the largest voltage per second: a sine at the power limit passes up to 1.1 kHz.
const SLEW_PER_S: f64 = 2500.0;

/// Thermal time constant of the coil, s: the device's default.
const TIME_CONSTANT_S: f64 = 10.0;

/// Warmth from which the thermal limiter attenuates, in units of that at the power limit. About a coil nothing is known
/// at first, so it is assumed to be as warm.
const KNEE: f64 = 0.75;

/// The DC blocker, whose tail fades where nothing is to be heard.
pub struct Blocker {
    filter: DcBlocker,
    is_muted: bool,
}

impl Blocker {
    pub const fn new() -> Self {
        Self {
            filter: DcBlocker::new(),
            is_muted: false,
        }
    }

    /// Subtracts the mean from `block`. Over the first block of those that are muted, the subtraction fades, so that
    /// the kernel's silence is the output's; over the first that is not, it returns. Meanwhile the mean stays, because
    /// its tail, which would balance what was heard, is not heard.
    pub fn process(&mut self, rate: PlayRate, block: &mut [OutputSample], is_muted: bool) {
        let [from, to] = [self.is_muted, is_muted].map(|is_muted| i64::from(!is_muted));
        let count = block.len() as i64;
        let before = self.filter;
        for (at, sample) in (1..).zip(block) {
            let input = i64::from(sample.0);
            let without = match rate {
                PlayRate::Hz5000 => self.filter.next::<ALPHA>(input),
                PlayRate::Hz10000 => self.filter.next::<ALPHA_OF_PAIR>(input),
            };
            let share = from * (count - at) + to * at;
            let output = input - (input - without) * share / count;
            sample.0 = output.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        }
        if is_muted {
            self.filter = before;
        }
        self.is_muted = is_muted;
    }
}

/// Values that the mover sets: a gain; a limit; and the mean square of the voltage at the coil's power limit, which is
/// infinite without a coil.
#[derive(Clone, Copy, PartialEq)]
pub struct Scale {
    pub gain: f32,
    pub limit: f32,
    pub mean_square: f32,
}

/// The stages from the gain on, at the output's rate.
///
/// They compute in double precision, which holds the way between any two gains of single precision, and the product of
/// any gain with a sample. So every output is a number within the limit.
pub struct Output {
    rate_hz: f64,
    gain: f64,
    /// Gain that is left to be added, sample by sample.
    ramp: (f64, u32),
    scale: Option<Scale>,
    limit: f64,
    slew: f64,
    /// Warmth per mean square.
    per_square: f64,
    /// Mean square of the output over the coil's time constant.
    mean_square: f64,
    last: f64,
}

impl Output {
    pub fn new(rate_hz: u32) -> Self {
        Self {
            rate_hz: rate_hz.into(),
            gain: 0.0,
            ramp: (0.0, 0),
            scale: None,
            limit: 0.0,
            slew: 0.0,
            per_square: 0.0,
            mean_square: 0.0,
            last: 0.0,
        }
    }

    /// Changes to `scale`: the gain over a block, or at once the first time, the rest at once.
    pub fn aim(&mut self, scale: Scale) {
        if self.scale == Some(scale) {
            return;
        }
        let before = self.scale.replace(scale);
        let gain = f64::from(scale.gain);
        if before.is_none_or(|before| before.gain != scale.gain) {
            // Nothing was heard before the first samples, so their gain needs no ramp.
            let samples = before.map_or(0, |_| (self.rate_hz / 500.0) as u32);
            self.ramp = ((gain - self.now()) / f64::from(samples.max(1)), samples);
            self.gain = gain;
        }
        let coil = f64::from(scale.mean_square);
        let peak = PEAK * coil.sqrt();
        // Whatever the gain, an amplifier gets no infinity.
        self.limit = f64::from(scale.limit.min(peak as f32).min(f32::MAX));
        self.slew = SLEW_PER_S * peak / self.rate_hz;
        self.per_square = 1.0 / coil;
        self.last = self.last.clamp(-self.limit, self.limit);
        let is_new = before.is_none_or(|before| before.mean_square.is_infinite());
        if is_new && coil.is_finite() {
            self.mean_square = self.mean_square.max(KNEE * coil);
        }
    }

    /// The present gain, counted back from the one that was set, which is reached exactly, whatever the round-off.
    fn now(&self) -> f64 {
        let (step, left) = self.ramp;
        self.gain - step * f64::from(left)
    }

    /// Returns the output for `sample`, m/s².
    pub fn next(&mut self, sample: f32) -> f32 {
        self.ramp.1 = self.ramp.1.saturating_sub(1);
        let warmth = self.mean_square * self.per_square;
        let cooled = ((1.0 - warmth) / (1.0 - KNEE)).clamp(0.0, 1.0);
        let wanted = f64::from(sample) * self.now() * cooled;
        let limited = wanted.clamp(-self.limit, self.limit);
        self.last = limited.clamp(self.last - self.slew, self.last + self.slew);
        self.mean_square += (self.last * self.last - self.mean_square) / (TIME_CONSTANT_S * self.rate_hz);
        self.last as f32
    }
}
