//! Codes at the stylus's pin, compared with a second computation in floating point that shares no code with the device.

use std::sync::LazyLock;

use crate::support::{Bench, RATE_HZ, decibels, holds, near, noise};
use host_tools::dsp::fourier;
use host_tools::dsp::sums;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::pin::{Pin, RATE_HZ as PIN_HZ, settings};
use host_tools::playing::render::render;
use model_format::{
    CodeSpec, Library, MillimetresPerSecond, Newton, NodeFlags, NodeSpec, OutputSample, PlayRate, TextureSpec, encode,
};

/// Output gain of the settings used here, V per m/s². It is the default.
const GAIN: f64 = 0.01;

/// Voltage of one step of the converter.
const STEP_V: f64 = 3.3 / 4096.0;

/// Number of the kernel's samples that are judged: 6.6 s.
const JUDGED: usize = 1 << 15;

/// Number of samples before those. They contain the soft start and the settling of the DC blocker.
const BEFORE: usize = 5_000;

/// Taps of the three filters from 5 to 40 kHz, in units of 2^-31. `safety/interpolator.rs` describes their design.
const FILTERS: [&[i64]; 3] = [
    &[
        208_552_727,
        896_268_715,
        1_802_854_731,
        1_916_999_587,
        681_042_604,
        -837_525_615,
        -1_007_227_649,
        97_304_816,
        775_180_686,
        215_003_834,
        -488_116_274,
        -291_096_170,
        272_111_097,
        272_805_815,
        -122_480_078,
        -218_022_724,
        16_628_125,
        137_130_407,
        34_842_437,
        -52_521_828,
        -35_773_952,
        1_269_593,
    ],
    &[
        151_918_481,
        687_057_783,
        1_308_507_385,
        1_308_507_385,
        687_057_783,
        151_918_481,
    ],
    &[275_148_215, 1_073_659_436, 1_597_351_995, 1_073_659_436, 275_148_215],
];

/// The signal at twice its rate, through a filter that starts at rest.
fn doubled(signal: &[f64], taps: &[i64]) -> Vec<f64> {
    let value = |index: usize| {
        taps.iter()
            .enumerate()
            .take(index + 1)
            .filter(|(k, _)| (index - k).is_multiple_of(2))
            .map(|(k, &tap)| tap as f64 / 2f64.powi(31) * signal[(index - k) / 2])
            .sum()
    };
    (0..2 * signal.len()).map(value).collect()
}

/// The kernel's samples in converter steps, without their slowly varying mean.
fn without_mean(samples: &[OutputSample]) -> Vec<f64> {
    let mut mean = 0.0;
    let without = |steps: f64| {
        mean += 82.0 / 32_768.0 * (steps - mean);
        steps - mean
    };
    in_steps(samples).into_iter().map(without).collect()
}

/// The kernel's samples in converter steps.
fn in_steps(samples: &[OutputSample]) -> Vec<f64> {
    let steps = |sample: &OutputSample| f64::from(sample.0) / 2f64.powi(20) * GAIN / STEP_V;
    samples.iter().map(steps).collect()
}

/// The codes that a stylus puts out, in steps above mid-scale.
fn at_the_pin(samples: &[OutputSample]) -> Vec<f64> {
    let settings = settings([("soft-start", 1.0), ("power-limit", 1.0)]).unwrap();
    let mut pin = Pin::new(samples.iter().copied(), PlayRate::Hz5000, &settings);
    let codes = pin.by_ref().map(|code| f64::from(code.get()) - 2048.0).collect();
    assert_eq!(pin.limited(), host_tools::playing::pin::Limited::default());
    codes
}

/// Power per frequency bin of the last [`JUDGED`] samples, or of the codes that belong to them, with a Hann window.
struct Bins {
    powers: Vec<f64>,
    bin_hz: f64,
}

impl Bins {
    fn of(signal: &[f64], rate_hz: u32) -> Self {
        let length = JUDGED * (rate_hz / RATE_HZ) as usize;
        let mut windowed: Vec<f64> = signal[signal.len() - length..].to_vec();
        for (n, value) in windowed.iter_mut().enumerate() {
            let turn = core::f64::consts::TAU * n as f64 / length as f64;
            *value *= (1.0 - turn.cos()) / 1.5f64.sqrt();
        }
        let spectrum = fourier::forward(&mut windowed);
        let scale = 2.0 / (length as f64).powi(2);
        Self {
            powers: spectrum.iter().map(|bin| bin.norm_sqr() * scale).collect(),
            bin_hz: f64::from(rate_hz) / length as f64,
        }
    }

    /// Power from `low_hz` to `high_hz`.
    fn power(&self, low_hz: f64, high_hz: f64) -> f64 {
        let bin = |hertz: f64| (hertz / self.bin_hz).round() as usize;
        let bins = bin(low_hz)..=bin(high_hz).min(self.powers.len() - 1);
        self.powers[bins].iter().sum()
    }
}

fn felt(signal: &[f64], rate_hz: u32) -> f64 {
    Bins::of(signal, rate_hz).power(20.0, 1000.0)
}

/// Samples scaled so that their RMS from 20 to 1000 Hz is `rms`.
fn levelled(signal: &[f64], rms: f64) -> Vec<OutputSample> {
    let scale = rms / felt(signal, RATE_HZ).sqrt() * 2f64.powi(20);
    signal
        .iter()
        .map(|value| OutputSample((value * scale) as i32))
        .collect()
}

