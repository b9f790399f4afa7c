//! From a recording set to the textures of a library, in five steps:
//!
//! 1. **Recordings** (`recordings`; `trial` does the work on each trial, `estimate` its lags), a texture at a time.
//!    Each trial is read, checked and cut by triage, high-passed if it holds slow motion, reduced to one axis, and
//!    correlated. The rig's own noise (`floor`) is measured in the texture's trials at 0 N, or in recordings that the
//!    user names, and subtracted if the user asks for it. Then the texture's lines are removed from its trials, except
//!    from trials that are silent, idle, cut by triage, or dropped by `--drop`. A trial's lags and third-octave bands
//!    are estimated again after its noise was subtracted, and after lines were removed from it. Only the power in its
//!    report remains that of the recording. Triage always sees 5 kHz; for another rate the trial is read a second time,
//!    and has neither lines nor excitation.
//! 2. **Reports** (`reports`). Copies are sought in the whole set. Within a texture, trials are compared by mains line,
//!    level and bands, which shows hum, wrong scales and trials unlike their neighbours. No model is made of a trial if
//!    its speed or force is 0, or if `--drop` names one of its verdicts. A verdict of this step comes too late for the
//!    noise and the lines: such a trial has already taken part in the search for them.
//! 3. **Models** (`grid` fits them, `fitted` holds what a texture has), a texture at a time. The lags of a node's
//!    trials that are not silent are pooled, and give one linear predictor. A trial over 6 dB above the median of three
//!    or more counts at the median. Under `auto` the order of each node is chosen by AIC, then lowered as far as the
//!    bands allow. Holes of the grid are filled, the nodes are quantised (`texture`), and the lines join them.
//! 4. **Room** (`fitted`). The bytes that the models and lines leave of a library are divided equally among the
//!    textures, up to a bound for each.
//! 5. **Excitation** ([`excitation`]), a texture at a time, from the residuals of its trials by the quantised models. A
//!    texture gets recorded snippets if a test finds that its output is not Gaussian noise. A node whose loudest
//!    moments would be more than half again as loud as those of its recordings is made softer. Steps 4 and 5 are left
//!    out if the user asks for Gaussian noise.
//!
//! **Memory.** Lags and bands of all trials are kept from step 1 to step 3, about 4 KB per trial. Step 1 needs the
//! signals of one texture, several times over while lines are sought. For step 5 the signals of a texture are kept if
//! they fit into what is left of `HELD_SIGNALS`; a set of one texture keeps all of them. The others are read again: all
//! trials of the texture, by the whole of step 1, if lines or the rig's noise were removed, and otherwise the used
//! trials, cut as before. Trials and nodes are computed in parallel, textures in turn.
//!
//! [`Fit::library`] encodes the result. The command snaps speeds and forces before step 1, and writes a [`record`] of
//! the fit beside the library.
//!
//! A fit of blocks, which `evaluate` judges, differs in the part of each recording that is fitted ([`blocks`]). Shards
//! ([`parts`]) write the results of step 1 to files; a last run merges them, and reads the recordings again for step 5.
//! A fit to a free hand ([`fit_strokes`]) takes the lines out of its strokes, makes trials of the rest, and sets the
//! nodes' levels before and after step 5.
//!
//! Invariant: recordings in, models and their textures out. Nothing here draws, prints or writes a file, except that
//! `parts` and `record` write their own.

use stylus_signals::recording::RecordingSet;
use stylus_support::Result;

pub mod blocks;
pub mod conditioning;
mod estimate;
pub mod excitation;
mod fitted;
mod floor;
mod grid;
pub mod hatt;
pub mod inputs;
pub mod lines;
mod notes;
mod options;
#[cfg(test)]
mod order_tests;
pub mod parts;
pub mod record;
mod recordings;
mod reports;
mod room;
mod strokes;
mod trial;

