//! Other takes on the command line: which of them judge, and which the fit has seen.

use std::path::Path;

use crate::cli::output::warn;
use host_tools::dsp::reduction::Reduction;
use host_tools::evaluation::held_out::{Judge, judges};
use host_tools::evaluation::takes::{Take, takes};
use host_tools::fit::record::FitRecord;
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;

/// The judge of each trial of a set, and the takes that judge nothing, with the reason.
pub struct Chosen {
    pub judges: Vec<Judge>,
    pub unused: Vec<String>,
}

/// Chooses the judges of `set` among the takes at `others`, if given, and warns of takes that the fit has seen.
pub fn choose(
    set: &RecordingSet,
    others: Option<&Path>,
    record: Option<&FitRecord>,
    reduction: Reduction,
) -> Result<Chosen> {
    let found = match others {
        Some(others) => {
            let others = RecordingSet::open(&[others.to_owned()])?;
            takes(set, &others, record, reduction)?
        }
        None => Vec::new(),
    };
    let unused: Vec<String> = found
        .iter()
        .filter_map(|take| match take {
            Take::Seen(reason) => Some(reason.clone()),
            Take::Other(_) => None,
        })
        .collect();
    for reason in &unused {
        warn(&format!("a take judges nothing: {reason}"));
    }
    Ok(Chosen {
        judges: judges(set, found, record)?,
        unused,
    })
}
