//! Output at the stylus's pin, and at the tip of an actuator model behind it: a rendering that passes through the
//! device's own safety stages, code by code.

use std::path::Path;

use model_format::link::{Setting, SettingChange, Settings};
use model_format::{DacCode, OutputSample, PlayRate, Volt};
use stylus_app::safety::{Config, OVERSAMPLING, PIN_RATE_HZ, State};
use stylus_plant::Plant;
use stylus_support::{Error, Result};

use super::render::{Rendering, write_floats_wav};

/// Number of DAC codes per second at the pin.
pub const RATE_HZ: u32 = PIN_RATE_HZ;

/// Returns the default settings with `changes`, each of which is a setting's name and its value.
pub fn settings<'a>(changes: impl IntoIterator<Item = (&'a str, f32)>) -> Result<Settings> {
    let change = |settings: Settings, (name, value)| {
        let setting = Setting::named(name).ok_or_else(|| Error::Request(format!("there is no setting '{name}'")))?;
        settings
            .with(SettingChange { setting, value })
            .map_err(|refused| Error::Request(refused.to_string()))
    };
    changes.into_iter().try_fold(Settings::default(), change)
}

/// Iterator over the DAC codes that a stylus puts out for the samples of its kernel, [`OVERSAMPLING`] for each tick. At
/// 10 kHz, a tick has two samples; if the second is missing at the end, it is silence.
///
/// The stylus starts at rest and is not muted, so it first performs its soft start. It plays at a gain of one.
#[derive(Clone, Debug)]
pub struct Pin<Samples> {
    samples: Samples,
    config: Config,
    state: State,
    codes: [DacCode; OVERSAMPLING],
    /// Number of `codes` that were returned.
    taken: usize,
}

impl<Samples: Iterator<Item = OutputSample>> Pin<Samples> {
    /// Creates the pin of a stylus with `settings` that plays `samples` at `rate`.
    pub fn new(samples: Samples, rate: PlayRate, settings: &Settings) -> Self {
        let config = Config::at_rate(settings, 1.0, rate);
        Self {
            samples,
            config,
            state: State::new(&config),
            codes: [DacCode::MID_SCALE; OVERSAMPLING],
            // No code is left, so the first call runs a tick.
            taken: OVERSAMPLING,
        }
    }

    /// Returns the numbers of ticks so far at which the hard limit, the slew limit and the thermal limiter changed the
    /// output.
    pub fn limited(&self) -> Limited {
        let counters = self.state.counters();
        Limited {
            hard: counters.hard_limited,
            slew: counters.slew_limited,
            thermal: counters.thermally_limited,
        }
    }
}

impl<Samples: Iterator<Item = OutputSample>> Iterator for Pin<Samples> {
    type Item = DacCode;

    fn next(&mut self) -> Option<DacCode> {
        if self.taken == OVERSAMPLING {
            let first = self.samples.next()?;
            self.codes = match self.config.rate() {
                PlayRate::Hz5000 => self.state.process(&self.config, first, false),
                PlayRate::Hz10000 => {
                    let pair = [first, self.samples.next().unwrap_or_default()];
                    self.state.process_pair(&self.config, pair, false)
                }
            };
            self.taken = 0;
        }
        self.taken += 1;
        Some(self.codes[self.taken - 1])
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let held = OVERSAMPLING - self.taken;
        let (low, high) = self.samples.size_hint();
        let per_tick = self.config.rate().samples_per_tick() as usize;
        let codes = |samples: usize| samples.div_ceil(per_tick) * OVERSAMPLING + held;
        (codes(low), high.map(codes))
    }
}

impl<Samples: ExactSizeIterator<Item = OutputSample>> ExactSizeIterator for Pin<Samples> {}

/// Numbers of ticks at which a safety stage changed the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limited {
    /// By the hard limit on the voltage or on the coil's peak power.
    pub hard: u32,
    /// By the slew limit.
    pub slew: u32,
    /// By the thermal limiter.
    pub thermal: u32,
}

/// Returns the voltage of a code relative to mid-scale.
pub fn above_mid_scale(code: DacCode) -> Volt {
    Volt((f32::from(code.get()) - f32::from(DacCode::MID_SCALE.get())) * DacCode::STEP.0)
}

/// Summary of a rendering at the pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinSummary {
    /// Number of codes in the file.
    pub codes: u64,
    /// Number of samples at the kernel's full scale.
    pub saturations: u32,
    /// Numbers of ticks at which a safety stage changed the output.
    pub limited: Limited,
}

/// Writes what a stylus with `settings` puts out for `rendering` as a WAV file: 32-bit floating point, in volts
/// relative to mid-scale, [`RATE_HZ`] codes per second.
pub fn render_pin_wav(rendering: &mut Rendering<'_>, settings: &Settings, path: &Path) -> Result<PinSummary> {
    render_codes(rendering, settings, path, |Volt(volt)| volt)
}

