use model_format::link::{ProbeThrough, RecordSample, Response, Setting, SettingChange, Settings};
use model_format::scene::Biquad;
use model_format::{AdcCode, DacCode, OutputSample, PlayRate};
use stylus_app::safety::{Config, State};
use stylus_plant::{Axis, Fault as Broken, Parameters, Plant, STEP_HZ};

use super::*;
use crate::dsp::equaliser::filtered;
use crate::dsp::response::{Bandwidths, PERIOD};

/// Bandwidths of the presets' accelerometer.
const BANDWIDTHS: Bandwidths = Bandwidths([Some(1600.0), Some(1600.0), Some(550.0)]);

/// A plant behind the device's safety stages, in virtual time.
struct PlantBench {
    plant: Plant,
    settings: Settings,
    proposed: Option<Response>,
    seconds: f64,
    /// Largest voltage at the pin, largest change of it per code, and largest power of the coil.
    most: [f64; 3],
}

impl PlantBench {
    fn new(parameters: &Parameters, seed: u64) -> Self {
        let set = |settings: Settings, (setting, value)| {
            settings.with(SettingChange { setting, value }).unwrap()
        };
        let settings = [
            (
                Setting::CoilResistance,
                parameters.coil.resistance_ohm as f32,
            ),
            (Setting::AmplifierGain, parameters.amplifier.gain as f32),
            (Setting::PowerLimit, parameters.coil.rated_watts as f32),
            (Setting::HardLimit, 0.7),
        ];
        Self {
            plant: Plant::new(parameters, seed),
            settings: settings.into_iter().fold(Settings::default(), set),
            proposed: None,
            seconds: 0.0,
            most: [0.0; 3],
        }
    }

    /// Plays samples in m/s² from rest, and gives what was recorded and what the tip did, per code.
    fn run(&mut self, samples: &[f64], output_gain: f32) -> (Vec<RecordSample>, Vec<f64>, bool) {
        let gain = SettingChange {
            setting: Setting::OutputGain,
            value: output_gain,
        };
        let settings = self.settings.with(gain).unwrap();
        let config = Config::at_rate(&settings, 1.0, PlayRate::Hz5000);
        let mut state = State::new(&config);
        let (mut recorded, mut tip, mut before) = (Vec::new(), Vec::new(), 0.0);
        for sample in samples {
            let volts = self.plant.accelerometer_volts();
            let code = |volts: f64| AdcCode(((volts + 1.65) / 3.3 * 65_536.0).round() as u16);
            recorded.push(RecordSample {
                acceleration: volts.map(code),
                force: AdcCode(4096),
                encoder_delta: 0,
            });
            let output =
                OutputSample((sample * f64::from(1 << OutputSample::FRACTION_BITS)) as i32);
            for code in state.process(&config, output, false) {
                let volts = (f64::from(code.get()) - 2048.0) * f64::from(DacCode::STEP.0);
                self.plant.step(volts, true);
                tip.push(self.plant.tip_m_s2());
                let now = [volts.abs(), (volts - before).abs(), self.plant.coil_watts()];
                before = volts;
                for (most, now) in self.most.iter_mut().zip(now) {
                    *most = most.max(now);
                }
            }
        }
        let counters = state.counters();
        let limited =
            counters.hard_limited + counters.slew_limited + counters.thermally_limited > 0;
        (recorded, tip, limited)
    }

    fn equalised(&self, sections: &[Biquad], probe: &Probe<'_>, periods: usize) -> Vec<f64> {
        let wave: Vec<f64> = probe
            .codes
            .iter()
            .map(|code| f64::from(*code) / 32_767.0 * probe.peak_m_s2)
            .collect();
        filtered(sections, &wave.repeat(periods))
    }
}

impl Bench for PlantBench {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn propose(&mut self, response: &Response) -> Result<()> {
        response.check(&self.settings).unwrap();
        self.proposed = Some(*response);
        Ok(())
    }

