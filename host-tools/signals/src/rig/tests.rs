//! Properties of whole trials and sets.
#![expect(clippy::float_cmp, reason = "samples must be the same bit for bit, and zeros exact")]

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use rand::RngExt;
use stylus_dsp::fourier::{self, Complex};
use stylus_dsp::sums::rms;

use super::Mode;
use super::contact::Contact;
use super::measurement::StreamKey;
use super::profile::Profile;
use super::trial::{Strip, Trial};
use super::*;
use test_helpers::near;

/// Speeds, forces and drum of most rigs in these tests.
const PROTOCOL: &str = r#"
name = "test"
[recording]
sample_rate_hz = 5000
duration_s = 2.0
speeds_mm_s = [20, 60, 150, 300]
forces_n = [0.0, 0.2, 0.8, 1.4]
[drum]
circumference_mm = 300.0
"#;

const TOOL: &str = r"
[tool]
tip_radius_mm = 1.5
[[tool.mode]]
frequency_hz = 90.0
damping_ratio = 0.3
participation_m_s2_per_n = [4.0, -2.0, 12.0]
[[tool.mode]]
frequency_hz = 400.0
damping_ratio = 0.1
participation_m_s2_per_n = [5.0, 3.0, -9.0]
tip_participation_m_s2_per_n = 8.0
";

const STRIP: &str = r#"
[[texture]]
name = "strip"
effective_modulus_mpa = 1000.0
"#;

const WEAVE: &str = r"
[[texture.weave]]
wavelength_mm = 0.6
amplitude_um = 1.0
harmonics = [0.5, -0.3]
";

const ROUGHNESS: &str = r"
[texture.roughness]
rms_um = 0.5
hurst = 0.7
roll_off_mm = 1.0
shortest_mm = 0.05
";

const TREMOR: &str = r"
[measurement.tremor]
lowest_hz = 8.0
highest_hz = 12.0
rms_m_s2 = [0.1, 0.2, 0.3]
";
const HUM: &str = r"
[measurement.hum]
frequency_hz = 50.0
amplitude_m_s2 = [0.5, -0.25, 0.0]
";
const OFFSET: &str = r"
[measurement.offset]
value_m_s2 = [0.1, -0.7, 0.3]
";
const NOISE: &str = r"
[measurement.noise]
rms_m_s2 = [0.3, 0.2, 0.1]
";
const CLIPPING: &str = r"
[measurement.clipping]
range_g = 0.1
";

fn rig(parts: &[&str]) -> RigFile {
    RigFile::from_toml(Path::new("test.toml"), &parts.concat()).unwrap()
}

/// All trials of the first texture.
fn trials(parts: &[&str], seed: u64) -> Vec<Trial> {
    let rig = rig(parts);
    let recording = &rig.description().recording;
    let strip = Strip::new(&rig, 0, seed);
    (0..recording.speeds_mm_s.len())
        .flat_map(|speed| (0..recording.forces_n.len()).map(move |force| (speed, force)))
        .map(|(speed, force)| strip.trial(speed, force))
        .collect()
}

/// Amplitudes of the sines in a signal, and the width of a bin, Hz.
fn amplitudes(signal: &[f64]) -> (Vec<f64>, f64) {
    let spectrum = fourier::forward(&mut signal.to_vec());
    let scale = 2.0 / signal.len() as f64;
    let amplitudes = spectrum.iter().map(|bin| bin.norm() * scale).collect();
    (amplitudes, 5000.0 / signal.len() as f64)
}

#[test]
fn without_a_force_samples_are_exact_zeros() {
    for trial in trials(&[PROTOCOL, TOOL, STRIP, WEAVE, ROUGHNESS], 1) {
        assert_eq!(trial.rms_m_s2() == 0.0, trial.force_n == 0.0);
    }
}

#[test]
fn a_wave_beyond_half_the_sample_rate_leaves_nothing_rather_than_an_alias() {
    // A wavelength of 0.1 mm gives 200 Hz at 20 mm/s, and 3000 Hz at 300 mm/s.
    let fine = WEAVE.replace("0.6", "0.1").replace("[0.5, -0.3]", "[]");
    let all = trials(&[PROTOCOL, TOOL, STRIP, &fine], 1);
    let level = |speed_mm_s: f64| {
        let of_speed = |trial: &&Trial| trial.speed_mm_s == speed_mm_s && trial.force_n > 0.0;
        all.iter().find(of_speed).unwrap().rms_m_s2()
    };
    assert!(level(20.0) > 1e-2);
    assert_eq!(level(300.0), 0.0);
}

