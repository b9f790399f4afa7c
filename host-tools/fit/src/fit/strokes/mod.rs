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
//! Lines tied to position are not sought, because the trials are joined stretches.

use std::path::PathBuf;

use model_format::SAMPLE_RATE_HZ;

mod levels;
mod pieces;
mod stroke;

use levels::{Axes, NodeLevels};
use stroke::Stroke;

use super::blocks::Part;
use super::conditioning::{Conditioning, HighPass};
use super::fitted::{Fit, FittedTexture, Source, encoded};
use super::lines::NoLines;
use super::options::{FloorChoice, Lines, Options};
use super::recordings::Recordings;
use super::{models, read};
use crate::dsp::motion_law::LevelAt;
use crate::dsp::reduction::Reduction;
use crate::dsp::sums::mean;
use crate::recording::freehand::Freehand;
use crate::recording::triage::Verdict;
use crate::recording::{RecordingSet, Snap};
use crate::support::error::{Error, Result};
use crate::support::file_name::portable;
use crate::support::in_order::in_order;
use crate::support::warning::Warning;
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
    let strokes = distinct(strokes, options.conditioning, &progress)?;
    if options.strict
        && let Some((stroke, verdict)) = first_verdict(&strokes)
    {
        let problem = format!("{verdict}; refused because of --strict");
        return Err(Error::file(&stroke.file, problem));
    }
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
    let held: Vec<_> = recordings.into_iter().map(Recordings::into_takes).collect();
    let source = Source {
        set: &set,
        reports: &fit.trials,
        options: &options,
        part: Part::Whole,
    };
    source.excite(&mut fit.textures, held, &|| progress(0))?;
    level_by_playing(&mut fit.textures[0], &strokes)?;
    fit.textures[0].lines.none_because = Some(NoLines::Strokes);
    Ok(fit)
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

/// Returns the findings of triage on `stroke`.
fn findings(stroke: &Stroke) -> impl Iterator<Item = Warning> {
    let file = portable(&stroke.file);
    let note = move |verdict: &Verdict| Warning::of("stroke", ("recording", &file), 0.0, verdict.to_string());
    stroke.verdicts.iter().map(note)
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

/// Shifts all levels of `texture` by its error along the `strokes`, averaged over windows.
fn level_by_playing(texture: &mut FittedTexture, strokes: &[Stroke]) -> Result<()> {
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
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use test_helpers::noise;

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
        let played = signal.iter().zip(&motion);
        let axis = played.map(|(x, &(speed, force))| x * law(speed, force));
        Freehand {
            rate_hz: RATE_HZ,
            axes: vec![axis.collect()],
            is_outlier: vec![false; signal.len()],
            is_backward: vec![false; signal.len()],
            speed_mm_s: motion.iter().map(|at| at.0).collect(),
            force_n: motion.iter().map(|at| at.1).collect(),
            outliers: Vec::new(),
            is_simulated: true,
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
        let over = fit.textures[0].grid.nodes().map(|(speed, force, model)| {
            10.0 * model.output_power.log10() - 20.0 * law(f64::from(speed), f64::from(force)).log10()
        });
        over.collect()
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
    fn strokes_that_never_touch_the_surface_are_refused_with_the_remedy() {
        let mut lifted = stroke(1);
        lifted.force_n.fill(0.0);
        let strokes = [(PathBuf::from("a.csv"), lifted)];
        let refused = fit_strokes("felt", &strokes, &Options::default(), |_| ()).unwrap_err();
        assert!(refused.to_string().contains("record longer strokes"), "{refused}");
    }
}
