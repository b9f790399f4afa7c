//! Tap transients from recordings: finds the impacts, and fits a decaying sine to each.
//!
//! At an impact the stylus plays a · exp(-t/τ) · sin(2πft), where a is the gain times the rate of force
//! ([`model_format::scene::Tap`]). Least squares fits f, τ and a to each impact of a recording. The common f and τ are
//! the medians, and the common gain is the slope of the least-squares line through the origin of amplitude over rate of
//! force.
//!
//! **Rate of force.** The stylus uses the larger of the rates over two update intervals: the interval in which contact
//! is detected, and the next ([`stylus_kernel::scene::Director`]). Here the rate is computed in the same way and
//! averaged over all possible positions of the contact within the update interval.

mod fit;
#[cfg(test)]
mod tests;

use std::io::Read;
use std::path::Path;

use model_format::scene::limits::{MAX_TAP_GAIN, MAX_TAP_M_S2, MAX_TAP_SHARE_OF_RATE, MIN_TAP_HZ, TAP_DECAY_S};
use serde::Serialize;
use stylus_dsp::liveliness::median;
use stylus_dsp::reduction::{Reduction, reduce};
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::ContactThreshold;
use stylus_signals::recording::{self, Trial, freehand};
use stylus_support::bounded_file::Format;
use stylus_support::csv_table::CsvTable;
use stylus_support::{Error, Result};

pub use fit::{Ringing, fit, onsets};

use model_format::SAMPLE_RATE_HZ;

/// Number of first bytes of a file in which its header is searched.
const MOST_HEADER_BYTES: u64 = 64 * 1024;

/// Longest part of a recording that is read, s.
const LONGEST_S: f64 = 600.0;

/// Longest window after an impact, s.
const WINDOW_S: f64 = 0.3;

/// Largest fraction of the power after an impact that a decaying sine may leave. If more is left, the impact is no tap.
const MAX_RESIDUAL: f64 = 0.5;

/// Number of samples, from the detected onset on, that are tried as the onset.
const LATEST_ONSET: usize = 3;

/// Ratio of a fit's residual to the best fit's up to which the fit counts as nearly as good.
const NEARLY_AS_WELL: f64 = 2.0;

/// Fraction of an impact's power that any fit may leave.
const NEGLIGIBLE_RESIDUAL: f64 = 1e-3;

/// Largest time between the contact that the force shows and the onset of the acceleration, s.
const CONTACT_WITHIN_S: f64 = 0.02;

/// Ratio of the amplitude limit to the loudest recorded tap.
const LIMIT_ROOM: f64 = 1.25;

/// A recording of taps.
#[derive(Clone, Debug, PartialEq)]
pub struct Taps {
    /// Name of the recording, for reports.
    pub name: String,
    /// Acceleration, m/s².
    pub samples_m_s2: Vec<f64>,
    /// Sample rate, Hz.
    pub rate_hz: f64,
    /// Force at each sample, N; `None` if it was not recorded.
    pub force_n: Option<Vec<f64>>,
    /// True for each sample that the file has out of range; empty if the file does not have the motion.
    pub is_outlier: Vec<bool>,
    /// Rate of force of all impacts, N/s; `None` if it is not known.
    pub force_rate_n_s: Option<f64>,
    /// True if the file says that it is simulated.
    pub is_simulated: bool,
    /// Remarks on the file, one per line.
    pub notes: Vec<String>,
}

/// One impact.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Impact {
    /// Name of the recording.
    pub recording: String,
    /// Onset, s.
    pub time_s: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Time constant of the decay, s.
    pub decay_s: f64,
    /// Amplitude at the onset, m/s².
    pub amplitude_m_s2: f64,
    /// Fraction of the power that the decaying sine leaves as residual.
    pub residual: f64,
    /// Rate of force at contact, N/s.
    pub force_rate_n_s: Option<f64>,
    /// Reason for leaving the impact out; `None` if it counts.
    pub left_out: Option<String>,
}

/// The tap that fits all impacts together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TapFit {
    /// The impacts, by recording and then by time.
    pub impacts: Vec<Impact>,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Time constant of the decay, s.
    pub decay_s: f64,
    /// Amplitude per rate of force, m/s² per N/s; `None` if no rate of force is known.
    pub gain_m_s2_per_n_s: Option<f64>,
    /// RMS deviation of the amplitudes from the gain's line, relative to the amplitudes' own RMS.
    pub gain_scatter: Option<f64>,
    /// Limit on the amplitude, m/s²: a quarter above the loudest impact, and at most what a scene can hold.
    pub limit_m_s2: f64,
    /// True if any recording is simulated.
    pub is_simulated: bool,
}