    fn play(&mut self, probe: &Probe<'_>) -> Result<Played> {
        let stored = self.settings.get(Setting::OutputGain);
        let (sections, gain) = match (probe.through, &self.proposed) {
            (ProbeThrough::Proposed, Some(response)) => {
                (response.sections_5khz.biquads(), response.output_gain)
            }
            _ => (heapless::Vec::new(), stored),
        };
        let periods = probe.periods + 2;
        let samples = self.equalised(&sections, probe, periods);
        let (recorded, _, limited) = self.run(&samples, gain);
        self.seconds += periods as f64 * 0.4;
        Ok(Played::of(&recorded[2 * PERIOD..], &self.settings, limited))
    }

    fn seconds(&self) -> f64 {
        self.seconds
    }
}

fn options() -> Options {
    Options {
        bandwidths: BANDWIDTHS,
        ..Options::default()
    }
}

fn plant(preset: &str, seed: u64, faults: Vec<Broken>) -> Parameters {
    let parameters = Parameters::preset(preset).unwrap();
    Parameters {
        faults,
        ..parameters.varied(seed)
    }
}

/// The resonance of moving mass against body and hand, with the coil's wires joined by the amplifier, Hz: where the
/// exact response has its pole.
const PRESETS: [&str; 6] = [
    "haptuator/light",
    "haptuator/firm",
    "haptuator/free",
    "mark-ii-d/light",
    "mark-ii-d/firm",
    "mark-ii-d/free",
];

#[test]
fn explore() {
    let faults: Vec<(&str, Option<Broken>)> = vec![
        ("none", None),
        ("dead-coil", Some(Broken::DeadCoil)),
        ("open", Some(Broken::OpenWire)),
        ("rev", Some(Broken::Reversed)),
        ("clip.2", Some(Broken::Clipped { volts: 0.2 })),
        ("clip.5", Some(Broken::Clipped { volts: 0.5 })),
        ("clip.8", Some(Broken::Clipped { volts: 0.8 })),
        ("axisx", Some(Broken::DeadAxis { axis: Axis::X })),
        (
            "loose1e-5",
            Some(Broken::LooseMount {
                gap_m: 1e-5,
                stiffness_n_per_m: 3e4,
            }),
        ),
        (
            "loose1e-4",
            Some(Broken::LooseMount {
                gap_m: 1e-4,
                stiffness_n_per_m: 3e4,
            }),
        ),
        (
            "loose5e-4",
            Some(Broken::LooseMount {
                gap_m: 5e-4,
                stiffness_n_per_m: 1e4,
            }),
        ),
        (
            "move1e-4",
            Some(Broken::MovingResonance { doubles_at_m: 1e-4 }),
        ),
        (
            "move3e-4",
            Some(Broken::MovingResonance { doubles_at_m: 3e-4 }),
        ),
        (
            "move1e-3",
            Some(Broken::MovingResonance { doubles_at_m: 1e-3 }),
        ),
        (
            "hum",
            Some(Broken::Hum {
                hz: 50.0,
                coil_volts: 0.1,
                accelerometer_volts: 0.0,
            }),
        ),
    ];
    for seed in 0..2 {
        for (name, fault) in &faults {
            for preset in ["haptuator/light", "mark-ii-d/firm"] {
                let mut bench =
                    PlantBench::new(&plant(preset, seed, fault.iter().copied().collect()), seed);
                let begun = std::time::Instant::now();
                let out = calibrate(&mut bench, &options(), 0, &mut |_| ());
                let elapsed = begun.elapsed();
                match out {
                    Ok(done) => println!(
                        "{name} {preset} PASS before {:?} after {:?} res {:?} delay {} err {:.4} gain {:.5} band {:?} n {} secs {} levels {:?} most {:?} {elapsed:?}",
                        done.before.1,
                        done.after.1,
                        done.identified.fit.resonance,
                        done.identified.fit.delay_s,
                        done.identified.fit.error,
                        done.design.output_gain,
                        done.design.band_hz,
                        done.design.sections[0].len(),
                        done.seconds,
                        done.identified.levels,
                        bench.most,
                    ),
                    Err(failure) => println!("{name} {preset} {failure} {elapsed:?}"),
                }
            }
        }
    }
}
