//! A fit to all of a free hand's strokes, in four steps:
//!
//! 1. **Levels** ([`levels`]): least squares over windows of 100 ms gives the levels of all nodes. Each window counts
//!    for the nodes around its motion with the weights that the device uses.
//! 2. **Trials** ([`pieces`]): the samples that are nearest to a node are scaled to the node's level and joined into
//!    one trial at the node. The trials are fitted like any others: triage, order, quantisation, excitation.
//! 3. **Levels again**: every node of the fitted grid gets a level as in the first step, even where there is no trial.
//! 4. **Playing**: the texture is played along the strokes, and all levels are shifted by its mean error. The reason is
//!    that an excitation with impulses or a changing level has a lower mean level in dB than its power suggests.
//!
//! Before all of these, lines tied to position are found along the strokes and taken out of them. They join the texture
//! with an amplitude per node, by least squares as in the first step.

use std::path::PathBuf;

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::motion_law::LevelAt;
use stylus_dsp::reduction::Reduction;
use stylus_dsp::sums::mean;
use stylus_signals::recording::freehand::Freehand;
use stylus_signals::recording::triage::Verdict;
use stylus_signals::recording::{RecordingSet, Snap};
use stylus_support::Warning;
use stylus_support::in_order::in_order;
use stylus_support::names::portable;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

mod levels;
mod pieces;
mod stroke;

use levels::{Axes, NodeLevels};
use stroke::Stroke;

use super::blocks::Part;
use super::conditioning::{Conditioning, HighPass};
use super::fitted::{Fit, FittedTexture, Source, encoded};
use super::lines::{Along, LineMember, Stretch, TrialLines, along, lines_on};
use super::options::{FloorChoice, Lines, Options};
use super::recordings::Recordings;
use super::{models, read};
use crate::texture::library::decoded;

/// Fits texture `name` to strokes, each with the file that it comes from. Calls `progress` for steps that are done. A
/// stroke that is given twice counts once.
///
/// # Errors
/// Strokes that give no node 0.4 s in motion and contact; a stroke that cannot be reduced to one axis; another rate
/// than 5 kHz; a request to subtract the rig's noise, or a recording of it; with [`Options::strict`] the first stroke
/// with a verdict; the errors of [`super::fit`].
pub fn fit_strokes(
    name: &str,
    strokes: &[(PathBuf, Freehand)],
    options: &Options,
    progress: impl Fn(usize) + Sync,
) -> Result<Fit> {
    check(options)?;
    let mut strokes = distinct(strokes, options.conditioning, &progress)?;
    if options.strict
        && let Some((stroke, verdict)) = first_verdict(&strokes)
    {
        let problem = format!("{verdict}; refused because of --strict");
        return Err(Error::file(&stroke.file, problem));
    }
    let lines = (options.lines != Lines::None).then(|| without_lines(&mut strokes));
    let windows: Vec<LevelAt> = (strokes.iter())
        .flat_map(|stroke| stroke.windows(options.silence_floor_m_s2))
        .collect();
    let trials = if windows.is_empty() {
        Vec::new()
    } else {
        let levels = NodeLevels::of(Axes::of(&windows), &windows);
        pieces::trials(name, &strokes, &levels)?
    };
    if trials.is_empty() {
        return Err(Error::Model(format!(
            "texture '{name}': no node has 0.4 s in motion and contact: record longer strokes"
        )));
    }
    let set = RecordingSet {
        trials,
        is_listed: true,
    };
    let options = of_trials(options, &strokes);
    let recordings = read(&set, &options, Part::Whole, usize::MAX, &|_| ())?;
    let mut fit = models(&set, &recordings, &options)?;
    fit.notes.extend(strokes.iter().flat_map(findings));
    let texture = &mut fit.textures[0];
    // Speeds and forces without a trial are not in the texture's grid any more.
    let levels = NodeLevels::of(Axes::of_grid(&texture.grid), &windows);
    texture.set_levels(&levels.levels_db);
    if let Some(lines) = &lines {
        add_lines(texture, lines);
    }
    let held: Vec<_> = recordings.into_iter().map(Recordings::into_takes).collect();
    let source = Source {
        set: &set,
        reports: &fit.trials,
        options: &options,
        part: Part::Whole,
    };
    source.excite(&mut fit.textures, held, &|| progress(0))?;
    level_by_playing(&mut fit.textures[0], &strokes)?;
    Ok(fit)
}

