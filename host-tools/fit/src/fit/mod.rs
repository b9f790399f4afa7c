//! From a recording set to the textures of a library, in five steps:
//!
//! 1. **Recordings** (`recordings`), a texture at a time: each trial is read, cut by triage, high-passed, reduced to
//!    one axis and correlated. For another rate than 5 kHz it is read a second time. The share of the rig's own noise
//!    (`floor`) is measured, and subtracted if that is asked for. The texture's lines are taken out of all its trials.
//!    Lags and third-octave bands are estimated up to three times: at first, without the noise, and without the lines.
//! 2. **Reports** (`reports`): all trials of the set are compared by waveform, mains line, level and bands, which tells
//!    copies, hum, wrong scales and trials unlike the others. No model is made of a trial if its speed or force is 0,
//!    or if `--drop` names a verdict on it. Its own verdicts keep it from the lines of step 1, too; those of this step
//!    come after them.
//! 3. **Models** (`fitted`), a texture at a time: the trials of a node are pooled, and give one linear predictor. Its
//!    order is chosen per node: under `auto` by AIC, then lowered as far as the bands allow. A trial 6 dB above the
//!    median of three or more counts at the median. Holes of the grid are filled, the lines join it, and all is
//!    quantised (`texture`).
//! 4. **Room** (`fitted`): what all models leave of a library is divided equally among the textures.
//! 5. **Excitation** ([`excitation`]), a texture at a time: codebooks and a level track from the residuals of its
//!    trials, by the quantised models. A node that would play louder than its recordings is made softer. Steps 4 and 5
//!    are left out where noise of steady level is asked for. Signals beyond 128 MiB are let go after step 1, and
//!    read again for this step.
//!
//! [`encoded`] writes the result as a library's bytes. The command snaps speeds and forces before step 1, densifies
//! after step 5, and keeps a [`record`] of the fit beside the library.
//!
//! A fit of blocks, which `evaluate` judges, differs in the part of each recording that is fitted ([`blocks`]). Shards
//! ([`parts`]) leave what the first step tells in files, and go on from there. [`densify`] makes the grids denser.
//! A fit to a free hand ([`fit_strokes`]) makes its trials itself, and sets the nodes' levels before and after.
//!
//! Invariant: recordings in, models and their textures out. Nothing here draws, prints or writes a file, except that
//! `parts` and `record` write their own.

use crate::recording::RecordingSet;
use crate::support::error::Result;

pub mod blocks;
pub mod conditioning;
pub mod densify;
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
mod strokes;
mod trial;

pub use estimate::carried_hz;
pub use fitted::{Fit, FittedTexture, encoded};
pub use floor::{FloorAtSpeed, by_speed};
pub use options::{ExcitationChoice, FloorChoice, ModulationChoice, Options, Order};
pub use recordings::{Recorded, Recordings};
pub use reports::TrialReport;
pub use strokes::fit_strokes;
pub use trial::{Analysis, FLOOR_BANDS, FloorShares, Signal, analyse, signal, whole_signal};

use blocks::Part;
use fitted::Source;

/// Memory for signals that wait for the last step in place of being read again, bytes.
const HELD_SIGNALS: usize = 128 << 20;

/// Fits `set` with the excitation that its recordings have, telling `progress` of the number of trials whenever some
/// are done, and of none between the later steps.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// The first trial that cannot be used; with [`Options::strict`] the first with a verdict; a texture that the chosen
/// library cannot hold; options that [`Options::check_rate`] refuses.
pub fn fit(set: &RecordingSet, options: &Options, progress: impl Fn(usize) + Sync) -> Result<Fit> {
    options.check_rate()?;
    let options = &options.at_their_rate();
    let most_held = match set.textures().len() {
        _ if !excitation::is_wanted(options) => 0,
        // Those of one texture are held while its lines are sought, and nothing else needs the room after that.
        0..=1 => usize::MAX,
        _ => HELD_SIGNALS,
    };
    let recordings = read(set, options, Part::Whole, most_held, &progress)?;
    fit_recordings(set, recordings, options, Part::Whole, &progress)
}

/// Reads the recordings of each texture of `set`, and analyses the `part` of them that is fitted, telling `progress` of
/// each trial done. Of all signals, `most_held` bytes are held at most, beside those of one texture.
///
/// # Errors
/// The first trial that cannot be used.
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
            None => own.let_go(),
        }
        Ok(own)
    });
    textures.collect()
}

/// Fits models to the `recordings` of all textures of `set`, with Gaussian excitation of steady level. The recordings
/// were read with `options`, or with an order at least as high.
///
/// # Errors
/// Those of [`fit`].
pub fn models(set: &RecordingSet, recordings: &[Recordings<'_>], options: &Options) -> Result<Fit> {
    let trials = reports::reports(recordings, options)?;
    let textures = recordings
        .iter()
        .map(|own| FittedTexture::of(own, &trials, options));
    Ok(Fit {
        textures: textures.collect::<Result<_>>()?,
        notes: notes::of_set(set, &trials, options),
        trials,
    })
}

/// Fits models as [`models`] does, and adds what excites them in the same `part` of the recordings.
///
/// # Errors
/// Those of [`fit`].
pub fn fit_recordings(
    set: &RecordingSet,
    recordings: Vec<Recordings<'_>>,
    options: &Options,
    part: Part,
    progress: &(impl Fn(usize) + Sync),
) -> Result<Fit> {
    let mut fit = models(set, &recordings, options)?;
    // Residuals need the room of the statistics.
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
