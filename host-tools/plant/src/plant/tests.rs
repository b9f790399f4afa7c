use super::*;
use crate::chance::Chance;
use crate::fault::Axis;
use crate::linear::STEP_HZ;
use crate::parameters::{Accelerometer, Amplifier, Hand, PRESETS};

fn preset(name: &str) -> Parameters {
    Parameters::preset(name).unwrap()
}

/// A Haptuator whose amplifier wakes at once.
fn awake() -> Parameters {
    let mut parameters = preset("haptuator");
    parameters.amplifier.wake_s = 0.0;
    parameters
}

fn with(fault: Fault) -> Parameters {
    Parameters {
        faults: vec![fault],
        ..awake()
    }
}

const RATTLE: Fault = Fault::LooseMount {
    gap_m: 2e-5,
    stiffness_n_per_m: 2e4,
};
const HARDENING: Fault = Fault::MovingResonance { doubles_at_m: 2e-4 };

/// Returns some specimens of every preset with every hand, without faults and with nonlinear forces.
fn specimens() -> impl Iterator<Item = Parameters> {
    PRESETS
        .iter()
        .flat_map(|name| ["", "/firm", "/free"].map(|hand| format!("{name}{hand}")))
        .flat_map(|name| (0..4).map(move |seed| preset(&name).varied(seed)))
        .flat_map(|sound| {
            [vec![], vec![RATTLE], vec![HARDENING]].map(|faults| Parameters {
                faults,
                ..sound.clone()
            })
        })
}

/// Energy in magnetic field, masses and springs, J.
fn stored(plant: &Plant) -> f64 {
    let Parameters { coil, body, hand, .. } = &plant.parameters;
    let [_, current, body_speed, body_at, speed, at] = plant.states;
    let bent = |fault: &Fault| match *fault {
        Fault::MovingResonance { doubles_at_m } => coil.stiffness_n_per_m * at.powi(4) / doubles_at_m.powi(2) / 4.0,
        Fault::LooseMount {
            gap_m,
            stiffness_n_per_m,
        } => stiffness_n_per_m / 2.0 * (at - at.clamp(-gap_m, gap_m)).powi(2),
        _ => 0.0,
    };
    let bent: f64 = plant.parameters.faults.iter().map(bent).sum();
    bent + 0.5
        * (coil.inductance_h * current.powi(2)
            + body.mass_kg * body_speed.powi(2)
            + coil.moving_mass_kg * (body_speed + speed).powi(2)
            + coil.stiffness_n_per_m * at.powi(2)
            + hand.stiffness_n_per_m * body_at.powi(2))
}

/// Power that resistance and dampers turn into heat, W.
fn heat(plant: &Plant) -> f64 {
    let Parameters { coil, hand, .. } = &plant.parameters;
    plant.coil_watts()
        + coil.damping_n_s_per_m * plant.states[SPEED].powi(2)
        + hand.damping_n_s_per_m * plant.states[BODY_SPEED].powi(2)
}

#[test]
fn the_energy_that_goes_in_is_stored_or_becomes_heat() {
    for (seed, mut parameters) in specimens().enumerate() {
        parameters.amplifier.wake_s = 0.0;
        let mut plant = Plant::new(&parameters, 0);
        let mut chance = Chance(seed as u64);
        let tones = [(); 5].map(|()| (20.0 + 280.0 * chance.fraction(), chance.within(0.2)));
        let power = |plant: &Plant| plant.states[VOLTAGE] * plant.states[CURRENT];
        let (mut put_in, mut heated) = (0.0, 0.0);
        let (mut power_before, mut heat_before) = (0.0, 0.0);
        for step in 0..20_000 {
            let phase = TAU * f64::from(step) * STEP_S;
            let tones = tones.iter().map(|(hz, volts)| volts * (hz * phase).sin());
            plant.step(tones.sum(), true);
            put_in += f64::midpoint(power_before, power(&plant)) * STEP_S;
            heated += f64::midpoint(heat_before, heat(&plant)) * STEP_S;
            (power_before, heat_before) = (power(&plant), heat(&plant));
            assert!(put_in > -1e-9, "it gives energy: {parameters:?}");
        }
        let error = (put_in - heated - stored(&plant)).abs() / put_in;
        // The trapezoidal rule misses some of the knocks of a loose mount.
        assert!(error < 5e-3, "{error} of {put_in} J: {parameters:?}");
    }
}

/// Returns the tip's acceleration at `hz`, and its third harmonic, per pin volt. The input is a sine of `volts` at
/// `hz`, a multiple of 10, and the measurement begins after `settle_s`.
fn measured(plant: &mut Plant, hz: f64, volts: f64, settle_s: f64) -> [Complex<f64>; 2] {
    let settle = (settle_s * STEP_HZ) as u32;
    let mut sums = [Complex::from(0.0); 2];
    for step in 0..settle + 4_000 {
        let phase = TAU * hz * f64::from(step) * STEP_S;
        plant.step(volts * phase.cos(), true);
        if step >= settle {
            sums[0] += plant.tip_m_s2() * Complex::cis(-phase);
            sums[1] += plant.tip_m_s2() * Complex::cis(-3.0 * phase);
        }
    }
    sums.map(|sum| sum / 2_000.0 / volts)
}

