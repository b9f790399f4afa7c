//! A synthesis structure of one's own beside the lattice, by the kernel's public interface: the
//! coupled form of a resonator (Gold and Rader, *Effects of parameter quantization on the poles of a digital
//! filter*, 1967), for textures of two stages with a pair of complex poles.
//!
//! ```text
//! x[n+1] = c x[n] - s y[n] + g e[n]      c = -a₁/2, s = √(a₂ - a₁²/4): the poles are c ± i s
//! y[n+1] = s x[n] + c y[n]               1/A(z) = 1/(1 + a₁ z⁻¹ + a₂ z⁻²) is y over g s e, one sample later
//! ```
//! A step is a rotation times the poles' radius, which is below 1. So the state's norm cannot grow however the
//! coefficients change, and products that are truncated toward zero let it come to exact silence.
//!
//! A structure takes from the kernel, in the order of use: the place of a motion on the grid
//! ([`GridPoint`]), the mean of the nodes' angles θ = arcsin k, the level's law and its ramp ([`rms_at`], [`Ramp`]) and
//! the noise ([`Excitation`]). The kernel's README says what else a structure takes that is to be shipped.
//!
//!     cargo run --locked -p stylus-kernel --example custom_structure

use model_format::{
    CodeSpec, DecodeError, Library, MillimetresPerSecond, Newton, NodeSpec, OutputSample,
    SAMPLE_RATE_HZ, Texture, TextureSpec, encode,
};
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::level::{Ramp, rms_at};
use stylus_kernel::rotation::Rotation;
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

/// Binary digits after the point of coefficients.
const COEFFICIENT_BITS: u32 = 30;
/// Binary digits after the point of signals: a standard deviation of the output is 2²⁴, full scale is 128 of them.
const SIGNAL_BITS: u32 = 24;
/// Binary digits after the point of a level, in m/s².
const GAIN_BITS: u32 = 23;

/// Coefficients and level of a motion. Made below the sample's priority, once per update interval.
#[derive(Clone, Debug)]
pub struct CoupledFrame {
    cos: i32,
    sin: i32,
    /// Factor of the excitation that gives the output unit variance.
    drive: i32,
    gain: Ramp,
}

impl CoupledFrame {
    /// A frame that plays nothing.
    pub fn silent() -> Self {
        Self {
            cos: 0,
            sin: 0,
            drive: 0,
            gain: Ramp::new(),
        }
    }

    /// Makes this the frame of `motion` on `texture`, a lattice of two stages. The level goes from its value with
    /// `left` samples of the ramp before to come to the new one in `samples` samples. Returns false, and is silent, at
    /// a motion whose poles are real.
    pub fn update(
        &mut self,
        texture: &Texture<'_>,
        motion: Motion,
        left: u32,
        samples: u32,
    ) -> bool {
        let point = GridPoint::locate(texture, motion);
        // θ of a stage is an integer below 2²⁴, which a float holds; a stage that a node lacks is 0.
        let theta = |stage| {
            point.mean(|speed, force| {
                let node = texture.node(speed, force);
                node.coefficients.thetas().nth(stage).unwrap_or(0) as f32
            })
        };
        let unit = |word: i32| f64::from(word) / f64::from(1u32 << 31);
        let [first, second] = [0, 1].map(|stage| Rotation::from_theta(theta(stage) as i32));
        let (k1, k2) = (unit(first.sin), unit(second.sin));
        let (a1, a2) = (k1 * (1.0 + k2), k2);
        let squared = a2 - a1 * a1 / 4.0;
        let from = self.gain.value(left);
        if squared <= 0.0 {
            self.gain = Ramp::between(from, 0, samples);
            return false;
        }
        let fixed = |value: f64| (value * f64::from(1u32 << COEFFICIENT_BITS)) as i32;
        let sin = squared.sqrt();
        (self.cos, self.sin) = (fixed(-a1 / 2.0), fixed(sin));
        // 1/A has the power gain 1/((1 - k₁²)(1 - k₂²)). The cast saturates where the poles are next to real.
        self.drive = fixed(unit(first.cos) * unit(second.cos) / sin);
        let power = |speed, force| texture.node(speed, force).output_power;
        let rms = rms_at(&point, texture.level_law(), GAIN_BITS, power);
        let level = (u64::from(rms) * u64::from(point.fade) / u64::from(ONE)) as u32;
        self.gain = Ramp::between(from, level, samples);
        true
    }
}

/// The two signals of a resonator.
#[derive(Clone, Debug, Default)]
pub struct CoupledState {
    x: i32,
    y: i32,
}

