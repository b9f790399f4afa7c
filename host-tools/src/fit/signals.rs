//! Signals that are kept from one step of a fit to the next, within a bound of memory.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::trial::Signal;

/// Memory of which parts are taken until there is none left.
pub(super) struct Budget(AtomicUsize);

impl Budget {
    pub fn of(bytes: usize) -> Self {
        Self(AtomicUsize::new(bytes))
    }

    /// Returns whether there were `bytes` left, which are taken then.
    pub fn takes(&self, bytes: usize) -> bool {
        let less = |left: usize| left.checked_sub(bytes);
        self.0
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, less)
            .is_ok()
    }
}

/// Signals of the trials of a set, as far as they are kept.
#[derive(Default)]
pub(super) struct KeptSignals(Vec<Option<Signal>>);

impl KeptSignals {
    /// The signals of all trials, in the order of the set.
    pub fn of(signals: Vec<Option<Signal>>) -> Self {
        Self(signals)
    }

    /// Returns the signal of a trial, if it is kept.
    pub fn get(&self, trial: usize) -> Option<&Signal> {
        self.0.get(trial)?.as_ref()
    }

    /// Returns whether the signals of all `trials` are kept.
    pub fn has_all(&self, trials: &[usize]) -> bool {
        trials.iter().all(|&trial| self.get(trial).is_some())
    }

    /// Keeps the signals of `trials`.
    pub fn extend(&mut self, trials: &[usize], signals: Vec<Signal>) {
        for (&trial, signal) in trials.iter().zip(signals) {
            if self.0.len() <= trial {
                self.0.resize_with(trial + 1, || None);
            }
            self.0[trial] = Some(signal);
        }
    }

    /// Lets go of the signals of `trials`.
    pub fn forget(&mut self, trials: &[usize]) {
        for &trial in trials {
            if let Some(signal) = self.0.get_mut(trial) {
                *signal = None;
            }
        }
    }
}
