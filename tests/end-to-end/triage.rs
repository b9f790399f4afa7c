//! Damages signals that resemble real takes in 27 ways at three strengths, and checks what triage reports.
//!
//! The signals are generated: a heavy-tailed residual, a level that varies by 5 dB within the take, and most power at
//! low frequencies. Their kurtosis is that of real takes. Damage that passes without a verdict must change the fitted
//! spectrum by less than its bound.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use crate::support::{Bench, RATE_HZ, holds, noise, scaled, wav};
use host_tools::dsp::linear_prediction::{error_share, step_up};
use host_tools::dsp::model::Model;
use host_tools::dsp::sums::rms;
use host_tools::fit::lines::Lines;
use host_tools::fit::{self, ExcitationChoice, Fit, Options, Order};
use host_tools::recording::triage::Verdict;
use host_tools::recording::{RecordingSet, resample};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Rate of the recordings that are damaged before they are resampled, Hz.
const FAST_HZ: u32 = 44_100;

/// Duration of a take, s.
const SECONDS: f64 = 4.0;

/// A surface: the corner frequency of its low-pass filter, Hz, and its resonances as frequency, Hz, bandwidth, Hz, and
/// gain.
struct Surface {
    corner_hz: f64,
    resonances: &'static [(f64, f64, f64)],
}

const SURFACES: [Surface; 3] = [
    Surface {
        corner_hz: 120.0,
        resonances: &[(350.0, 60.0, 0.5)],
    },
    Surface {
        corner_hz: 300.0,
        resonances: &[(900.0, 120.0, 0.8), (200.0, 80.0, 0.3)],
    },
    Surface {
        corner_hz: 60.0,
        resonances: &[(90.0, 40.0, 0.5)],
    },
];

/// A slow Gaussian process of unit variance with the time constant `seconds`.
fn slow(normal: &mut impl Iterator<Item = f64>, samples: usize, rate_hz: f64, seconds: f64) -> Vec<f64> {
    let pole = (-1.0 / (seconds * rate_hz)).exp();
    let mut state = normal.next().expect("it has no end");
    (0..samples)
        .map(|_| {
            state = pole * state + (1.0 - pole * pole).sqrt() * normal.next().expect("it has no end");
            state
        })
        .collect()
}

impl Surface {
    /// Generates a take with an RMS of 0.5 m/s², in 16 bits.
    fn take(&self, seed: u64, rate_hz: u32, seconds: f64) -> Vec<f64> {
        let rate = f64::from(rate_hz);
        let samples = (seconds * rate) as usize;
        let mut normal = StandardNormal.sample_iter(rand_pcg::Pcg64::seed_from_u64(seed));
        let level = slow(&mut normal, samples, rate, 0.09);
        let cluster = slow(&mut normal, samples, rate, 0.004);
        let residual: Vec<f64> = cluster
            .iter()
            .map(|cluster| {
                let (x, spread): (f64, f64) = (normal.next().unwrap(), normal.next().unwrap());
                x * (0.45 * spread + 0.35 * cluster).exp()
            })
            .collect();
        let pole = (-TAU * self.corner_hz / rate).exp();
        let mut low = 0.0;
        let mut states = vec![(0.0, 0.0); self.resonances.len()];
        let shaped: Vec<f64> = residual
            .iter()
            .zip(&level)
            .map(|(e, level)| {
                low = pole * low + (1.0 - pole) * e;
                let mut sum = low + 0.08 * e;
                for ((before, earlier), (frequency_hz, width_hz, gain)) in states.iter_mut().zip(self.resonances) {
                    let radius = (-0.5 * TAU * width_hz / rate).exp();
                    let next = (1.0 - radius) * e + 2.0 * radius * (TAU * frequency_hz / rate).cos() * *before
                        - radius * radius * *earlier;
                    (*before, *earlier) = (next, *before);
                    sum += gain * next;
                }
                sum * (if *level < 0.0 { 0.95 } else { 0.4 } * level).exp()
            })
            .collect();
        sixteen_bits(&scaled_to(&shaped, 0.5))
    }
}

fn scaled_to(signal: &[f64], level: f64) -> Vec<f64> {
    scaled(signal, level / rms(signal))
}