/// Displacement (m) and speed (m/s) of each mode, or their derivatives.
type State = Vec<[f64; 2]>;

/// `state` after the time `step` at the rates `by`.
fn moved(state: &State, by: &State, step: f64) -> State {
    let pairs = state.iter().zip(by);
    let moved = |(state, by): (&[f64; 2], &[f64; 2])| [0, 1].map(|i| state[i] + step * by[i]);
    pairs.map(moved).collect()
}

/// The height, µm, averaged over the contact, at a position, mm.
fn felt_um(rig: &RigFile, profile: &Profile, contact: &Contact) -> impl Fn(f64) -> f64 {
    let circumference_mm = rig.description().drum.circumference_mm;
    let terms = profile
        .coefficients_um()
        .iter()
        .enumerate()
        .filter(|(_, term)| term.norm() > 0.0);
    let felt: Vec<_> = terms
        .map(|(n, term)| {
            let wavenumber = TAU * n as f64 / circumference_mm;
            (wavenumber, term * contact.patch_response(wavenumber))
        })
        .collect();
    move |x_mm| {
        let at = |(wavenumber, term): &(f64, Complex<f64>)| term * Complex::cis(wavenumber * x_mm);
        felt.iter().map(|term| at(term).re).sum()
    }
}

/// The reference: the modes' equations of motion, driven by the contact spring, integrated over time (Runge-Kutta,
/// fourth order) instead of solved in the frequency domain.
fn integrated(rig: &RigFile, profile: &Profile, contact: &Contact, speed_mm_s: f64, start_mm: f64) -> Vec<[f64; 3]> {
    let tool = rig.description().tool.as_ref().unwrap();
    let height_um = felt_um(rig, profile, contact);
    let derivative = |time_s: f64, state: &State| -> State {
        let modes = tool.modes.iter().zip(state);
        let tip_m = modes
            .clone()
            .map(|(mode, [q, _])| mode.tip_participation_m_s2_per_n.unwrap_or(0.0) * q);
        let indented_um = height_um(start_mm + speed_mm_s * time_s) - 1e6 * tip_m.sum::<f64>();
        let force_n = contact.stiffness_n_per_um() * indented_um;
        modes
            .map(|(mode, [q, rate])| {
                let omega = TAU * mode.frequency_hz;
                let damped = 2.0 * mode.damping_ratio * omega * rate;
                [*rate, force_n - omega * omega * q - damped]
            })
            .collect()
    };
    let accelerations = |first: &State| {
        std::array::from_fn(|axis| {
            let modes = tool.modes.iter().zip(first);
            let of = |(mode, [_, q]): (&Mode, &[f64; 2])| mode.participation_m_s2_per_n[axis] * q;
            modes.map(of).sum()
        })
    };
    let steps = 16;
    let step_s = 1.0 / (5000.0 * f64::from(steps));
    let mut state: State = vec![[0.0; 2]; tool.modes.len()];
    let mut samples = Vec::new();
    for step in 0..steps * 2500 {
        let time_s = f64::from(step) * step_s;
        let first = derivative(time_s, &state);
        if step % steps == 0 {
            samples.push(accelerations(&first));
        }
        let second = derivative(time_s + step_s / 2.0, &moved(&state, &first, step_s / 2.0));
        let third = derivative(time_s + step_s / 2.0, &moved(&state, &second, step_s / 2.0));
        let fourth = derivative(time_s + step_s, &moved(&state, &third, step_s));
        for (by, weight) in [(&first, 1.0), (&second, 2.0), (&third, 2.0), (&fourth, 1.0)] {
            state = moved(&state, by, weight * step_s / 6.0);
        }
    }
    samples
}

