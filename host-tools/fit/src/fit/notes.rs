//! Notes on a fit about recordings that are not as they should be.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::high_pass::{SLOW_HZ, lowest_hz};
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::band_centre_hz;
use stylus_signals::recording::pattern::one_number;
use stylus_signals::recording::{
    GRAVITY_M_S2, GRAVITY_TOLERANCE, RecordingSet, Trial, Unscaled, grid_by_gaps, list_command,
};
use stylus_support::Warning;
use stylus_support::number::counted;

use super::floor::by_speed;
use super::grid::{AssembledGrid, LoudTrial, Member, Miss};
use super::options::{FloorChoice, Options, Order};
use super::reports::TrialReport;
use crate::fit::conditioning::HighPass;
use crate::texture::grid::{Grid, is_recorded};

/// Ratio of a recording's mean to its RMS above which the mean is no mere offset of an amplifier. It is gravity, which
/// needs no note, or the sensor is not what it is assumed to be.
const LARGE_MEAN: f64 = 1.0;

/// Fraction of the rig's noise in a third octave from which on there is a note: the noise is then at least as strong as
/// the texture.
const LARGE_FLOOR: f32 = 0.5;

/// Relative difference of two values of an axis below which they may be one nominal value that was measured twice.
const CLOSE_SHARE: f32 = 0.01;

/// Least number of nodes of a grid for which there is a note that most of them are filled in.
const SPARSE_NODES: usize = 12;

/// Least missing duration of a trial for which there is a note, s, and as a fraction of the duration.
const LACK_S: f64 = 0.005;
const LACK_SHARE: f64 = 0.001;