/// Noise that the kernel plays through a lattice with these reflection coefficients.
fn texture(reflection: &[f64]) -> Vec<f64> {
    let codes = reflection.iter().map(|k| (k * 32_768.0) as i16).collect();
    let node = NodeSpec {
        output_power: 4.0,
        prediction_error_power: 4.0 * reflection.iter().map(|k| 1.0 - k * k).product::<f64>() as f32,
        flags: NodeFlags::NONE,
        codes: CodeSpec::lattice(codes),
    };
    let bytes = encode(&[TextureSpec {
        sample_rate_hz: RATE_HZ,
        ..TextureSpec::new("texture", &[100.0], &[1.0], vec![node])
    }])
    .unwrap();
    let library = Library::decode(&bytes).unwrap();
    let motion = MotionPath::constant(MillimetresPerSecond(100.0), Newton(1.0)).unwrap();
    let seconds = (BEFORE + JUDGED) as f64 / f64::from(RATE_HZ);
    render(library.texture("texture").unwrap(), &motion, seconds, 5)
        .unwrap()
        .accelerations_m_s2()
}

/// White noise, and textures: one that falls by 12 dB per octave from 110 Hz, one with a resonance at 300 Hz.
static SIGNALS: LazyLock<[(&'static str, Vec<f64>); 3]> = LazyLock::new(|| {
    let falling = 0.87f64;
    let (radius, angle) = (0.98f64, core::f64::consts::TAU * 300.0 / f64::from(RATE_HZ));
    // Reflection coefficients of 1 + a z^-1 + b z^-2, for poles inside the unit circle.
    let two = |a: f64, b: f64| [a / (1.0 + b), b];
    [
        ("white", noise(11, BEFORE + JUDGED)),
        ("falling", texture(&two(-2.0 * falling, falling * falling))),
        ("resonant", texture(&two(-2.0 * radius * angle.cos(), radius * radius))),
    ]
});

#[test]
fn the_noise_in_the_band_that_is_felt_is_70_decibels_down_at_1_and_50_at_a_tenth() {
    for (name, signal) in SIGNALS.iter() {
        for (rms, least) in [(1.0, 70.0), (0.1, 50.0), (0.02, 36.0)] {
            let samples = levelled(signal, rms);
            let exact = FILTERS
                .iter()
                .fold(without_mean(&samples), |signal, taps| doubled(&signal, taps));
            let pin = at_the_pin(&samples);
            let errors: Vec<f64> = pin.iter().zip(&exact).map(|(pin, exact)| pin - exact).collect();
            let ratio = decibels(felt(&exact, PIN_HZ) / felt(&errors, PIN_HZ));
            assert!(ratio >= least, "{name}, {rms} m/s²: {ratio} dB");
        }
    }
}

#[test]
fn third_octaves_at_the_pin_are_those_of_the_kernel_down_to_a_fiftieth() {
    for (name, signal) in SIGNALS.iter() {
        for rms in [1.0, 0.1, 0.02] {
            let samples = levelled(signal, rms);
            let kernel = Bins::of(&in_steps(&samples), RATE_HZ);
            let pin = Bins::of(&at_the_pin(&samples), PIN_HZ);
            // These are the bands from 25 to 1000 Hz.
            for band in 14..=30 {
                let [low, high] = [-0.5, 0.5].map(|half| 10f64.powf((f64::from(band) + half) / 10.0));
                let of = |bins: &Bins| decibels(bins.power(low, high) / kernel.power(low, high));
                let apart = of(&pin);
                assert!(apart.abs() < 0.3, "{name}, {rms}, {low:.0} Hz: {apart}");
            }
        }
    }
}

#[test]
fn the_commands_write_the_pin_in_volts_and_say_so() {
    let bench = crate::support::two_textures(|signal| [crate::support::scaled(signal, 3.0)]);
    bench.succeed("fit set --out cloths.lib");
    let render = "render cloths.lib --texture felt --speed 90 --force 0.7 --seconds 1";
    let told = bench.succeed(&format!("{render} --out pin.wav --pin --set soft-start=1"));
    holds(&told, &["40000 codes", "volts above mid-scale"]);
    let twice = "--pin --set soft-start=1 --set output-gain=0.02";
    bench.succeed(&format!("{render} --out louder.wav {twice}"));
    bench.succeed(&format!("{render} --out kernel.wav"));
    let kernel = rms(&bench, "kernel.wav", RATE_HZ);
    let [pin, louder] = ["pin.wav", "louder.wav"].map(|name| rms(&bench, name, PIN_HZ));
    near(pin / (kernel * GAIN), 1.0, 0.1);
    near(louder / pin, 2.0, 0.1);

    // A scene of one texture puts out the same as the texture.
    let scene = "name = \"steady\"\n[[surface]]\ntexture = \"felt\"\n";
    bench.write("steady.toml", scene);
    let render_scene = "scene render steady.toml --library cloths.lib --speed 90 --force 0.7";
    let told = bench.succeed(&format!("{render_scene} --seconds 1 {twice} --out scene.wav"));
    holds(&told, &["40000 codes"]);
    assert!(bench.read("louder.wav") == bench.read("scene.wav"));
}

/// RMS of the second half of a file.
fn rms(bench: &Bench, name: &str, rate_hz: u32) -> f64 {
    let samples = bench.samples(name, rate_hz);
    let half = &samples[samples.len() / 2..];
    sums::rms(half)
}