#[test]
fn the_response_is_that_of_the_steps() {
    for seed in 0..3 {
        for name in PRESETS {
            let mut parameters = preset(name).varied(seed);
            parameters.amplifier = Amplifier {
                offset_volts: 0.0,
                low_hz: 5.0 * seed as f64,
                ..parameters.amplifier
            };
            for hz in [10.0, 60.0, 150.0, 800.0, 3_000.0, 12_000.0] {
                let mut plant = Plant::new(&parameters, 0);
                let [stepped, third] = measured(&mut plant, hz, 0.1, 5.0);
                let exact = plant.response(hz);
                let error = (stepped - exact).norm() / exact.norm();
                assert!(error < 1e-6, "{stepped} and {exact} at {hz} Hz: {error}");
                assert!(third.norm() < 1e-6 * exact.norm());
            }
        }
    }
}

/// Returns the acceleration of a free body per volt at the coil, m/s² per V. `load_kg` is the total mass.
fn at_coil(name: &str, load_kg: f64, hz: f64) -> f64 {
    let mut parameters = preset(name);
    parameters.hand = Hand::FREE;
    parameters.body.mass_kg = load_kg - parameters.coil.moving_mass_kg;
    parameters.amplifier = Amplifier {
        gain: 1.0,
        low_hz: 0.0,
        high_hz: 1e6,
        ..parameters.amplifier
    };
    Plant::new(&parameters, 0).response(hz).norm()
}

#[test]
fn the_presets_have_the_published_accelerations() {
    let haptuator = at_coil("haptuator", 0.020, 150.0);
    assert!((haptuator / 24.5 - 1.0).abs() < 0.05, "{haptuator}");
    let mark = 9.0 * at_coil("mark-ii-d", 0.100 + 0.0087, 65.0);
    assert!((mark / 39.2 - 1.0).abs() < 0.1, "{mark}");
    for name in PRESETS {
        let [light, firm, free] = ["/light", "/firm", "/free"]
            .map(|hand| Plant::new(&preset(&format!("{name}{hand}")), 0).response(20.0).norm());
        assert!(light != firm && firm != free && free != light);
    }
}

#[test]
fn what_bends_is_linear_at_a_low_level_only() {
    let clipped = Fault::Clipped { volts: 0.2 };
    for fault in [clipped, RATTLE, HARDENING] {
        let third = |volts| {
            let [first, third] = measured(&mut Plant::new(&with(fault), 0), 60.0, volts, 1.0);
            third.norm() / first.norm()
        };
        assert!(third(0.002) < 1e-3 && third(0.4) > 0.02, "{fault:?}");
    }
    // The frequency is above the resonance, and a stiffer spring moves the resonance closer to it.
    let mut plant = Plant::new(&with(HARDENING), 0);
    let [low, high] = [0.002, 0.4].map(|volts| measured(&mut plant, 60.0, volts, 1.0)[0]);
    let exact = plant.response(60.0);
    assert!((low - exact).norm() < 0.01 * exact.norm());
    assert!((high - exact).norm() > 0.1 * exact.norm());
}

#[test]
fn the_amplifier_is_silent_until_it_wakes_and_once_its_enable_falls() {
    let mut parameters = awake();
    parameters.amplifier.wake_s = 0.01;
    parameters.amplifier.low_hz = 0.0;
    let mut plant = Plant::new(&parameters, 0);
    let volts = |plant: &mut Plant, steps: u32, enabled| {
        (0..steps).for_each(|_| plant.step(0.5, enabled));
        plant.states[VOLTAGE]
    };
    assert_eq!(volts(&mut plant, 1_000, false), 0.0);
    assert_eq!(volts(&mut plant, 400, true), 0.0);
    assert!((volts(&mut plant, 100, true) - 1.0).abs() < 1e-9);
    assert!(volts(&mut plant, 40, false).abs() < 1e-9);
    assert!(volts(&mut plant, 40, true).abs() < 1e-9);
}

/// Returns the RMS of a sensor's main axis over 2 s, and its amplitude at `hz`, for a sine of `m_s2`.
fn sensed(change: impl Fn(&mut Accelerometer), hz: f64, m_s2: f64) -> (f64, f64) {
    let mut parameters = awake();
    change(&mut parameters.accelerometer);
    let mut sensor = Sensor::new(&parameters, 5);
    let (mut square, mut sum, steps) = (0.0, Complex::from(0.0), 80_000);
    for step in 0..steps {
        let phase = TAU * hz * f64::from(step) * STEP_S;
        sensor.step(m_s2 * phase.sin());
        let value = sensor.volts()[0] / parameters.accelerometer.volts_per_m_s2;
        square += value * value;
        sum += value * Complex::cis(-phase);
    }
    let steps = f64::from(steps);
    ((square / steps).sqrt(), sum.norm() * 2.0 / steps)
}