/// Writes the acceleration of the tip of `plant`, in m/s² after each code, that the codes of [`render_pin_wav`] cause.
/// The amplifier is on.
pub fn render_tip_wav(
    rendering: &mut Rendering<'_>,
    settings: &Settings,
    plant: &mut Plant,
    path: &Path,
) -> Result<PinSummary> {
    render_codes(rendering, settings, path, |Volt(volt)| {
        plant.step(volt.into(), true);
        plant.tip_m_s2() as f32
    })
}

/// Writes, for each code, the value that `shown` returns for its voltage.
fn render_codes(
    rendering: &mut Rendering<'_>,
    settings: &Settings,
    path: &Path,
    mut shown: impl FnMut(Volt) -> f32,
) -> Result<PinSummary> {
    let rate_hz = rendering.sample_rate_hz();
    let rate = PlayRate::of(rate_hz).ok_or_else(|| {
        let [one, two] = PlayRate::ALL.map(PlayRate::hz);
        Error::Request(format!(
            "the texture has {rate_hz} samples per second, and a stylus plays {one} or {two}: fit it at one of these"
        ))
    })?;
    let mut pin = Pin::new(rendering.by_ref(), rate, settings);
    // By reference, because the counters are read afterwards.
    let codes = write_floats_wav(path, RATE_HZ, pin.by_ref().map(|code| shown(above_mid_scale(code))))?;
    let limited = pin.limited();
    Ok(PinSummary {
        codes,
        saturations: rendering.saturations(),
        limited,
    })
}

#[cfg(test)]
mod tests {
    use super::super::motion::MotionPath;
    use super::super::render::test_motions::constant;
    use super::*;
    use test_helpers::{library, new_file, texture};

    fn rendering<'a>(library: &'a [u8], motion: &'a MotionPath) -> Rendering<'a> {
        Rendering::new(texture(library), motion, 1.0, 3).unwrap()
    }

    #[test]
    fn the_file_has_the_voltages_of_the_codes_that_the_safety_stages_give() {
        let (library, motion) = (library(5000), constant(90.0, 0.8));
        let (_folder, path) = new_file("pin.wav");
        let settings = settings([("output-gain", 0.02), ("soft-start", 1.0)]).unwrap();
        let summary = render_pin_wav(&mut rendering(&library, &motion), &settings, &path).unwrap();
        assert_eq!((summary.codes, summary.saturations), (40_000, 0));
        let config = Config::new(&settings, 1.0);
        let mut state = State::new(&config);
        let expected: Vec<f32> = rendering(&library, &motion)
            .flat_map(|sample| state.process(&config, sample, false))
            .map(|code| (f32::from(code.get()) - 2048.0) * 3.3 / 4096.0)
            .collect();
        let reader = hound::WavReader::open(&path).unwrap();
        assert_eq!(reader.spec().sample_rate, 40_000);
        let written: Vec<f32> = reader.into_samples().map(|value| value.unwrap()).collect();
        assert_eq!(written.len(), expected.len());
        for (written, expected) in written.iter().zip(&expected) {
            assert!((written - expected).abs() < 1e-6, "{written} {expected}");
        }
        assert!(expected.iter().any(|volt| volt.abs() > 0.02));
    }

    #[test]
    fn at_ten_kilohertz_two_samples_make_the_codes_of_a_tick() {
        let (library, motion) = (library(10_000), constant(90.0, 0.8));
        let settings = settings([("output-gain", 0.02), ("soft-start", 1.0)]).unwrap();
        let mut pin = Pin::new(rendering(&library, &motion), PlayRate::Hz10000, &settings);
        assert_eq!(pin.len(), 40_000);
        let codes: Vec<DacCode> = pin.by_ref().collect();
        let config = Config::at_rate(&settings, 1.0, PlayRate::Hz10000);
        let mut state = State::new(&config);
        let samples: Vec<OutputSample> = rendering(&library, &motion).collect();
        assert!(
            samples
                .as_chunks::<2>()
                .0
                .iter()
                .flat_map(|&pair| state.process_pair(&config, pair, false))
                .eq(codes.iter().copied())
        );
        assert!(codes.iter().any(|code| above_mid_scale(*code).0.abs() > 0.02));
        assert_eq!(pin.limited(), Limited::default());
        let odd = Pin::new(samples[..3].iter().copied(), PlayRate::Hz10000, &settings);
        assert_eq!((odd.len(), odd.count()), (16, 16));
    }

    #[test]
    fn a_texture_of_another_rate_is_refused() {
        let (library, motion) = (library(4000), constant(90.0, 0.8));
        let path = Path::new("never.wav");
        let error = render_pin_wav(&mut rendering(&library, &motion), &Settings::default(), path);
        assert!(matches!(error, Err(Error::Request(_))), "{error:?}");
        assert!(!path.exists());
    }
}