pub use estimate::carried_hz;
pub use fitted::{Fit, FittedTexture, encoded};
pub use floor::{FloorAtSpeed, by_speed};
pub use options::{ExcitationChoice, FloorChoice, Options, Order};
pub use recordings::{Recorded, Recordings};
pub use reports::TrialReport;
pub use strokes::fit_strokes;
pub use trial::{Analysis, FLOOR_BANDS, FloorShares, Signal, analyse, signal, whole_signal};

use blocks::Part;
use fitted::Source;

/// Memory for signals that are kept for step 5 instead of being read again, bytes.
const HELD_SIGNALS: usize = 128 << 20;

/// Fits `set` with the excitation that its recordings have. Calls `progress` with the number of trials whenever some
/// are done, and with 0 before step 5 and after each trial of it.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// The first trial that cannot be used; a texture of which no trial is used; with [`FloorChoice::Subtract`] a texture
/// whose rig's noise is not known; with [`Options::strict`] the first trial with a verdict; more models than a library
/// holds; options that [`Options::at_their_rate`] refuses.
pub fn fit(set: &RecordingSet, options: &Options, progress: impl Fn(usize) + Sync) -> Result<Fit> {
    let options = &options.at_their_rate()?;
    room::check(set, options)?;
    let most_held = match set.textures().len() {
        _ if !excitation::is_wanted(options) => 0,
        // Those of one texture are held while its lines are sought, and nothing else needs the room after that.
        0..=1 => usize::MAX,
        _ => HELD_SIGNALS,
    };
    let recordings = read(set, options, Part::Whole, most_held, &progress)?;
    fit_recordings(set, recordings, options, Part::Whole, &progress)
}

/// Reads the recordings of each texture of `set`, and analyses the `part` of them that is fitted. Calls `progress`
/// after each trial. At most `most_held` bytes of signals are kept, in addition to the texture that is being read.
///
/// # Errors
/// The first trial that cannot be used; with [`FloorChoice::Subtract`] a texture whose rig's noise is not known.
pub fn read<'s>(
    set: &'s RecordingSet,
    options: &Options,
    part: Part,
    most_held: usize,
    progress: &(impl Fn(usize) + Sync),
) -> Result<Vec<Recordings<'s>>> {
    let mut left = most_held;
    let textures = set.by_texture().into_iter().map(|(_, members)| {
        let mut own = Recordings::read(set, &members, options, part, progress)?;
        match left.checked_sub(own.held_bytes()) {
            Some(rest) => left = rest,
            // If step 5 needs these, it reads them again. A smaller texture may still fit.
            None => own.let_go(),
        }
        Ok(own)
    });
    textures.collect()
}

/// Fits models to the `recordings` of all textures of `set`, with Gaussian excitation. The recordings were read with
/// `options`, or with an order at least as high.
pub fn models(set: &RecordingSet, recordings: &[Recordings<'_>], options: &Options) -> Result<Fit> {
    let trials = reports::reports(recordings, options)?;
    let textures = recordings.iter().map(|own| FittedTexture::of(own, &trials, options));
    Ok(Fit {
        textures: textures.collect::<Result<_>>()?,
        notes: notes::of_set(set, &trials, options),
        trials,
    })
}

/// Fits models as [`models`] does, and adds what excites them in the same `part` of the recordings.
pub fn fit_recordings(
    set: &RecordingSet,
    recordings: Vec<Recordings<'_>>,
    options: &Options,
    part: Part,
    progress: &(impl Fn(usize) + Sync),
) -> Result<Fit> {
    let mut fit = models(set, &recordings, options)?;
    // Residuals need as much memory as the statistics, which are dropped here.
    let held: Vec<_> = recordings.into_iter().map(Recordings::into_takes).collect();
    progress(0);
    let source = Source {
        set,
        reports: &fit.trials,
        options,
        part,
    };
    source.excite(&mut fit.textures, held, &|| progress(0))?;
    Ok(fit)
}