impl CoupledState {
    /// The next sample, by `frame` with `left` samples of its ramp to come. Its path does not depend on the signal.
    pub fn next_sample(&mut self, frame: &CoupledFrame, noise: i32, left: u32) -> OutputSample {
        let [x, y, cos, sin] = [self.x, self.y, frame.cos, frame.sin].map(i64::from);
        let drive = i64::from(noise >> (excitation::FRACTION_BITS - SIGNAL_BITS));
        let driven = toward_zero(drive * i64::from(frame.drive), COEFFICIENT_BITS);
        let turned = toward_zero(cos * x - sin * y, COEFFICIENT_BITS);
        self.x = saturated(turned + driven);
        self.y = saturated(toward_zero(sin * x + cos * y, COEFFICIENT_BITS));
        let level = i64::from(frame.gain.value(left));
        let shift = SIGNAL_BITS + GAIN_BITS - OutputSample::FRACTION_BITS;
        OutputSample(saturated(toward_zero(i64::from(self.y) * level, shift)))
    }

    /// The state's norm, in standard deviations of the output.
    pub fn norm(&self) -> f64 {
        f64::from(self.x).hypot(f64::from(self.y)) / f64::from(1u32 << SIGNAL_BITS)
    }
}

fn toward_zero(product: i64, bits: u32) -> i64 {
    product / (1 << bits)
}

fn saturated(value: i64) -> i32 {
    value.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}

/// Plays `texture` along `motion`, which is asked once per update interval, for so many samples.
pub fn play(
    texture: &Texture<'_>,
    seed: u64,
    motion: impl Fn(usize) -> Motion,
    samples: usize,
) -> Vec<OutputSample> {
    let mut noise = Excitation::new(seed);
    let (mut frame, mut state) = (CoupledFrame::silent(), CoupledState::default());
    let mut output = Vec::with_capacity(samples);
    while output.len() < samples {
        frame.update(texture, motion(output.len()), 0, UPDATE_INTERVAL_SAMPLES);
        for left in (0..UPDATE_INTERVAL_SAMPLES).rev() {
            output.push(state.next_sample(&frame, noise.next_sample(), left));
        }
    }
    output.truncate(samples);
    output
}

/// A library with one texture of two speeds, whose resonance rises from 300 to 500 Hz.
///
/// # Errors
/// Values that a library cannot hold.
pub fn library() -> Result<Vec<u8>, DecodeError> {
    // k₁ = -cos φ · 2r/(1 + r²) and k₂ = r² for poles of radius r at ±φ.
    let node = |hertz: f64, power: f32| {
        let (radius, phi) = (
            0.95f64,
            std::f64::consts::TAU * hertz / f64::from(SAMPLE_RATE_HZ),
        );
        let k = [
            -phi.cos() * 2.0 * radius / (1.0 + radius * radius),
            radius * radius,
        ];
        let code = |k: f64| (k.asin() / std::f64::consts::FRAC_PI_2 * 32_768.0).round() as i16;
        NodeSpec::new(power, CodeSpec::lattice(k.map(code).to_vec()))
    };
    let nodes = vec![node(300.0, 1.0), node(500.0, 9.0)];
    encode(&[TextureSpec::new("bell", &[50.0, 150.0], &[1.0], nodes)])
}

/// Root mean square of `samples`, m/s².
pub fn rms(samples: &[OutputSample]) -> f64 {
    let square = |sample: &OutputSample| f64::from(sample.metres_per_second_squared().0).powi(2);
    (samples.iter().map(square).sum::<f64>() / samples.len() as f64).sqrt()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let bytes = library()?;
    let texture = Library::decode(&bytes)?.texture("bell");
    let texture = texture.ok_or("it was just written")?;
    for speed in [50.0, 100.0, 150.0] {
        let motion = Motion::new(MillimetresPerSecond(speed), Newton(1.0));
        let motion = motion.map_err(|error| error.to_string())?;
        let own = play(&texture, 1, |_| motion, 50_000);
        let lattice = by_the_lattice(&bytes, motion, 50_000)?;
        println!(
            "{speed:>4} mm/s: {:.3} m/s² RMS by the coupled form, {:.3} by the lattice",
            rms(&own),
            rms(&lattice)
        );
    }
    Ok(())
}

/// The same texture by the kernel's own lattice.
fn by_the_lattice(
    library: &[u8],
    motion: Motion,
    samples: usize,
) -> Result<Vec<OutputSample>, DecodeError> {
    let library = Library::decode(library)?;
    let mut output = vec![OutputSample::SILENCE; samples];
    if let Some(texture) = library.texture_at(0) {
        let mut synthesis: Synthesis = Synthesis::new(texture, 1);
        for block in output.chunks_mut(UPDATE_INTERVAL_SAMPLES as usize) {
            synthesis.follow(motion, UPDATE_INTERVAL_SAMPLES);
            synthesis.next_block(block);
        }
    }
    Ok(output)
}