/// Takes the lines out of `strokes`.
fn without_lines(strokes: &mut [Stroke]) -> Along {
    let stretches = strokes.iter().flat_map(|stroke| {
        stroke.moving.iter().map(|run| Stretch {
            signal: &stroke.signal[run.clone()],
            motion: &stroke.motion[run.clone()],
        })
    });
    let mut found = along(&stretches.collect::<Vec<_>>());
    let mut rest = found.rest.drain(..);
    for stroke in strokes {
        for run in &stroke.moving {
            stroke.signal[run.clone()].copy_from_slice(&rest.next().expect("one per run"));
        }
    }
    drop(rest);
    found
}

/// Adds `lines` to `texture`, with their amplitudes at its nodes.
fn add_lines(texture: &mut FittedTexture, lines: &Along) {
    let axes = Axes::of_grid(&texture.grid);
    let of_line = |windows: &Vec<LevelAt>| {
        let is_shown = !windows.is_empty();
        is_shown.then(|| NodeLevels::of(axes.clone(), windows).levels_db)
    };
    let levels: Vec<Option<Vec<f64>>> = lines.levels.iter().map(of_line).collect();
    let at_node = |node: usize| TrialLines {
        amplitudes_m_s2: (levels.iter())
            .map(|levels_db| Some(10f64.powf(levels_db.as_ref()?[node] / 20.0)))
            .collect(),
        speed_ratio: None,
    };
    let nodes: Vec<TrialLines> = (0..axes.nodes().count()).map(at_node).collect();
    let members = axes
        .nodes()
        .zip(&nodes)
        .map(|((speed_mm_s, force_n), lines)| LineMember {
            speed_mm_s,
            force_n,
            is_silent: false,
            lines,
        });
    texture.grid.parts.lines = lines_on(&texture.grid, &lines.findings, &members.collect::<Vec<_>>());
    texture.lines = lines.findings.clone();
}

/// Refuses options that a fit to strokes does not support.
fn check(options: &Options) -> Result<()> {
    if options.sample_rate_hz != SAMPLE_RATE_HZ {
        return Err(Error::Request(format!(
            "strokes are fitted at {SAMPLE_RATE_HZ} Hz alone: leave out --model-rate"
        )));
    }
    if options.floor == FloorChoice::Subtract || options.floor_recording.is_some() {
        return Err(Error::Request(
            "the rig's noise is taken off trials alone, not off strokes: leave out --floor and --floor-recording"
                .into(),
        ));
    }
    Ok(())
}

/// Returns the first stroke with a finding, and that finding.
fn first_verdict(strokes: &[Stroke]) -> Option<(&Stroke, &Verdict)> {
    strokes
        .iter()
        .find_map(|stroke| Some((stroke, stroke.verdicts.first()?)))
}

/// Reads `strokes`, each only once. Calls `progress` for each that is done.
fn distinct(
    strokes: &[(PathBuf, Freehand)],
    conditioning: Conditioning,
    progress: &(impl Fn(usize) + Sync),
) -> Result<Vec<Stroke>> {
    let is_first = |(number, own): &(usize, &(PathBuf, Freehand))| {
        // By content, because one stroke may be in two files.
        let mut earlier = strokes[..*number].iter();
        !earlier.any(|(_, earlier)| *earlier == own.1)
    };
    let first: Vec<_> = strokes.iter().enumerate().filter(is_first).collect();
    in_order(&first, |(_, (file, recording))| {
        let stroke = Stroke::of(file, recording, conditioning);
        progress(1);
        stroke
    })
}

/// Returns the findings on `stroke`: those of triage, and jumps of the speed.
fn findings(stroke: &Stroke) -> impl Iterator<Item = Warning> {
    let file = portable(&stroke.file);
    let note = move |text: String| Warning::of("stroke", ("recording", &file), 0.0, text);
    let jumps = stroke.jumps_s.first().map(|first_s| {
        format!(
            "the speed jumps in {} of 20 ms, first at {first_s:.2} s: left out; check the encoder",
            counted(stroke.jumps_s.len(), "block")
        )
    });
    stroke.verdicts.iter().map(Verdict::to_string).chain(jumps).map(note)
}

/// Returns the `options` for trials that are made of `strokes`: reduced to one axis, and filtered if any stroke was, so
/// that the band that the filter removed is filled in.
fn of_trials(options: &Options, strokes: &[Stroke]) -> Options {
    let cuts_hz = strokes.iter().filter_map(|stroke| stroke.cut_hz);
    Options {
        conditioning: Conditioning {
            reduction: Reduction::Pca,
            // The highest cut-off: below it, not every stroke has a signal.
            high_pass: cuts_hz.reduce(f64::max).map_or(HighPass::None, HighPass::At),
        },
        lines: Lines::None,
        floor: FloorChoice::None,
        snap: Snap::NONE,
        ..options.clone()
    }
}