/// Rounds to steps of 2⁻¹⁵ of 16 m/s².
fn sixteen_bits(signal: &[f64]) -> Vec<f64> {
    signal.iter().map(|x| (x * 2048.0).round() / 2048.0).collect()
}

fn kurtosis(signal: &[f64]) -> f64 {
    let power = rms(signal).powi(2);
    signal.iter().map(|x| x.powi(4)).sum::<f64>() / signal.len() as f64 / (power * power)
}

/// Magnitude that the fraction `share` of the samples exceeds.
fn quantile(signal: &[f64], share: f64) -> f64 {
    let mut sorted: Vec<f64> = signal.iter().map(|x| x.abs()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted[((1.0 - share) * (sorted.len() - 1) as f64) as usize]
}

fn plus(signal: &[f64], other: impl Fn(f64) -> f64, rate_hz: u32) -> Vec<f64> {
    let samples = signal.iter().zip(0u32..);
    let sum = |(x, n): (&f64, u32)| x + other(f64::from(n) / f64::from(rate_hz));
    samples.map(sum).collect()
}

fn tone(frequency_hz: f64, amplitude: f64) -> impl Fn(f64) -> f64 {
    move |time| amplitude * (TAU * frequency_hz * time).sin()
}

/// Files of a set, the damaged one last, and whether they are fitted as one texture.
struct Files(Vec<(&'static str, Vec<u8>)>, bool);

fn files(axes: &[Vec<f64>], rate_hz: u32) -> Files {
    let axes: Vec<&[f64]> = axes.iter().map(Vec::as_slice).collect();
    Files(vec![("take.wav", wav(&axes, rate_hz))], false)
}

fn one(signal: Vec<f64>) -> Files {
    files(&[signal], RATE_HZ)
}

/// A set with the take and a copy of it.
fn two(original: &[f64], copy: &[f64]) -> Files {
    let [original, copy] = [original, copy].map(|signal| wav(&[signal], RATE_HZ));
    Files(vec![("first.wav", original), ("take.wav", copy)], false)
}

/// A take of a surface: the surface, its seed, and its samples at the models' rate.
struct Take<'a> {
    surface: &'a Surface,
    seed: u64,
    clean: Vec<f64>,
}

impl<'a> Take<'a> {
    fn of(surface: &'a Surface, seed: u64) -> Self {
        let clean = surface.take(seed, RATE_HZ, SECONDS);
        Self { surface, seed, clean }
    }

    fn other(&self, number: u64) -> Vec<f64> {
        let seed = 1000 + 10 * self.seed + number;
        self.surface.take(seed, RATE_HZ, SECONDS)
    }

    /// The take after `edit` was applied to its samples.
    fn edited(&self, edit: impl FnOnce(&mut Vec<f64>)) -> Files {
        let mut signal = self.clean.clone();
        edit(&mut signal);
        one(signal)
    }
}

/// Expected result for one kind of damage at one strength.
#[derive(Clone, Copy)]
enum Expected {
    /// A verdict of this name is reported.
    Caught(&'static str),
    /// The set is refused with an error that contains this word.
    Refused(&'static str),
    /// No verdict is reported, because the fitted spectrum changes by no more than this, dB (mean over third-octave
    /// bands).
    Weak(f64),
    /// A verdict of this name is reported, or none if the spectrum changes by no more than this, dB.
    Either(&'static str, f64),
    /// No verdict is reported, because a real texture may look the same. The spectrum changes by no more than this, dB.
    Alike(f64),
}

use Expected::{Alike, Caught, Either, Refused, Weak};

type Damage = fn(&Take<'_>, usize) -> Files;

/// Number of strengths: weak, middle, strong.
const STRENGTHS: usize = 3;

fn sample(at_s: f64) -> usize {
    (at_s * f64::from(RATE_HZ)) as usize
}

/// Fills `count` evenly spread stretches of `seconds` with `value` of their first sample.
fn held(signal: &mut [f64], count: usize, seconds: f64, value: impl Fn(f64) -> f64) {
    for number in 0..count {
        let first = (2 * number + 1) * signal.len() / (2 * count);
        let end = first + sample(seconds).max(1);
        let fill = value(signal[first]);
        signal[first..end].fill(fill);
    }
}

fn taps(signal: &mut [f64], times: &[f64], height: f64) {
    for &time in times {
        for n in 0..200 {
            let decay = (-(n as f64) / 50.0).exp();
            signal[sample(time) + n] += height * decay * (0.6 * n as f64).sin();
        }
    }
}

fn hum(take: &Take<'_>, strength: usize, lines: &[(f64, f64)]) -> Files {
    // The factor is relative to the RMS of the take.
    let amplitude = 0.5 * 2f64.sqrt() * [0.01, 0.3, 1.0][strength];
    let sum = |time: f64| {
        let of = |&(hz, gain): &(f64, f64)| tone(hz, gain * amplitude)(time);
        lines.iter().map(of).sum::<f64>()
    };
    one(plus(&take.clean, sum, RATE_HZ))
}

fn clipped(signal: &[f64], share: f64) -> Vec<f64> {
    let limit = quantile(signal, share);
    signal.iter().map(|x| x.clamp(-limit, limit)).collect()
}

/// Three axes, each with its own mixture of the take and another one.
fn three_axes(take: &Take<'_>) -> [Vec<f64>; 3] {
    let mix = |own: f64, number: u64, gain: f64| -> Vec<f64> {
        take.clean
            .iter()
            .zip(take.other(number))
            .map(|(a, b)| own * a + gain * b)
            .collect()
    };
    [mix(1.0, 1, 0.2), mix(0.4, 2, 0.3), mix(-0.6, 3, 0.2)]
}

#[rustfmt::skip]
const KINDS: [(&str, Damage, [Expected; STRENGTHS]); 27] = [
    ("NaN", |t, s| t.edited(|x| x[sample(1.0)..][..[1, 10, 100][s]].fill(f64::NAN)), [Refused("finite"); 3]),
    ("hard clipping", |t, s| one(clipped(&t.clean, [4e-4, 0.01, 0.1][s])),
        [Weak(0.5), Caught("clipped"), Caught("clipped")]),
    ("soft saturation", |t, s| {
        let knee = 0.5 * [12.0, 6.0, 3.0][s];
        one(t.clean.iter().map(|x| knee * (x / knee).tanh()).collect())
    }, [Weak(0.5), Weak(1.0), Alike(2.5)]),
    ("silence", |t, s| t.edited(|x| match s {
        0 => x.iter_mut().for_each(|x| *x *= 1e-3),
        1 => x.fill(0.25),
        _ => x.fill(0.0),
    }), [Caught("silent"); 3]),
    ("silent beginning", |t, s| t.edited(|x| x[..sample([0.05, 0.3, 1.5][s])].fill(0.0)),
        [Weak(0.5), Caught("partly-silent"), Caught("partly-silent")]),
    ("lift-off", |t, s| t.edited(|x| {
        let part = sample(1.0)..sample(1.0 + [0.1, 0.6, 1.5][s]);
        let floor = noise(t.seed + 5, part.len());
        x[part].iter_mut().zip(floor).for_each(|(x, n)| *x = 0.005 * n);
    }), [Weak(0.5), Caught("partly-silent"), Caught("partly-silent")]),
    ("dropouts", |t, s| t.edited(|x| held(x, [5, 5, 20][s], [1e-3, 5e-3, 20e-3][s], |_| 0.0)),
        [Weak(0.5), Caught("dropouts"), Caught("dropouts")]),
    ("lost samples", |t, s| t.edited(|x| {
        for place in (1..=5).rev() {
            let first = place * x.len() / 6;
            x.drain(first..first + [5, 50, 500][s]);
        }
    }), [Weak(0.5), Weak(0.5), Weak(1.5)]),
    ("repeated block", |t, s| t.edited(|x| {
        let (first, length) = (sample(2.0), sample([0.01, 0.05, 0.2][s]));
        let (before, after) = x.split_at_mut(first);
        after[..length].copy_from_slice(&before[first - length..]);
    }), [Weak(0.3), Weak(0.5), Weak(1.0)]),
    ("stuck converter", |t, s| t.edited(|x| held(x, [5, 5, 20][s], [1e-3, 5e-3, 20e-3][s], |x| x + 0.1)),
        [Weak(0.5), Caught("stuck"), Caught("stuck")]),
    ("coarse steps", |t, s| {
        let step = [0.02, 0.35, 1.0][s];
        one(t.clean.iter().map(|x| (x / step).round() * step).collect())
    }, [Weak(2.0), Caught("coarse"), Caught("coarse")]),
    ("spikes", |t, s| t.edited(|x| {
        let height = [1.5, 30.0, 300.0][s];
        (1..=5).for_each(|place| x[place * 3301] += height);
    }), [Weak(0.7), Caught("spikes"), Caught("spikes")]),
    ("wild samples on one axis", |t, s| {
        let [x, mut y, z] = three_axes(t);
        let height = [0.2, 10.0, 30.0][s];
        y[9000..9012].iter_mut().zip(noise(t.seed, 12)).for_each(|(y, n)| *y = height * n);
        files(&[x, y, z], RATE_HZ)
    }, [Weak(2.0), Caught("bursts"), Caught("bursts")]),
    ("tap", |t, s| t.edited(|x| taps(x, &[1.5], [1.0, 25.0, 80.0][s])), [Weak(0.5), Caught("tap"), Caught("tap")]),
    ("level step", |t, s| t.edited(|x| {
        let gain = 10f64.powf([3.0, 24.0, 36.0][s] / 20.0);
        x[sample(2.0)..].iter_mut().for_each(|x| *x *= gain);
        x.iter_mut().for_each(|x| *x /= gain.sqrt());
    }), [Alike(3.0), Caught("level-change"), Caught("level-change")]),
    ("wrong units, whole set", |t, s| one(scaled(&t.clean, [10.0, 300.0, 1000.0][s])),
        [Alike(21.0), Caught("scale"), Refused("check scale_m_s2")]),
    ("wrong units, one trial", |t, s| {
        let own = scaled(&t.clean, [0.1, 5.0, 100.0][s]);
        let others = [1, 2, 3].map(|number| scaled(&t.other(number), 0.2));
        let names = ["a.wav", "b.wav", "c.wav"];
        let mut all: Vec<_> = names.into_iter().zip(&others).map(|(n, x)| (n, wav(&[x], RATE_HZ))).collect();
        let own = if s == 2 { scaled(&own, 0.5) } else { own };
        all.push(("take.wav", wav(&[&own], RATE_HZ)));
        Files(all, true)
    }, [Alike(50.0), Alike(50.0), Caught("scale")]),
    ("drift", |t, s| {
        let slope = 0.5 * 12f64.sqrt() * [0.05, 0.5, 2.0][s];
        one(plus(&t.clean, |time| slope * (time / SECONDS - 0.5), RATE_HZ))
    }, [Weak(0.3), Caught("drifting"), Caught("drifting")]),
    ("slow motion", |t, s| {
        let gain = 0.7 * [0.1, 1.2, 3.0][s];
        one(plus(&t.clean, |time| tone(2.3, gain)(time) + tone(4.1, gain)(time), RATE_HZ))
    }, [Weak(0.5), Caught("wandering"), Caught("wandering")]),
    ("offset", |t, s| one(plus(&t.clean, |_| [0.1, 9.81, 100.0][s], RATE_HZ)),
        [Weak(0.01), Weak(0.01), Caught("scale")]),
    ("hum at 50 Hz", |t, s| hum(t, s, &[(50.0, 1.0)]), [Weak(0.5), Either("hum", 1.5), Caught("hum")]),
    ("hum at 60 Hz with harmonics", |t, s| hum(t, s, &[(60.0, 1.0), (120.0, 0.5), (180.0, 0.4), (300.0, 0.2)]),
        [Weak(0.5), Either("hum", 1.5), Caught("hum")]),
    ("whistle at 733 Hz", |t, s| hum(t, s, &[(733.0, 1.0)]), [Weak(1.0), Alike(4.0), Alike(8.0)]),
    ("sensor noise added", |t, s| {
        let level = 0.5 * [0.01, 0.03, 0.1][s];
        one(t.clean.iter().zip(noise(t.seed + 9, t.clean.len())).map(|(x, n)| x + level * n).collect())
    }, [Weak(1.0), Weak(2.0), Alike(6.0)]),
    ("exact duplicate", |t, s| {
        let length = sample([0.5, 2.0, 4.0][s]);
        two(&t.clean[..length], &t.clean[..length])
    }, [Caught("duplicate"); 3]),
    ("dead axis", |t, s| {
        let [x, y, z] = three_axes(t);
        let floor = scaled(&noise(t.seed, x.len()), [5e-3, 5e-5, 0.0][s]);
        assert_eq!(z.len(), floor.len());
        files(&[x, y, plus(&floor, |_| 0.3, RATE_HZ)], RATE_HZ)
    }, [Alike(2.0), Caught("dead-axis"), Caught("dead-axis")]),
    ("too short", |t, s| t.edited(|x| x.truncate(sample([0.3, 0.1, 0.02][s]))), [Caught("too-short"); 3]),
];

/// Fits the files. Each is a texture of its own unless they share one.
fn fitted(files: &Files) -> Result<Fit, String> {
    let bench = Bench::new();
    let mut list = String::from("file,texture,speed_mm_s,force_n,duration_s\n");
    for (number, (name, bytes)) in files.0.iter().enumerate() {
        bench.write(name, bytes);
        let (texture, duration) = if files.1 {
            ("felt".to_owned(), "")
        } else {
            (format!("t{number}"), "4")
        };
        let speed = 50 * (number + 1);
        writeln!(list, "{name},{texture},{speed},1,{duration}").unwrap();
    }
    bench.write("trials.csv", list);
    // These options leave out everything that does not involve triage.
    let options = Options {
        order: Order::Fixed(80),
        excitation: ExcitationChoice::Gaussian,
        lines: Lines::None,
        ..Options::default()
    };
    let set = RecordingSet::open(&[bench.path("trials.csv")]).map_err(|e| e.to_string())?;
    fit::fit(&set, &options, |_| ()).map_err(|e| e.to_string())
}

/// Levels of an autoregressive model in third-octave bands from 31.5 to 1000 Hz, dB.
fn levels(model: &Model) -> Vec<f64> {
    let a = step_up(&model.reflection);
    let gain = model.output_power * error_share(&model.reflection);
    (-15..=0)
        .map(|band| {
            let centre = 1000.0 * 2f64.powf(f64::from(band) / 3.0);
            let power = |step: i32| {
                let omega = TAU * centre * 2f64.powf(f64::from(step) / 60.0) / f64::from(RATE_HZ);
                let (mut re, mut im) = (1.0, 0.0);
                for (a, n) in a.iter().zip(1..) {
                    let (sin, cos) = (omega * f64::from(n)).sin_cos();
                    (re, im) = (re + a * cos, im + a * sin);
                }
                gain / (re * re + im * im)
            };
            10.0 * (-10..=10).map(power).sum::<f64>().log10()
        })
        .collect()
}

fn last_model(fit: &Fit) -> &Model {
    let grid = &fit.textures.last().unwrap().grid;
    grid.models.last().unwrap()
}

fn names(fit: &Fit) -> Vec<&'static str> {
    let verdicts = &fit.trials.last().unwrap().verdicts;
    verdicts.iter().map(Verdict::name).collect()
}

#[test]
fn signals_shaped_like_real_takes_have_no_verdict() {
    let mut kurtoses = Vec::new();
    for (index, surface) in SURFACES.iter().enumerate() {
        for seed in 0..2 {
            let take = surface.take(20 + seed, RATE_HZ, SECONDS);
            kurtoses.push(kurtosis(&take));
            let of_logger = resample(std::slice::from_ref(&take), RATE_HZ, 3200).remove(0);
            for (signal, rate_hz) in [
                (of_logger, 3200),
                (take, RATE_HZ),
                (surface.take(40 + seed, FAST_HZ, 2.0), FAST_HZ),
            ] {
                let fit = fitted(&files(&[signal], rate_hz)).unwrap();
                let case = format!("surface {index}, seed {seed}, {rate_hz} Hz");
                assert_eq!(fit.trials[0].verdicts, [], "{case}");
            }
        }
        let take = Take::of(surface, 9);
        let fit = fitted(&files(&three_axes(&take), RATE_HZ)).unwrap();
        assert_eq!(fit.trials[0].verdicts, [], "surface {index}, three axes");
    }
    kurtoses.sort_by(f64::total_cmp);
    let median = kurtoses[kurtoses.len() / 2];
    assert!((8.0..18.0).contains(&median), "{kurtoses:?}");
}

/// Uses one of the three surfaces for each kind.
#[test]
fn damage_of_each_kind_is_found_at_the_strengths_that_matter() {
    judge_damage(false);
}

/// Uses all three surfaces: `cargo test --locked -p host-tools --test end-to-end triage:: -- --ignored --nocapture`.
#[test]
#[ignore = "long: 400 fits"]
fn damage_is_found_on_every_surface() {
    judge_damage(true);
}

fn judge_damage(on_every_surface: bool) {
    let takes: Vec<Take<'_>> = SURFACES
        .iter()
        .zip(1..)
        .map(|(surface, seed)| Take::of(surface, seed))
        .collect();
    let clean: Vec<Vec<f64>> = takes
        .iter()
        .map(|take| fitted(&one(take.clean.clone())))
        .map(|fit| levels(last_model(&fit.unwrap())))
        .collect();
    let mut wrong = Vec::new();
    for (number, (kind, damage, expected)) in KINDS.into_iter().enumerate() {
        let is_judged = |surface: usize| on_every_surface || surface == number % SURFACES.len();
        for (strength, expected) in expected.into_iter().enumerate() {
            for (take, clean) in (0..takes.len())
                .filter(|&surface| is_judged(surface))
                .map(|surface| (&takes[surface], &clean[surface]))
            {
                let outcome = fitted(&damage(take, strength));
                let change_db = |fit: &Fit| {
                    let levels = levels(last_model(fit));
                    clean.iter().zip(&levels).map(|(a, b)| (a - b).abs()).sum::<f64>() / levels.len() as f64
                };
                let passes = |fit: &Fit, bound_db| names(fit).is_empty() && change_db(fit) <= bound_db;
                let has = |fit: &Fit, name| names(fit).iter().any(|found| found.starts_with(name));
                let is_right = match (&outcome, expected) {
                    (Err(message), Refused(word)) => message.contains(word),
                    (Ok(fit), Caught(name)) => has(fit, name),
                    (Ok(fit), Either(name, bound_db)) => has(fit, name) || passes(fit, bound_db),
                    (Ok(fit), Weak(bound_db) | Alike(bound_db)) => passes(fit, bound_db),
                    _ => false,
                };
                if !is_right {
                    let said = match &outcome {
                        Ok(fit) => format!("{}, {:.2} dB", names(fit).join("+"), change_db(fit)),
                        Err(message) => message.clone(),
                    };
                    wrong.push(format!("{kind}, strength {strength}: {said}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Reads a file with this content as the only recording of a set.
fn read(content: &str) -> Result<Vec<Vec<f64>>, String> {
    let bench = Bench::new();
    bench.write("a.csv", content);
    let mut set = RecordingSet::open(&[bench.path("a.csv")]).map_err(|e| e.to_string())?;
    set.trials[0].sample_rate_hz = Some(5000.0);
    Ok(host_tools::recording::read(&set.trials[0])
        .map_err(|e| e.to_string())?
        .axes)
}

#[test]
fn tables_that_hold_no_accelerations_are_named_with_the_remedy() {
    let counted = (0..20).fold(String::new(), |text, n| text + &format!("{n},0.5\n"));
    let hand = "time_s,x,speed_mm_s,force_n\n0,1,100,1\n";
    let since = "time since start,x\n0,1\n0.1,2\n";
    for (content, words) in [
        (hand, &["speed_mm_s", "--strokes"][..]),
        (since, &["'time since start'", "time_ms"]),
        ("sample,ch1\n0,1\n1,2\n", &["'sample'", "remove column 1"]),
        ("a,b,c,d\n1,2,3,4\n", &["4 columns", "comma", "1 to 3"]),
        ("x,y\n1,2\n1,oops\n", &["line 3", "'oops'", "column 2"]),
        ("x,y\n1,\n1,NA\n", &["column 2", "no numbers"]),
        ("sample,x\n7,1\n8,2\n11,3\n", &["line 4", "11 after 8", "column 1"]),
        (&counted, &["no header", "counts", "time_s"]),
    ] {
        let message = read(content).unwrap_err();
        holds(&message, words);
        assert_eq!(message.lines().count(), 1, "{message}");
    }
}
