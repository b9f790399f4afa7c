//! A part of a file, as the file has it.

/// Which part of a file to use, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Where it begins.
    pub start_s: f64,
    /// How long it is at most.
    pub duration_s: f64,
}

impl Cut {
    /// First frame and the one after the last, at `rate_hz`.
    pub(super) fn frames(&self, rate_hz: f64) -> (usize, usize) {
        let first = (self.start_s * rate_hz).round() as usize;
        let count = (self.duration_s * rate_hz).round() as usize;
        (first, first.saturating_add(count))
    }
}

/// What a file holds, at its own rate, from the cut's first frame on.
#[derive(Clone, Debug)]
pub struct Source {
    /// Its sample rate, Hz.
    pub rate_hz: f64,
    /// The frame that the channels begin at.
    pub first_frame: usize,
    /// One to three channels of one length.
    pub channels: Vec<Vec<f64>>,
}
