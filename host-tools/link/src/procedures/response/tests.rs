use model_format::link::{ProbeThrough, RecordSample, Response, Setting, SettingChange, Settings};
use model_format::scene::Biquad;
use model_format::{AdcCode, DacCode, OutputSample, PlayRate};
use nalgebra::Matrix5;
use stylus_app::safety::{Config, Heat, State};
use stylus_dsp::equaliser::{cascade_db, filtered};
use stylus_dsp::response::{Bandwidths, PERIOD, RATE_HZ, db};
use stylus_plant::{Axis, Fault as Broken, Parameters, Plant};

use super::*;

/// Bandwidths of the presets' accelerometer.
const BANDWIDTHS: Bandwidths = Bandwidths([Some(1600.0), Some(1600.0), Some(550.0)]);

const PRESETS: [&str; 6] = [
    "haptuator/light",
    "mark-ii-d/firm",
    "haptuator/free",
    "mark-ii-d/light",
    "haptuator/firm",
    "mark-ii-d/free",
];

/// A plant behind the device's safety stages, in virtual time.
struct PlantBench {
    plant: Plant,
    settings: Settings,
    proposed: Option<Response>,
    /// The coil's heat in the device's model.
    kept: Option<Heat>,
    seconds: f64,
    /// Largest voltage at the pin, V, its largest change per code, V, and largest mean power in the coil over ten
    /// seconds, W.
    most: [f64; 3],
    heat: f64,
}

impl PlantBench {
    fn new(parameters: &Parameters, seed: u64) -> Self {
        let set = |settings: Settings, (setting, value)| settings.with(SettingChange { setting, value }).unwrap();
        let settings = [
            (Setting::CoilResistance, parameters.coil.resistance_ohm as f32),
            (Setting::AmplifierGain, parameters.amplifier.gain as f32),
            (Setting::PowerLimit, parameters.coil.rated_watts as f32),
            (Setting::HardLimit, 0.7),
        ];
        Self {
            plant: Plant::new(parameters, seed),
            settings: settings.into_iter().fold(Settings::default(), set),
            proposed: None,
            kept: None,
            seconds: 0.0,
            most: [0.0; 3],
            heat: 0.0,
        }
    }

    /// Plays samples in m/s² from rest. Returns the recording, and whether a limit acted.
    fn run(&mut self, samples: &[f64], output_gain: f32) -> (Vec<RecordSample>, bool) {
        let gain = SettingChange {
            setting: Setting::OutputGain,
            value: output_gain,
        };
        let config = Config::at_rate(&self.settings.with(gain).unwrap(), 1.0, PlayRate::Hz5000);
        let mut state = self.kept.map_or_else(|| State::new(&config), State::with_heat);
        let (mut recorded, mut before) = (Vec::new(), 0.0);
        for sample in samples {
            let volts = self.plant.accelerometer_volts();
            let code = |volts: f64| AdcCode(((volts + 1.65) / 3.3 * 65_536.0).round() as u16);
            recorded.push(RecordSample {
                acceleration: volts.map(code),
                force: AdcCode(4096),
                encoder_delta: 0,
            });
            let output = OutputSample((sample * f64::from(1 << OutputSample::FRACTION_BITS)) as i32);
            for code in state.process(&config, output, false) {
                let volts = (f64::from(code.get()) - 2048.0) * f64::from(DacCode::STEP.0);
                self.plant.step(volts, true);
                self.heat += (self.plant.coil_watts() - self.heat) / 400_000.0;
                let now = [volts.abs(), (volts - before).abs(), self.heat];
                before = volts;
                for (most, now) in self.most.iter_mut().zip(now) {
                    *most = most.max(now);
                }
            }
        }
        self.kept = Some(state.heat());
        let counters = state.counters();
        let limited = counters.hard_limited + counters.slew_limited + counters.thermally_limited > 0;
        (recorded, limited)
    }
}

impl ProbedStylus for PlantBench {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn propose(&mut self, response: &Response) -> Result<()> {
        response.check(&self.settings).unwrap();
        self.proposed = Some(*response);
        Ok(())
    }