#[test]
fn the_accelerometer_has_its_noise_roll_off_and_saturation() {
    let quiet = |accelerometer: &mut Accelerometer| accelerometer.noise_m_s2_per_root_hz = [0.0; 3];
    let (.., passed) = sensed(quiet, 20.0, 10.0);
    assert!((passed - 10.0).abs() < 0.01, "{passed}");
    let (.., corner) = sensed(quiet, 1_600.0, 10.0);
    assert!((corner - 10.0 / 2_f64.sqrt()).abs() < 0.05, "{corner}");
    let (.., cut) = sensed(quiet, 20.0, 100.0);
    assert!(cut < 1.28 * 35.3, "{cut}");
    let (noise, _) = sensed(|_| (), 20.0, 0.0);
    // The noise bandwidth of a first-order low-pass is pi/2 times its corner. The noise of discrete steps lacks its
    // upper end.
    let expected = 1.47e-3 * (1_600.0 * TAU / 4.0).sqrt();
    assert!((noise / expected - 0.95).abs() < 0.05, "{noise} {expected}");
    let tilted = |accelerometer: &mut Accelerometer| {
        quiet(accelerometer);
        accelerometer.tilt_deg = 60.0;
    };
    let (.., tilted) = sensed(tilted, 20.0, 10.0);
    assert!((tilted - 5.0).abs() < 0.01, "{tilted}");
}

#[test]
fn every_specimen_stays_finite_under_the_loudest_noise() {
    let faults = [
        RATTLE,
        HARDENING,
        Fault::Reversed,
        Fault::DeadCoil,
        Fault::OpenWire,
        Fault::LooseMount {
            gap_m: 0.0,
            stiffness_n_per_m: 1e6,
        },
    ];
    for seed in 0..60 {
        let mut chance = Chance(seed);
        let mut parameters = preset(PRESETS[seed as usize % 2]).varied(seed);
        parameters.faults = faults.into_iter().filter(|_| chance.fraction() < 0.3).collect();
        let mut plant = Plant::new(&parameters, seed);
        for _ in 0..4_000 {
            plant.step(chance.within(1.65), true);
            let volts = plant.accelerometer_volts();
            assert!(plant.tip_m_s2().abs() < 1e5 && volts.iter().all(|volts| volts.is_finite()));
        }
    }
}

#[test]
fn a_specimen_is_its_seeds() {
    let haptuator = preset("haptuator");
    assert_eq!(haptuator.varied(3), haptuator.varied(3));
    assert_ne!(haptuator.varied(3), haptuator.varied(4));
    let noise = |seed| {
        let mut plant = Plant::new(&haptuator, seed);
        (0..3).for_each(|_| plant.step(0.0, false));
        plant.accelerometer_volts()
    };
    assert_eq!(noise(1), noise(1));
    assert_ne!(noise(1), noise(2));
}

#[test]
fn a_specimen_of_a_design_at_the_ends_of_the_ranges_is_in_them() {
    let mut edge = awake();
    edge.coil.resistance_ohm = 1e3;
    edge.body.mass_kg = 1e-3;
    edge.amplifier.offset_volts = 1.0;
    edge.accelerometer.tilt_deg = 180.0;
    edge.accelerometer.azimuth_deg = -360.0;
    edge.accelerometer.rest_volts = [1.65, -1.65, 0.0];
    edge.check().unwrap();
    for seed in 0..20 {
        edge.varied(seed).check().unwrap();
    }
}

#[test]
fn parameters_survive_their_text_and_errors_name_the_key() {
    let faults = vec![
        RATTLE,
        HARDENING,
        Fault::DeadAxis { axis: Axis::Z },
        Fault::OpenWire,
        Fault::Clipped { volts: 0.5 },
    ];
    let parameters = Parameters {
        faults,
        ..preset("mark-ii-d/firm").varied(1)
    };
    let text = toml::to_string(&parameters).unwrap();
    assert_eq!(Parameters::from_toml(&text).unwrap(), parameters);
    let told = |from: &str, to: &str| {
        assert!(text.contains(from), "{text}");
        Parameters::from_toml(&text.replacen(from, to, 1))
            .unwrap_err()
            .to_string()
    };
    assert!(told("resistance_ohm", "resistance").contains("resistance"));
    assert!(told("gap_m = ", "gap_m = 9").contains("faults.gap_m"));
    assert!(told("open-wire", "open").contains("open"));
    assert!(Parameters::preset("haptuator/loose").is_err());
    let missing = Parameters::read("no/such.toml".as_ref()).unwrap_err().to_string();
    assert!(missing.contains("no/such.toml") && missing.contains("mark-ii-d"));
}