#[test]
fn samples_are_those_of_the_equations_of_motion() {
    let rig = rig(&[PROTOCOL, TOOL, STRIP, WEAVE]);
    let strip = Strip::new(&rig, 0, 3);
    let profile = Profile::new(&rig.description().drum, &rig.description().textures[0], 3);
    for (speed, force) in [(0, 3), (1, 1), (2, 2), (3, 3)] {
        let trial = strip.trial(speed, force);
        let (speed_mm_s, force_n) = (trial.speed_mm_s, trial.force_n);
        let key = StreamKey::new(3).text("strip").number(speed_mm_s);
        let start_mm = 300.0 * key.number(force_n).stream("start").random::<f64>();
        let contact = Contact::hertz(1.5, 1000.0, force_n).unwrap();
        let expected = integrated(&rig, &profile, &contact, speed_mm_s, start_mm);
        let scale = trial.rms_m_s2();
        // By 0.3 s the initial transient has decayed: 90 Hz at 0.3 of critical damping.
        for (i, expected) in expected.iter().enumerate().skip(1500) {
            for (axis, expected) in trial.samples_m_s2.iter().zip(expected) {
                near(axis[i], *expected, 1e-4 * scale);
            }
        }
    }
}

#[test]
fn each_effect_adds_the_same_whatever_else_the_scene_names() {
    let vibrating = [PROTOCOL, TOOL, STRIP, WEAVE, ROUGHNESS];
    let still = [PROTOCOL, STRIP];
    let alone = |part| trials(&[&still[..], &[part]].concat(), 5);
    let vibration = trials(&vibrating, 5);
    let [tremor, hum, offset, noise] = [TREMOR, HUM, OFFSET, NOISE].map(alone);
    // Named in an order that differs from the order in which they are added.
    let all = trials(&[&vibrating[..], &[NOISE, HUM, OFFSET, TREMOR]].concat(), 5);
    let without_noise = trials(&[&vibrating[..], &[HUM, OFFSET, TREMOR]].concat(), 5);
    for trial in 0..all.len() {
        for axis in 0..3 {
            let of = |trials: &[Trial], i: usize| trials[trial].samples_m_s2[axis][i];
            for i in 0..10_000 {
                // Equal to the bit, because every effect gives the same numbers, and they are added in the same order.
                let quiet = of(&vibration, i) + of(&tremor, i) + of(&hum, i) + of(&offset, i);
                assert_eq!(of(&without_noise, i), quiet);
                assert_eq!(of(&all, i), quiet + of(&noise, i));
            }
        }
    }
}

#[test]
fn the_rig_with_weaves_is_sound() {
    let text = include_str!("../../../examples/rigs/weave-rig.toml");
    let rig = RigFile::from_toml(Path::new("rigs/weave-rig.toml"), text).unwrap();
    let mut textures = rig.description().textures.iter();
    assert!(textures.all(|texture| !texture.weaves.is_empty()));
}

#[test]
fn hum_has_its_frequency_and_amplitude() {
    for trial in trials(&[PROTOCOL, STRIP, HUM], 1) {
        for (axis, amplitude) in trial.samples_m_s2.iter().zip([0.5, 0.25, 0.0]) {
            let (spectrum, _) = amplitudes(axis);
            for (bin, found) in spectrum.iter().enumerate() {
                let expected = if bin == 100 { amplitude } else { 0.0 };
                assert!((found - expected).abs() < 1e-9, "bin {bin}");
            }
        }
    }
}

#[test]
fn noise_is_white_with_its_rms_and_its_axes_are_independent() {
    let all = trials(&[PROTOCOL, STRIP, NOISE], 1);
    for (axis, expected) in [0.3, 0.2, 0.1].into_iter().enumerate() {
        let signal: Vec<f64> = all
            .iter()
            .flat_map(|trial| &trial.samples_m_s2[axis])
            .copied()
            .collect();
        near(rms(&signal) / expected, 1.0, 0.01);
        let (spectrum, _) = amplitudes(&signal);
        for quarter in spectrum[1..].chunks_exact(spectrum.len() / 4) {
            let power = rms(quarter) * (signal.len() as f64 / 4.0).sqrt();
            near(power / expected, 1.0, 0.02);
        }
    }
    let [x, y, _] = &all[0].samples_m_s2;
    for (other, scale) in [(y, 0.06), (&all[1].samples_m_s2[0], 0.09)] {
        let product: f64 = x.iter().zip(other).map(|(x, y)| x * y).sum::<f64>() / 1e4;
        assert!((product / scale).abs() < 0.05);
    }
}