/// Shifts all levels of `texture` by its error along the `strokes`, averaged over windows. Neither has the lines here.
fn level_by_playing(texture: &mut FittedTexture, strokes: &[Stroke]) -> Result<()> {
    let lines = texture.grid.parts.lines.take();
    let bytes = encoded(&[texture.spec()])?;
    let library = decoded(&bytes)?;
    let played = library.textures().next().expect("it has one");
    let off_db = in_order(strokes, |stroke| stroke.over_db(played))?;
    let off_db = mean(&off_db.concat());
    // The level of a silent node is infinite; `set_levels` skips it.
    let levels: Vec<f64> = (texture.grid.models.iter())
        .map(|model| 10.0 * model.output_power.log10() + off_db)
        .collect();
    texture.set_levels(&levels);
    texture.grid.parts.lines = lines;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use test_helpers::{near, noise};

    use super::super::options::{ExcitationChoice, Order};
    use super::*;

    const RATE_HZ: f64 = 5000.0;

    /// RMS of the surface, m/s². It saturates with the speed.
    fn law(speed_mm_s: f64, force_n: f64) -> f64 {
        2.0 * speed_mm_s / (speed_mm_s + 100.0) * force_n.sqrt()
    }

    /// A hand's stroke of 8 s over a surface of white noise.
    fn stroke(seed: u64) -> Freehand {
        let signal = noise(seed, 8 * RATE_HZ as usize);
        let motion = |n: usize| {
            let (time_s, phase) = (n as f64 / RATE_HZ, seed as f64);
            let speed = 100.0 + 80.0 * (1.7 * time_s + phase).sin();
            (speed, 1.0 + 0.6 * (0.9 * time_s + 2.0 * phase).cos())
        };
        let motion: Vec<(f64, f64)> = (0..signal.len()).map(motion).collect();
        let axis = signal
            .iter()
            .zip(&motion)
            .map(|(x, &(speed, force))| x * law(speed, force));
        Freehand {
            rate_hz: RATE_HZ,
            axes: vec![axis.collect()],
            is_outlier: vec![false; signal.len()],
            is_backward: vec![false; signal.len()],
            speed_mm_s: motion.iter().map(|at| at.0).collect(),
            force_n: motion.iter().map(|at| at.1).collect(),
            outlier: None,
            is_simulated: true,
            is_unscaled: false,
            remarks: Vec::new(),
        }
    }

    /// Returns the `stroke` with the motion of a hand added: at 5 Hz, because of which a fit filters it, and at 21 Hz,
    /// which the filter leaves.
    fn with_motion(mut stroke: Freehand) -> Freehand {
        for (n, x) in stroke.axes[0].iter_mut().enumerate() {
            let turns = TAU * n as f64 / RATE_HZ;
            *x += 4.0 * (5.0 * turns).sin() + 2.0 * (21.0 * turns).sin();
        }
        stroke
    }

    /// Returns the levels of the nodes relative to those of the surface, dB.
    fn over_law_db(fit: &Fit) -> Vec<f64> {
        fit.textures[0]
            .grid
            .nodes()
            .map(|(speed, force, model)| {
                10.0 * model.output_power.log10() - 20.0 * law(f64::from(speed), f64::from(force)).log10()
            })
            .collect()
    }

    fn fitted(seeds: &[u64], felt: fn(Freehand) -> Freehand) -> Fit {
        let options = Options {
            order: Order::Fixed(4),
            excitation: ExcitationChoice::Gaussian,
            ..Options::default()
        };
        let file = |seed: u64| PathBuf::from(format!("{seed}.csv"));
        let strokes: Vec<_> = (seeds.iter()).map(|&seed| (file(seed), felt(stroke(seed)))).collect();
        fit_strokes("felt", &strokes, &options, |_| ()).unwrap()
    }

    #[test]
    fn nodes_have_the_level_of_the_surface_and_a_stroke_that_is_given_twice_changes_nothing() {
        let once = fitted(&[1, 2, 3, 4], |stroke| stroke);
        let off_db = over_law_db(&once);
        let rms_db = mean(&off_db.iter().map(|off| off * off).collect::<Vec<_>>()).sqrt();
        assert!(rms_db < 0.8, "{off_db:?}");
        assert!(mean(&off_db).abs() < 0.4, "{off_db:?}");
        let twice = fitted(&[1, 2, 2, 3, 1, 4], |stroke| stroke);
        assert_eq!(once.library().unwrap(), twice.library().unwrap());
    }

    /// Amplitude of a grating's line, m/s². It rises with speed and force otherwise than the level does.
    fn grating(speed_mm_s: f64, force_n: f64) -> f64 {
        0.8 * (speed_mm_s / 100.0) * force_n
    }

    /// Returns the `stroke` with a hum of 50 Hz.
    fn with_hum(mut stroke: Freehand) -> Freehand {
        for (n, x) in stroke.axes[0].iter_mut().enumerate() {
            *x += 0.2 * (TAU * 50.0 * n as f64 / RATE_HZ).sin();
        }
        stroke
    }

    /// Returns the `stroke` with a grating and its second harmonic, which is half as strong and a quarter of a turn
    /// ahead.
    fn with_grating(mut stroke: Freehand, wavelength_mm: f64) -> Freehand {
        let mut place_mm = 0.0;
        for (n, x) in stroke.axes[0].iter_mut().enumerate() {
            let (speed, force) = (stroke.speed_mm_s[n], stroke.force_n[n]);
            place_mm += speed / RATE_HZ;
            let turns = TAU * place_mm / wavelength_mm;
            *x += grating(speed, force) * (turns.sin() + 0.5 * (2.0 * turns).cos());
        }
        stroke
    }

    #[test]
    fn gratings_along_strokes_are_found_at_their_pitch_and_level_and_leave_the_noise_as_it_was() {
        for (wavelength_mm, with) in [
            (0.5, (|stroke| with_grating(stroke, 0.5)) as fn(Freehand) -> Freehand),
            (1.3, |stroke| with_grating(stroke, 1.3)),
            (3.0, |stroke| with_grating(stroke, 3.0)),
        ] {
            let fit = fitted(&[1, 2, 3], with);
            let texture = &fit.textures[0];
            let lines = texture.grid.parts.lines.as_ref().expect("lines are found");
            assert_eq!(lines.lines.len(), 2, "{}", texture.lines);
            for (line, (share, number)) in lines.lines.iter().zip([(1.0, 1.0), (0.5, 2.0)]) {
                let pitch = number * f64::from(line.wavelength_mm) / wavelength_mm;
                assert!((pitch - 1.0).abs() < 5e-3, "{}", texture.lines);
                for ((speed, force, _), &amplitude) in texture.grid.nodes().zip(&line.amplitudes) {
                    let truth = share * grating(f64::from(speed), f64::from(force));
                    let off_db = 20.0 * (f64::from(amplitude) / truth).log10();
                    // A slower hand hides the line by its own motion.
                    if f64::from(speed) > 40.0 {
                        assert!(
                            off_db.abs() < 1.0,
                            "{off_db} dB at {speed} mm/s, {force} N: {}",
                            texture.lines
                        );
                    }
                }
            }
            let turns = f64::from(lines.lines[1].phase) / 65_536.0;
            near(turns, 0.25, 0.02);
            let plain = over_law_db(&fitted(&[1, 2, 3], |stroke| stroke));
            let speeds = texture.grid.nodes().map(|(speed, ..)| speed);
            for ((own, plain), speed) in over_law_db(&fit).iter().zip(&plain).zip(speeds) {
                if speed > 40.0 {
                    let close = (own - plain).abs() < 1.0;
                    assert!(close, "{own} for {plain} dB at {speed} mm/s: {}", texture.lines);
                }
            }
        }
    }

    /// Returns the `stroke` with a weave of 0.7 mm, whose threads wander by 1.5 rad over 6 mm.
    fn with_weave(mut stroke: Freehand) -> Freehand {
        // Steps of the wander's grid per mm, and the grid's length.
        let (per_mm, length_mm) = (10.0, 2000.0);
        let white = noise(99, (per_mm * length_mm) as usize);
        let reach = (3.0 * 6.0 * per_mm) as isize;
        let kernel: Vec<f64> = (-reach..=reach)
            .map(|at| (-(at as f64 / per_mm / 6.0).powi(2)).exp())
            .collect();
        let energy: f64 = kernel.iter().map(|k| k * k).sum();
        let wander: Vec<f64> = (white.windows(kernel.len()))
            .map(|own| own.iter().zip(&kernel).map(|(x, k)| x * k).sum::<f64>() / energy.sqrt())
            .collect();
        let mut place_mm = 0.0;
        for (n, x) in stroke.axes[0].iter_mut().enumerate() {
            let (speed, force) = (stroke.speed_mm_s[n], stroke.force_n[n]);
            place_mm += speed / RATE_HZ;
            let phase = TAU * place_mm / 0.7 + 1.5 * wander[(place_mm * per_mm) as usize];
            *x += 3.0 * law(speed, force) * phase.sin();
        }
        stroke
    }

    #[test]
    fn a_weave_along_strokes_is_found_with_its_wander_and_its_amplitude() {
        let fit = fitted(&[1, 2, 3, 4], with_weave);
        let texture = &fit.textures[0];
        let lines = texture.grid.parts.lines.as_ref().expect("a line is found");
        let line = &lines.lines[0];
        for ((speed, force, _), &amplitude) in texture.grid.nodes().zip(&line.amplitudes) {
            let truth = 3.0 * law(f64::from(speed), f64::from(force));
            eprintln!(
                "{speed} {force} {:.2} dB",
                20.0 * (f64::from(amplitude) / truth).log10()
            );
        }
        eprintln!("{:.2?}", over_law_db(&fit));
        near(f64::from(line.wavelength_mm) / 0.7, 1.0, 0.01);
        assert_eq!(line.wander, Some(0), "{}", texture.lines);
    }

    #[test]
    fn no_line_is_found_in_strokes_over_noise_and_hum() {
        for seed in 1..=6 {
            let fit = fitted(&[seed, seed + 20], with_hum);
            let texture = &fit.textures[0];
            assert!(
                texture.lines.lines.is_empty() && texture.grid.parts.lines.is_none(),
                "{}",
                texture.lines
            );
        }
    }

    #[test]
    fn a_hands_motion_that_the_filter_leaves_makes_no_node_louder() {
        let off_db = over_law_db(&fitted(&[1, 2, 3, 4], with_motion));
        assert!(mean(&off_db).abs() < 0.4, "{off_db:?}");
    }

    #[test]
    fn what_a_fit_to_strokes_does_not_do_is_refused_and_a_strict_one_takes_no_findings() {
        let mut stuck = stroke(1);
        stuck.axes[0][20_000..20_200].fill(0.7);
        let strokes = [(PathBuf::from("a.csv"), stuck)];
        let refused = |options: Options| fit_strokes("felt", &strokes, &options, |_| ()).unwrap_err().to_string();
        let strict = refused(Options {
            strict: true,
            ..Options::default()
        });
        assert!(strict.starts_with("a.csv: ") && strict.contains("--strict"), "{strict}");
        let subtracted = refused(Options {
            floor: FloorChoice::Subtract,
            ..Options::default()
        });
        assert!(subtracted.contains("leave out --floor"), "{subtracted}");
        let fast = refused(Options {
            sample_rate_hz: 10_000,
            ..Options::default()
        });
        assert!(fast.contains("leave out --model-rate"), "{fast}");
    }

    #[test]
    fn strokes_below_the_models_rate_have_no_events_where_their_stretches_join() {
        let slow = |seed| {
            let Freehand {
                axes,
                speed_mm_s,
                force_n,
                ..
            } = stroke(seed);
            // Every other sample of white noise is white noise.
            let half = |values: &[f64]| values.iter().copied().step_by(2).collect::<Vec<f64>>();
            let axis = half(&axes[0]);
            let strokes = Freehand {
                rate_hz: RATE_HZ / 2.0,
                is_outlier: vec![false; axis.len()],
                is_backward: vec![false; axis.len()],
                axes: vec![axis],
                speed_mm_s: half(&speed_mm_s),
                force_n: half(&force_n),
                ..stroke(seed)
            };
            (PathBuf::from(format!("{seed}.csv")), strokes)
        };
        let fit = fit_strokes("felt", &[1, 2, 3, 4].map(slow), &Options::default(), |_| ()).unwrap();
        let notes: Vec<String> = fit.warnings().iter().map(ToString::to_string).collect();
        assert!(!notes.iter().any(|note| note.contains("in no codebook")), "{notes:#?}");
    }

    #[test]
    fn strokes_that_never_touch_the_surface_are_refused_with_the_remedy() {
        let mut lifted = stroke(1);
        lifted.force_n.fill(0.0);
        let strokes = [(PathBuf::from("a.csv"), lifted)];
        let refused = fit_strokes("felt", &strokes, &Options::default(), |_| ()).unwrap_err();
        assert!(refused.to_string().contains("record longer strokes"), "{refused}");
    }
}