impl Taps {
    /// Reads a recording. A CSV file with a column `force_n` is a free hand's, as `stylus record --strokes` writes it,
    /// with `time_s` and `speed_mm_s`; any other file is read like by `fit`. `scale_m_s2` is the acceleration that a
    /// sample value of 1 means; if not given, the header's, or 1.
    pub fn read(path: &Path, scale_m_s2: Option<f64>, reduction: Reduction) -> Result<Self> {
        let name = path.display().to_string();
        let unusable = |error: stylus_dsp::reduction::NoSuchAxis| Error::file(path, error.to_string());
        if recording::Kind::of(path) == Some(recording::Kind::Table) && has_force(path)? {
            let mut recording = freehand::read(path, None, scale_m_s2)?;
            let notes = recording.notes(path);
            let reduced = reduce(&mut recording.axes, reduction).map_err(unusable)?;
            return Ok(Self {
                name,
                samples_m_s2: reduced.signal,
                rate_hz: recording.rate_hz,
                force_n: Some(recording.force_n),
                is_outlier: recording.is_outlier,
                force_rate_n_s: None,
                is_simulated: recording.is_simulated,
                notes,
            });
        }
        let trial = Trial {
            scale_m_s2,
            duration_s: Some(LONGEST_S),
            ..Trial::of(path.to_owned(), String::new(), 0.0, 0.0)
        };
        let mut samples = recording::read(&trial)?;
        let reduced = reduce(&mut samples.axes, reduction).map_err(unusable)?;
        let notes = samples.account.remarks.iter().chain(&samples.account.doubts);
        Ok(Self {
            name,
            samples_m_s2: reduced.signal,
            rate_hz: f64::from(SAMPLE_RATE_HZ),
            force_n: None,
            is_outlier: Vec::new(),
            force_rate_n_s: None,
            is_simulated: false,
            notes: notes.map(|note| format!("{}: {note}", path.display())).collect(),
        })
    }

    /// Returns the reason for leaving out an impact at sample `begin` that is fitted up to sample `end`, if a value is
    /// out of range in the fitted samples, or near the contact, where the force counts. Such a value was read as 0.
    fn outlier(&self, begin: usize, end: usize) -> Option<String> {
        let near = (2.0 * CONTACT_WITHIN_S * self.rate_hz) as usize;
        let end = end.max(begin + near).min(self.is_outlier.len());
        self.is_outlier
            .get(begin.saturating_sub(near)..end)?
            .contains(&true)
            .then(|| "values out of range".into())
    }

    fn impacts(&self) -> Vec<Impact> {
        let begins = onsets(&self.samples_m_s2, self.rate_hz);
        let longest = (WINDOW_S * self.rate_hz) as usize;
        let ends = begins.iter().skip(1).copied().chain([self.samples_m_s2.len()]);
        begins
            .iter()
            .zip(ends)
            .map(|(&begin, end)| {
                let (begin, ringing) = self.ringing(begin, end, longest);
                Impact {
                    recording: self.name.clone(),
                    time_s: begin as f64 / self.rate_hz,
                    frequency_hz: ringing.frequency_hz,
                    decay_s: ringing.decay_s,
                    amplitude_m_s2: ringing.amplitude,
                    residual: ringing.residual,
                    force_rate_n_s: self.force_rate_n_s.or_else(|| self.force_rate(begin)),
                    left_out: self
                        .outlier(begin, end.min(begin + longest))
                        .or_else(|| why_left_out(&ringing)),
                }
            })
            .collect()
    }

    /// Returns the onset of the impact that was found at sample `begin`, and the decaying sine that fits from there
    /// over at most `longest` samples, up to sample `end`.
    ///
    /// Noise may make an onset seem too early, and a decaying sine that begins too early fits badly. From the true
    /// onset on, it fits equally well from any later sample. So the onset is the first sample from which the sine fits
    /// nearly as well as from the next few.
    fn ringing(&self, begin: usize, end: usize, longest: usize) -> (usize, Ringing) {
        let tried: Vec<(usize, Ringing)> = (begin..end.min(begin + LATEST_ONSET))
            .map(|at| {
                let window = &self.samples_m_s2[at..end.min(at + longest)];
                (at, fit(window, self.rate_hz))
            })
            .collect();
        let least = tried
            .iter()
            .map(|(_, ringing)| ringing.residual)
            .fold(f64::INFINITY, f64::min);
        let fits = |(_, ringing): &&(usize, Ringing)| ringing.residual <= NEARLY_AS_WELL * least + NEGLIGIBLE_RESIDUAL;
        *tried.iter().find(fits).expect("one has the least residual")
    }