#[test]
fn tremor_stays_in_its_band_and_has_its_rms() {
    let mut powers = [0.0; 3];
    for seed in 0..10 {
        for trial in trials(&[PROTOCOL, STRIP, TREMOR], seed) {
            for (power, axis) in powers.iter_mut().zip(&trial.samples_m_s2) {
                *power += rms(axis).powi(2) / 160.0;
            }
            let window = |i: usize| 1.0 - (TAU * i as f64 / 1e4).cos();
            let windowed = trial.samples_m_s2[0]
                .iter()
                .enumerate()
                .map(|(i, value)| value * window(i));
            let (spectrum, bin_hz) = amplitudes(&windowed.collect::<Vec<_>>());
            let inside = |bin: usize| (7.0..=13.0).contains(&(bin as f64 * bin_hz));
            let power = |wanted: bool| -> f64 {
                spectrum
                    .iter()
                    .enumerate()
                    .filter(|(bin, _)| inside(*bin) == wanted)
                    .map(|(_, amplitude)| amplitude * amplitude)
                    .sum()
            };
            assert!(power(false) < 0.01 * power(true));
        }
    }
    for (power, expected) in powers.iter().zip([0.1, 0.2, 0.3]) {
        near(power.sqrt() / expected, 1.0_f64, 0.05);
    }
}

#[test]
fn clipping_bounds_every_sample_and_changes_no_other() {
    let range_m_s2 = 0.1 * 9.806_65;
    let free = trials(&[PROTOCOL, TOOL, STRIP, ROUGHNESS, NOISE], 2);
    let limited = trials(&[PROTOCOL, TOOL, STRIP, ROUGHNESS, NOISE, CLIPPING], 2);
    let mut clipped = 0;
    for (free, limited) in free.iter().zip(&limited) {
        let mut in_trial = 0;
        let free = free.samples_m_s2.iter().flatten();
        for (free, limited) in free.zip(limited.samples_m_s2.iter().flatten()) {
            assert_eq!(*limited, free.clamp(-range_m_s2, range_m_s2));
            in_trial += u64::from(free.abs() > range_m_s2);
        }
        assert_eq!(limited.clipped, in_trial);
        clipped += in_trial;
    }
    assert!(clipped > 1000);
}

#[test]
fn a_trial_does_not_depend_on_the_others_of_its_scene() {
    let parts = [TOOL, STRIP, WEAVE, ROUGHNESS, TREMOR, NOISE];
    let whole = trials(&[&[PROTOCOL], &parts[..]].concat(), 9);
    let fewer = PROTOCOL
        .replace("[20, 60, 150, 300]", "[60]")
        .replace("[0.0, 0.2, 0.8, 1.4]", "[0.8]");
    let one = trials(&[&[fewer.as_str()], &parts[..]].concat(), 9);
    assert_eq!(one, [whole[6].clone()]);

    let rougher = format!("{STRIP}{ROUGHNESS}")
        .replace("strip", "other")
        .replace("0.05", "0.01");
    let behind = rig(&[&[PROTOCOL, TOOL, &rougher], &parts[1..]].concat());
    assert_eq!(Strip::new(&behind, 1, 9).trial(1, 2), whole[6]);
}

/// All files of a folder, by their relative paths.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            let inner = files(&path).into_iter();
            all.extend(inner.map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else if name != stylus_support::output::LIST {
            all.insert(name, fs::read(&path).unwrap());
        }
    }
    all
}

fn small_rig() -> RigFile {
    let short = PROTOCOL.replace("2.0", "0.1");
    let other = STRIP.replace("strip", "other");
    rig(&[&short, TOOL, &other, STRIP, WEAVE, ROUGHNESS, TREMOR, NOISE])
}

#[test]
fn the_same_scene_and_seed_are_the_same_bytes_whatever_the_number_of_threads() {
    let written = |threads: usize, seed: u64| {
        let folder = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let simulate = || simulate_to_folder(&small_rig(), seed, folder.path(), false);
        let summary = pool.build().unwrap().install(simulate).unwrap();
        let files = files(folder.path());
        let bytes: usize = files.values().map(Vec::len).sum();
        assert_eq!(summary.bytes, bytes as u64);
        assert_eq!(summary.trials, 32);
        files
    };
    let one = written(1, 1);
    assert_eq!(one.len(), 32 + 3);
    assert_eq!(one, written(3, 1));
    let other_seed = written(2, 2);
    assert!(one.keys().eq(other_seed.keys()));
    for (name, bytes) in &one {
        assert_eq!(*bytes == other_seed[name], name == "rig.toml", "{name}");
    }
}