/// Returns the notes on texture `name`: on the grid that was `assembled`, on the `members` that were used, and on the
/// number of `idle` trials, which were not used because they are at rest or without contact.
pub(super) fn of(
    name: &str,
    assembled: &AssembledGrid,
    members: &[Member<'_>],
    idle: usize,
    options: &Options,
) -> Vec<Warning> {
    let AssembledGrid { grid, misses, loud } = assembled;
    let trials: Vec<&TrialReport> = members.iter().map(|m| m.report).collect();
    let note = |kind, size: f64, text| Warning::of_texture(kind, name, size, text);
    let left_out = (idle > 0).then(|| {
        let text = format!(
            "{} at speed 0 or force 0 without a node: the stylus is silent there. Label light contact 0.05 N",
            counted(idle, "trial")
        );
        note("idle", idle as f64, text)
    });
    let close = [
        close_values("speeds", &grid.speeds_mm_s, "mm/s"),
        close_values("forces", &grid.forces_n, "N"),
    ]
    .into_iter()
    .flatten();
    let lowered = lowered_orders(grid, options).map(|(nodes, order, speed, force)| {
        let text = format!(
            "{} of a lower order than was asked for, the lowest {order} at {speed} mm/s, {force} N: too few samples, \
             or a signal of a few lines, which higher orders only make ill-conditioned",
            counted(nodes, "node")
        );
        note("lower order", nodes as f64, text)
    });
    let is_gravity = |mean_m_s2: f64| (mean_m_s2 / GRAVITY_M_S2 - 1.0).abs() <= GRAVITY_TOLERANCE;
    let with_mean = trials
        .iter()
        .filter(|trial| trial.mean_m_s2 > LARGE_MEAN * trial.rms_m_s2 && !is_gravity(trial.mean_m_s2));
    let largest = with_mean.clone().map(|trial| trial.mean_m_s2).fold(0.0, f64::max);
    let removed = (largest > 0.0).then(|| {
        let text = format!(
            "a mean above the RMS, up to {largest:.3} m/s², was removed from {}",
            counted(with_mean.count(), "trial")
        );
        note("mean", largest, text)
    });
    let noted = |(kind, size, text): Noted| note(kind, size, text);
    left_out
        .into_iter()
        .chain(too_short(members, options).map(noted))
        .chain(mostly_filled(grid, &trials).map(noted))
        .chain(close.map(noted))
        .chain(lowered)
        .chain(removed)
        .chain(slow_motion(&trials).map(noted))
        .chain(rigs_noise(&trials, options).map(noted))
        .chain(missed_bands(misses, options).map(noted))
        .chain(loud.iter().map(loud_trial))
        .collect()
}

/// Kind, size and text of a note on a texture.
type Noted = (&'static str, f64, String);

/// Returns a note on slow motion, whether it was filtered out or not.
fn slow_motion(trials: &[&TrialReport]) -> Option<Noted> {
    let is_filtered = |trial: &&&TrialReport| trial.high_pass_hz.is_some();
    let is_advised = |trial: &&&TrialReport| HighPass::Auto.cut_hz(trial.slow_share).is_some() || is_filtered(trial);
    let moved: Vec<_> = trials.iter().filter(is_advised).collect();
    let share = moved.iter().map(|trial| trial.slow_share).reduce(f64::max)?;
    let turn_deg = moved.iter().map(|t| t.axis_turn_deg).fold(0.0, f64::max);
    let what = format!(
        ": up to {:.0} % of their power is below {SLOW_HZ} Hz, as of a hand's motion, and turns the main axis by up \
         to {turn_deg:.0}°",
        100.0 * share
    );
    // A cut-off that the user gave filters recordings without slow motion, too. Then there is none to describe.
    let what = if HighPass::Auto.cut_hz(share).is_some() {
        what
    } else {
        String::new()
    };
    let cut_hz = moved.iter().filter_map(|trial| trial.high_pass_hz).reduce(f64::max);
    let text = match cut_hz {
        Some(cut_hz) => {
            let low = lowest_hz(cut_hz);
            format!(
                "{} high-passed at {cut_hz} Hz{what}. Below {low:.0} Hz nothing is judged; --high-pass \
                 none keeps that motion",
                counted(
                    moved.iter().filter(|trial| trial.high_pass_hz.is_some()).count(),
                    "trial"
                )
            )
        }
        None => format!("{} fitted with slow motion{what}", counted(moved.len(), "trial")),
    };
    Some(("slow motion", share, text))
}

/// Returns a note on third octaves in which the rig's noise is as strong as the texture.
fn rigs_noise(trials: &[&TrialReport], options: &Options) -> Option<Noted> {
    let known = trials
        .iter()
        .filter_map(|t| Some((t.speed_mm_s, t.floor_shares.as_deref()?)));
    let bands = by_speed(known).into_iter().flat_map(|at| {
        at.shares
            .into_iter()
            .enumerate()
            .map(move |(band, share)| (share, band_centre_hz(band), at.speed_mm_s))
    });
    let loud: Vec<(f32, f64, f64)> = bands.filter(|(share, ..)| *share >= LARGE_FLOOR).collect();
    let (share, hz, speed_mm_s) = loud.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let fate = if options.floor == FloorChoice::Subtract {
        "it was taken off, and what is left there is uncertain"
    } else {
        "it is fitted as if it were the surface's; --floor subtract takes it off"
    };
    let text = format!(
        "the rig's own noise is half or more of {}, such as {:.0} % at {hz:.0} Hz and {speed_mm_s} mm/s: {fate}",
        counted(loud.len(), "third octave"),
        100.0 * share
    );
    Some(("rig", f64::from(share), text))
}

/// Returns a note on trials whose files end before the duration in their list.
fn too_short(members: &[Member<'_>], options: &Options) -> Option<Noted> {
    let short = members.iter().filter_map(|member| {
        // What triage cut was recorded, too: the file did not end early.
        let held_s = member.analysis.samples as f64 / f64::from(options.sample_rate_hz) + member.report.cut_s;
        let asked_s = member.trial.duration_s?;
        let lack_s = asked_s - held_s;
        (lack_s > LACK_S.max(LACK_SHARE * asked_s)).then_some((lack_s, held_s, asked_s, member))
    });
    let short: Vec<_> = short.collect();
    let (lack_s, held_s, asked_s, worst) = short.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let text = format!(
        "{} shorter than the duration that was asked for, such as {} with {held_s:.3} s of {asked_s} s: mend \
         duration_s in the list, or record for longer",
        counted(short.len(), "trial"),
        worst.report.file,
    );
    Some(("short", *lack_s, text))
}

/// Returns a note on a grid in which most nodes have no recording, with the tolerance that would make it dense.
fn mostly_filled(grid: &Grid, trials: &[&TrialReport]) -> Option<Noted> {
    let recorded = |places: &[(f64, f64)]| {
        // By their bits, because floating-point numbers have no hash.
        places
            .iter()
            .map(|(s, f)| (s.to_bits(), f.to_bits()))
            .collect::<HashSet<_>>()
            .len()
    };
    let measured: Vec<(f64, f64)> = trials.iter().map(|t| (t.speed_mm_s, t.force_n)).collect();
    let (nodes, with) = (grid.models.len(), recorded(&measured));
    if nodes < SPARSE_NODES || 2 * with >= nodes {
        return None;
    }
    let remedy = grid_by_gaps(&measured).map(|(speed, force)| {
        format!(
            "if they are measured values, --snap auto makes a grid of {} x {} of them and moves none by more than \
             {:.1} %",
            speed.values().len(),
            force.values().len(),
            100.0 * speed.largest_move().max(force.largest_move())
        )
    });
    let text = format!(
        "{} of {nodes} nodes of its grid of {} x {} are filled from neighbours, because few speeds and forces were \
         recorded together: {}",
        nodes - with,
        grid.speeds_mm_s.len(),
        grid.forces_n.len(),
        remedy.unwrap_or_else(|| "give nominal values in the list".to_owned())
    );
    Some(("filled", (nodes - with) as f64, text))
}

/// Returns a note on the closest values of an axis, if they are too close to be nominal values.
fn close_values(what: &'static str, values: &[f32], unit: &str) -> Option<Noted> {
    let close = values
        .windows(2)
        .filter(|pair| pair[1] - pair[0] < CLOSE_SHARE * pair[1]);
    let share = |pair: &&[f32]| (pair[1] - pair[0]) / pair[1];
    let closest = close.clone().min_by(|a, b| share(a).total_cmp(&share(b)))?;
    let pairs = close.count();
    let text = format!(
        "{} of {what} less than 1 % apart, such as {} and {} {unit}, with a line of nodes each: give nominal values in \
         the list, or --snap 0.01, if they are meant to be one",
        counted(pairs, "pair"),
        closest[0],
        closest[1]
    );
    Some((what, pairs as f64, text))
}

/// Returns a note on the bands that nodes miss.
fn missed_bands(misses: &[Miss], options: &Options) -> Option<Noted> {
    let level = |miss: &&Miss| miss.band.level_db.abs();
    let worst = misses.iter().max_by(|a, b| level(a).total_cmp(&level(b)))?;
    let remedy = match options.order {
        // No higher order exists, so only more data can help.
        Order::Fixed(model_format::limits::MAX_ORDER) => "record for longer",
        _ => "fit with --order 400, or record for longer",
    };
    let text = format!(
        "third octaves off their recording at {}, one by {:+.1} dB at {:.0} Hz, {} mm/s, {} N: {remedy}",
        counted(misses.len(), "node"),
        worst.band.level_db,
        worst.band.centre_hz,
        worst.speed_mm_s,
        worst.force_n
    );
    Some(("bands", level(&worst), text))
}

/// Returns the note on a trial that is far louder than the others of its node.
fn loud_trial(loud: &LoudTrial) -> Warning {
    let text = format!(
        "{:.1} dB above the median of its node's trials, at whose level it counts: listen to it, and leave it out or \
         record it again if it is another speed, force or scale",
        loud.over_db
    );
    Warning::of("loud trial", ("recording", &loud.file), loud.over_db, text)
}

/// Returns the number of measured nodes below the fixed order that was asked for, the lowest order, and its speed and
/// force.
fn lowered_orders(grid: &Grid, options: &Options) -> Option<(usize, usize, f32, f32)> {
    // Under `auto` and `bic` a low order is what was asked for.
    let Order::Fixed(asked) = options.order else {
        return None;
    };
    // Filled and silent nodes have the order of their neighbours.
    let is_lowered = |model: &Model| is_recorded(model.flags) && model.reflection.len() < asked;
    let lowered = || grid.nodes().filter(|(.., model)| is_lowered(model));
    let (speed, force, lowest) = lowered().min_by_key(|(.., model)| model.reflection.len())?;
    Some((lowered().count(), lowest.reflection.len(), speed, force))
}

/// Force above which a hand does not press a tool on a surface, N. Values in grams that are read as newtons are higher.
const LARGE_FORCE_N: f64 = 20.0;

/// Speed above which no hand strokes and no drum turns, mm/s.
const LARGE_SPEED_MM_S: f64 = 2000.0;

/// Speed below which nothing is stroked, mm/s. Values in metres per second that are read as millimetres per second are
/// lower.
const SMALL_SPEED_MM_S: f64 = 1.0;

/// Returns the notes on `set`, whose trials have these `reports`.
pub(super) fn of_set(set: &RecordingSet, reports: &[TrialReport], options: &Options) -> Vec<Warning> {
    let mut notes = Vec::new();
    if options.sample_rate_hz != SAMPLE_RATE_HZ {
        let text = format!(
            "at {} Hz nothing but Gaussian noise is fitted: snippets and lines are sought at \
             {SAMPLE_RATE_HZ} Hz alone",
            options.sample_rate_hz
        );
        notes.push(Warning::of_set("rate", text));
    }
    notes.extend(remarks(reports));
    notes.extend(missing_scales(reports));
    notes.extend(unlisted_speeds(set).map(|text| Warning::of_set("unlisted", text)));
    let motions = doubtful_motions(&set.trials);
    notes.extend(motions.into_iter().map(|(kind, text)| Warning::of_set(kind, text)));
    notes
}

/// Returns a note on recordings without a list whose names differ in one number only.
fn unlisted_speeds(set: &RecordingSet) -> Option<String> {
    // A list states the speeds.
    if set.is_listed {
        return None;
    }
    let names: Vec<&str> = set.trials.iter().map(|trial| trial.texture.as_str()).collect();
    let pattern = one_number(&names)?;
    let first = &set.trials[0];
    let folder = first.file.parent().unwrap_or(Path::new(""));
    let ending = first.file.extension().unwrap_or_default();
    Some(format!(
        "the names of {} recordings differ by one number alone, and each becomes a texture of its own, all at {} mm/s: \
         if they are speeds of one surface, make a list by `{}` and fit the folder",
        names.len(),
        first.speed_mm_s,
        list_command(folder, &pattern, &ending.to_string_lossy())
    ))
}

/// Returns notes on changes that were made to recordings when they were read, one note per kind of change.
fn remarks(reports: &[TrialReport]) -> Vec<Warning> {
    // Sorted by remark, so that the notes have one order in every run.
    let mut files: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for report in reports {
        for remark in &report.remarks {
            files.entry(remark).or_default().push(&report.file);
        }
    }
    let of_remark = |(remark, files): (&str, Vec<&str>)| {
        let text = match files[..] {
            [file] => format!("{file}: {remark}"),
            _ => format!("{} recordings, such as {}: {remark}", files.len(), files[0]),
        };
        Warning::of_set(remark.to_owned(), text)
    };
    files.into_iter().map(of_remark).collect()
}

/// Returns notes on recordings of which nothing states the acceleration.
fn missing_scales(reports: &[TrialReport]) -> Vec<Warning> {
    let kinds = [
        (
            Unscaled::OfFullScale,
            "the acceleration of their full scale",
            "98.1 for an accelerometer of ±10 g, or 1 for samples in m/s²; a microphone has none, so choose one for \
             all, such as 50: the level is then what you say it is",
        ),
        (
            Unscaled::Counts,
            "the acceleration of a count",
            "g/256, g/4096, g/8192 or g/16384 for so many counts per g of the sensor's data sheet",
        ),
    ];
    let of_kind = |(kind, what, example)| {
        let levels: Vec<f64> = reports
            .iter()
            .filter(|report| report.unscaled == Some(kind))
            .map(|report| report.rms_m_s2)
            .collect();
        let least = levels.iter().copied().reduce(f64::min)?;
        let largest = levels.iter().copied().fold(0.0, f64::max);
        // Compared as they are printed: levels that differ only in further digits are one to the reader.
        let [least, largest] = [least, largest].map(|level| format!("{level:.3}"));
        let level = if least == largest {
            format!("a level of {least}")
        } else {
            format!("levels of {least} to {largest}")
        };
        let text = format!(
            "{} of {} recordings hold samples without a unit, and no scale tells {what}: 1 m/s² is taken, which makes \
             {level} m/s² RMS; give --scale, or scale_m_s2 in the list, such as {example}",
            levels.len(),
            reports.len()
        );
        Some(Warning::of_set(what, text))
    };
    kinds.into_iter().filter_map(of_kind).collect()
}

/// Returns notes on speeds and forces that probably have another unit.
fn doubtful_motions(trials: &[Trial]) -> Vec<(&'static str, String)> {
    let largest = |of: fn(&Trial) -> f64| trials.iter().map(of).fold(0.0, f64::max);
    let (speed, force) = (largest(|t| t.speed_mm_s), largest(|t| t.force_n));
    let mut notes = Vec::new();
    if speed > LARGE_SPEED_MM_S {
        let text =
            format!("speeds reach {speed} mm/s, and hands and drums stay below {LARGE_SPEED_MM_S}: check speed_mm_s");
        notes.push(("fast", text));
    }
    // A set without motion has no speed whose unit could be wrong.
    if speed > 0.0 && speed < SMALL_SPEED_MM_S {
        let text = format!("no speed is above {speed} mm/s: are they in m/s? give speed_mm_s in mm/s");
        notes.push(("slow", text));
    }
    if force > LARGE_FORCE_N {
        let text = format!(
            "forces reach {force} N, and hands stay below {LARGE_FORCE_N}: are they in grams? give force_n in newtons"
        );
        notes.push(("strong", text));
    }
    notes
}