    /// Returns the rate of force of the contact near sample `begin`, N/s, as the stylus computes it; see the module's
    /// documentation.
    fn force_rate(&self, begin: usize) -> Option<f64> {
        let force = self.force_n.as_ref()?;
        let interval_s = f64::from(UPDATE_INTERVAL_SAMPLES) / f64::from(SAMPLE_RATE_HZ);
        let interval = ((interval_s * self.rate_hz).round() as usize).max(1);
        let within = (CONTACT_WITHIN_S * self.rate_hz) as usize;
        let bound = f64::from(ContactThreshold::LEAST.begins_n());
        let first = begin.saturating_sub(within).max(interval);
        let last = (begin + within).min(force.len().saturating_sub(2 * interval));
        let contact = (first..last).find(|&at| force[at - 1] <= bound && force[at] > bound)?;
        let rise = |end: usize| force[end] - force[end - interval];
        let rate = (contact..contact + interval)
            .map(|end| rise(end).max(rise(end + interval)))
            .sum::<f64>()
            / interval as f64
            / (interval as f64 / self.rate_hz);
        (rate > 0.0).then_some(rate)
    }
}

fn why_left_out(ringing: &Ringing) -> Option<String> {
    let highest_hz = f64::from(SAMPLE_RATE_HZ) * f64::from(MAX_TAP_SHARE_OF_RATE);
    let [shortest_s, longest_s] = TAP_DECAY_S.map(f64::from);
    if ringing.residual > MAX_RESIDUAL || ringing.residual.is_nan() {
        Some("no decaying sine".into())
    } else if !(f64::from(MIN_TAP_HZ)..=highest_hz).contains(&ringing.frequency_hz) {
        Some(format!("not from {MIN_TAP_HZ} to {highest_hz} Hz"))
    } else if !(shortest_s..=longest_s).contains(&ringing.decay_s) {
        Some(format!("no decay from {shortest_s} to {longest_s} s"))
    } else {
        None
    }
}

impl TapFit {
    /// Fits one tap to all impacts of `recordings`.
    ///
    /// # Errors
    /// Recordings without an impact, or in which no impact is followed by a decaying sine.
    pub fn new(recordings: &[Taps]) -> Result<Self> {
        let impacts: Vec<Impact> = recordings.iter().flat_map(Taps::impacts).collect();
        let counted = || impacts.iter().filter(|impact| impact.left_out.is_none());
        let middle = |of: fn(&Impact) -> f64| median(counted().map(of));
        let middles = middle(|impact| impact.frequency_hz).zip(middle(|impact| impact.decay_s));
        let Some((frequency_hz, decay_s)) = middles else {
            let problem = if impacts.is_empty() {
                "no impact is louder than the noise; record taps with a pause before each"
            } else {
                "no impact is followed by a decaying sine; record taps on something hard, without moving along it"
            };
            return Err(Error::Request(problem.into()));
        };
        let loudest = counted().map(|i| i.amplitude_m_s2).fold(0.0, f64::max);
        let rated: Vec<(f64, f64)> = counted()
            .filter_map(|impact| Some((impact.force_rate_n_s?, impact.amplitude_m_s2)))
            .collect();
        let (gain, scatter) = gain_through_origin(&rated).unzip();
        Ok(Self {
            frequency_hz,
            decay_s,
            gain_m_s2_per_n_s: gain.map(|gain: f64| gain.min(f64::from(MAX_TAP_GAIN))),
            gain_scatter: scatter,
            limit_m_s2: (LIMIT_ROOM * loudest).min(f64::from(MAX_TAP_M_S2)),
            is_simulated: recordings.iter().any(|recording| recording.is_simulated),
            impacts,
        })
    }
}

/// Returns the least-squares gain g of amplitudes = g · rates, and the RMS residual relative to the RMS amplitude.
fn gain_through_origin(rated: &[(f64, f64)]) -> Option<(f64, f64)> {
    let square: f64 = rated.iter().map(|(rate, _)| rate * rate).sum();
    let product: f64 = rated.iter().map(|(rate, amplitude)| rate * amplitude).sum();
    if square <= 0.0 {
        return None;
    }
    let gain = product / square;
    let off: f64 = rated.iter().map(|(rate, a)| (a - gain * rate).powi(2)).sum();
    let all: f64 = rated.iter().map(|(_, a)| a * a).sum();
    Some((gain, (off / all).sqrt()))
}

/// Returns true if the header of a CSV file has the column `force_n`.
fn has_force(path: &Path) -> Result<bool> {
    let file = Format::Wave.open(path)?;
    let mut bytes = Vec::new();
    file.take(MOST_HEADER_BYTES)
        .read_to_end(&mut bytes)
        .map_err(Error::io("read", path))?;
    Ok(CsvTable::of(path, String::from_utf8_lossy(&bytes).into_owned())?
        .header()?
        .exact_column("force_n")?
        .is_some())
}