    fn play(&mut self, probe: &Probe<'_>) -> Result<Played> {
        let (sections, gain): (Vec<Biquad>, f32) = match (probe.through, &self.proposed) {
            (ProbeThrough::Proposed, Some(response)) => {
                (response.sections_5khz.biquads().to_vec(), response.output_gain)
            }
            _ => (Vec::new(), self.settings.get(Setting::OutputGain)),
        };
        let sample = |code: &i16| f64::from(*code) / f64::from(i16::MAX) * probe.peak_m_s2;
        let wave: Vec<f64> = probe.codes.iter().map(sample).collect();
        let periods = probe.periods + 2;
        let (recorded, limited) = self.run(&filtered(&sections, &wave.repeat(periods)), gain);
        self.seconds += periods as f64 * PERIOD as f64 / RATE_HZ;
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

fn plant(seed: u64, faults: Vec<Broken>) -> Parameters {
    let parameters = Parameters::preset(PRESETS[seed as usize % PRESETS.len()]).unwrap();
    Parameters {
        faults,
        ..parameters.varied(seed)
    }
}

fn calibrated(parameters: &Parameters, seed: u64) -> (PlantBench, Result<Calibrated>) {
    let mut bench = PlantBench::new(parameters, seed);
    let outcome = calibrate(&mut bench, &options(), 0, &mut |_| ());
    let [volts, slew, watts] = bench.most;
    assert!(
        volts <= 0.7 && slew <= 4.0 / 40.0 + 1e-9 && watts <= parameters.coil.rated_watts,
        "{:?}",
        bench.most
    );
    assert!(bench.seconds <= 60.0, "{}", bench.seconds);
    (bench, outcome)
}

/// The undamped frequency of the faster pair of poles of current, body and moving mass, Hz.
fn resonance_hz(parameters: &Parameters) -> f64 {
    let Parameters { coil, body, hand, .. } = parameters;
    let (force, mass, moving) = (coil.force_n_per_a, body.mass_kg, coil.moving_mass_kg);
    let (spring, damper) = (coil.stiffness_n_per_m, coil.damping_n_s_per_m);
    let row_of_body = [force, -hand.damping_n_s_per_m, -hand.stiffness_n_per_m, damper, spring].map(|part| part / mass);
    let of_mass = [-force, 0.0, 0.0, -damper, -spring].map(|part| part / moving);
    let inductance = coil.inductance_h;
    let mut rows = Matrix5::zeros();
    (rows[(0, 0)], rows[(0, 3)]) = (-coil.resistance_ohm / inductance, force / inductance);
    for column in 0..5 {
        rows[(1, column)] = row_of_body[column];
        rows[(3, column)] = of_mass[column] - row_of_body[column];
    }
    (rows[(2, 1)], rows[(4, 3)]) = (1.0, 1.0);
    rows.complex_eigenvalues()
        .map(|pole| if pole.im > 0.0 { pole.norm() } else { 0.0 })
        .max()
        / std::f64::consts::TAU
}

/// Deviation from what was asked for, dB, with the exact response of the plant: RMS, worst, and mean from 30 to 800 Hz.
fn deviation(parameters: &Parameters, response: &Response) -> [f64; 3] {
    let plant = Plant::new(parameters, 0);
    let gain_db = db(f64::from(response.output_gain));
    let sections = response.sections_5khz.biquads();
    let level = |hz: f64| db(plant.response(hz).norm()) + gain_db + cascade_db(&sections, RATE_HZ, hz);
    let flat = Flatness::of([30.0, 800.0], level);
    [flat.rms_db, flat.worst_db, flat.level_db]
}

#[test]
fn sound_plants_pass_and_their_tips_do_what_was_asked() {
    for seed in 0..3 {
        let parameters = plant(seed, Vec::new());
        let (_, outcome) = calibrated(&parameters, seed);
        let done = outcome.unwrap();
        let [rms, worst, level] = deviation(&parameters, &done.response);
        assert!(rms < 1.0, "{seed}: {rms} {worst} {level}");
        assert!(worst < 2.0, "{seed}: {rms} {worst} {level}");
        assert!(level.abs() < 0.5, "{seed}: {rms} {worst} {level}");
        let found = f64::from(done.response.resonance_hz) / resonance_hz(&parameters);
        assert!((found - 1.0).abs() < 0.02, "{seed}: {found} {:?}", done.identified.fit);
        assert!(done.before.1.worst_db > done.after.1.worst_db);
    }
}

#[test]
fn an_axis_with_the_least_scale_is_not_wired_and_the_others_are_calibrated_as_ever() {
    let parameters = plant(1, [Axis::Y, Axis::Z].map(|axis| Broken::DeadAxis { axis }).to_vec());
    let mut bench = PlantBench::new(&parameters, 1);
    for setting in [Setting::AccelerationPerVoltY, Setting::AccelerationPerVoltZ] {
        let value = setting.spec().least_magnitude;
        bench.settings = bench.settings.with(SettingChange { setting, value }).unwrap();
    }
    let done = calibrate(&mut bench, &options(), 0, &mut |_| ()).unwrap();
    let [rms, worst, _] = deviation(&parameters, &done.response);
    assert!(rms < 1.0 && worst < 2.0, "{rms} {worst}");
}

#[test]
fn each_fault_ends_in_its_own_verdict() {
    let loose = Broken::LooseMount {
        gap_m: 1e-4,
        stiffness_n_per_m: 3e4,
    };
    let hum = |coil_volts, accelerometer_volts| Broken::Hum {
        hz: 50.0,
        coil_volts,
        accelerometer_volts,
    };
    for (fault, verdict) in [
        (Broken::DeadCoil, "nothing-moves"),
        (Broken::OpenWire, "nothing-moves"),
        (Broken::Reversed, "reversed"),
        (Broken::Clipped { volts: 0.5 }, "clipped"),
        (Broken::DeadAxis { axis: Axis::X }, "dead-axis"),
        (Broken::DeadAxis { axis: Axis::Z }, "dead-axis"),
        (loose, "loose"),
        (Broken::MovingResonance { doubles_at_m: 1e-4 }, "moving-resonance"),
        (hum(0.05, 0.0), "hum"),
        (hum(0.0, 0.01), "hum"),
    ] {
        let (_, outcome) = calibrated(&plant(1, vec![fault]), 1);
        let Err(Failure::Fault(found)) = outcome else {
            panic!("{fault:?} passed");
        };
        assert_eq!(found.verdict.name(), verdict, "{fault:?}: {found}");
    }
    let mut quiet = plant(1, Vec::new());
    quiet.accelerometer.noise_m_s2_per_root_hz = [0.1; 3];
    let (_, outcome) = calibrated(&quiet, 1);
    assert!(
        matches!(
            outcome,
            Err(Failure::Fault(Fault {
                verdict: Verdict::Noisy,
                ..
            }))
        ),
        "{outcome:?}"
    );
    let mut weak = plant(1, Vec::new());
    weak.coil.force_n_per_a = 0.02;
    weak.accelerometer.noise_m_s2_per_root_hz = [1e-4; 3];
    let (_, outcome) = calibrated(&weak, 1);
    assert!(
        matches!(
            outcome,
            Err(Failure::Fault(Fault {
                verdict: Verdict::BeyondLimits,
                ..
            }))
        ),
        "{outcome:?}"
    );
}

#[test]
fn a_reversed_plant_is_inverted_when_asked() {
    let parameters = plant(0, vec![Broken::Reversed]);
    let mut bench = PlantBench::new(&parameters, 0);
    let done = calibrate(
        &mut bench,
        &Options {
            invert: true,
            ..options()
        },
        0,
        &mut |_| (),
    )
    .unwrap();
    assert!(!done.identified.fit.is_positive);
    let at_zero =
        |section: &Biquad| section.numerator().iter().sum::<f64>() / (1.0 + section.denominator().iter().sum::<f64>());
    let sections = done.response.sections_5khz.biquads();
    assert!(sections.iter().map(at_zero).product::<f64>() < 0.0);
}

#[test]
fn a_check_tells_what_has_moved() {
    let parameters = plant(3, Vec::new());
    let (mut bench, outcome) = calibrated(&parameters, 3);
    let stored = outcome.unwrap().response;
    let mut checked = |change: &dyn Fn(&mut Parameters)| {
        let mut now = parameters.clone();
        change(&mut now);
        bench.plant = Plant::new(&now, 9);
        bench.seconds = 0.0;
        let checked = check(&mut bench, &stored, &BANDWIDTHS).unwrap();
        assert!(checked.seconds <= 2.0);
        checked.moved.join("; ")
    };
    assert_eq!(checked(&|_| ()), "");
    assert!(checked(&|now| now.coil.force_n_per_a *= 0.8).contains("gain"));
    assert!(checked(&|now| now.coil.stiffness_n_per_m *= 1.5).contains("resonance has moved"));
    assert!(checked(&|now| now.accelerometer.tilt_deg += 30.0).contains("direction"));
    assert!(checked(&|now| now.faults.push(Broken::OpenWire)).contains("nothing moves"));
}
