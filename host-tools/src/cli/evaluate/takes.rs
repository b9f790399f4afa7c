//! Other takes on the command line: which of them judge, and which the fit has seen.

use std::path::Path;

use crate::cli::output::warn;
use host_tools::dsp::reduction::Reduction;
use host_tools::evaluation::held_out::{Chosen, chosen};
use host_tools::fit::record::FitRecord;
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;

/// `set` with the speeds and forces that the fit of this `record` took for its own.
///
/// # Errors
/// Values that its tolerance does not tell apart.
pub fn as_fitted(record: Option<&FitRecord>, set: RecordingSet) -> Result<RecordingSet> {
    match record {
        Some(record) => record.as_fitted(set),
        None => Ok(set),
    }
}

/// Chooses the judges of `set` among the takes at `others`, if given, and warns of takes that the fit has seen.
pub fn choose(
    set: &RecordingSet,
    others: Option<&Path>,
    record: Option<&FitRecord>,
    reduction: Reduction,
) -> Result<Chosen> {
    let others = match others {
        Some(others) => {
            let others = RecordingSet::open(&[others.to_owned()])?;
            Some(as_fitted(record, others)?)
        }
        None => None,
    };
    let chosen = chosen(set, others.as_ref(), record, reduction)?;
    for reason in &chosen.unused {
        warn(&format!("a take judges nothing: {reason}"));
    }
    Ok(chosen)
}