#[test]
fn a_set_can_be_read_back_and_every_file_says_that_it_is_simulated() {
    let rig = small_rig();
    let folder = tempfile::tempdir().unwrap();
    simulate_to_folder(&rig, 4, folder.path(), false).unwrap();

    let table = fs::read_to_string(folder.path().join("trials.csv")).unwrap();
    let (comment, rest) = table.split_once('\n').unwrap();
    let notice = "# SIMULATED by the rig simulator";
    assert!(comment.starts_with(notice), "{comment}");
    assert!(rest.starts_with("file,texture,speed_mm_s,force_n,simulated\n"));
    let mut reader = csv::Reader::from_reader(rest.as_bytes());
    let rows: Vec<(String, String, f64, f64, bool)> = reader.deserialize().collect::<Result<_, _>>().unwrap();
    assert_eq!(rows.len(), 32);
    assert_eq!(rows[31].0, "strip/simulated_300mm_s_1.4N.wav");
    assert_eq!(rows[0].0, "other/simulated_20mm_s_0.0N.wav");

    let recording = &rig.description().recording;
    let strips = [Strip::new(&rig, 0, 4), Strip::new(&rig, 1, 4)];
    for (i, (file, texture, speed_mm_s, force_n, simulated)) in rows.iter().enumerate() {
        let (speed, force) = (i % 16 / 4, i % 4);
        assert!(*simulated);
        assert_eq!(*texture, rig.description().textures[i / 16].name);
        assert_eq!(*speed_mm_s, recording.speeds_mm_s[speed]);
        assert_eq!(*force_n, recording.forces_n[force]);
        let mut wav = hound::WavReader::open(folder.path().join(file)).unwrap();
        assert_eq!((wav.spec().channels, wav.spec().sample_rate), (3, 5000));
        let samples: Vec<f32> = wav.samples().map(Result::unwrap).collect();
        let [x, y, z] = &strips[i / 16].trial(speed, force).samples_m_s2;
        let expected = (0..x.len()).flat_map(|i| [x, y, z].map(|axis| axis[i] as f32));
        assert_eq!(samples, expected.collect::<Vec<_>>());
        let bytes = fs::read(folder.path().join(file)).unwrap();
        assert!(String::from_utf8_lossy(&bytes).contains("SIMULATED by the rig simulator"));
        // The length in the RIFF header includes the comment.
        let length = u32::from_le_bytes(bytes[4..8].try_into().unwrap());
        assert_eq!(length as usize + 8, bytes.len());
    }
    let notice = fs::read_to_string(folder.path().join("SIMULATED.txt")).unwrap();
    assert!(notice.contains("Nothing in this folder was measured") && notice.contains("Seed: 4"));
    let kept = fs::read_to_string(folder.path().join("rig.toml")).unwrap();
    assert_eq!(kept, rig.text());
}

#[test]
fn the_papers_scene_has_its_protocol_and_levels_of_its_kind() {
    let rig = RigFile::paper();
    let recording = &rig.description().recording;
    let (speeds, forces) = (recording.speeds_mm_s.iter(), recording.forces_n.iter());
    assert!(speeds.copied().eq((1..=15).map(|i| f64::from(20 * i))));
    assert!(forces.copied().eq((0..8).map(|i| f64::from(2 * i) / 10.0)));
    assert_eq!(recording.samples(), 10_000);
    assert_eq!(recording.sample_rate_hz, 5000);
    let names: Vec<_> = rig
        .description()
        .textures
        .iter()
        .map(|texture| texture.name.as_str())
        .collect();
    assert_eq!(names, ["paper", "organza", "vinyl", "denim"]);
    for texture in 0..4 {
        let strip = Strip::new(&rig, texture, 1);
        let level = |speed, force| strip.trial(speed, force).rms_m_s2();
        assert!(level(9, 0) < 0.1, "the sensor alone");
        let levels = [(0, 4), (4, 1), (9, 4), (14, 7)].map(|(speed, force)| level(speed, force));
        let is_usual = |level: &f64| (0.15..16.0).contains(level);
        assert!(levels.iter().all(is_usual), "{levels:?}");
        assert!(level(14, 7) > 2.0 * level(0, 1), "harder and faster");
        assert_eq!(strip.trial(14, 7).clipped, 0);
    }
}
