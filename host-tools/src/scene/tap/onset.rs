//! Onsets of impacts.

/// Least ratio of an impact to the noise's RMS.
const ABOVE_NOISE: f64 = 8.0;

/// Least magnitude of an impact, as a share of the recording's loudest sample.
const SHARE_OF_LOUDEST: f64 = 0.1;

/// Magnitude at the onset, as a share of the impact's loudest sample, if that is above the noise.
const SHARE_AT_ONSET: f64 = 0.03;

/// Least quiet time before an impact, s.
const QUIET_S: f64 = 0.025;

/// Longest time from the onset of an impact to its loudest sample, s.
const RISE_S: f64 = 0.01;

/// Positions of the first sample of each impact in `samples`, ascending.
///
/// An impact is louder than the noise and follows a quiet time. The noise's RMS is estimated from the median magnitude,
/// which is 0.6745 of the RMS of Gaussian noise.
pub fn onsets(samples: &[f64], rate_hz: f64) -> Vec<usize> {
    let mut magnitudes: Vec<f64> = samples.iter().map(|x| x.abs()).collect();
    let loudest = magnitudes.iter().copied().fold(0.0, f64::max);
    if !(loudest > 0.0 && loudest.is_finite()) {
        return Vec::new();
    }
    let middle = magnitudes.len() / 2;
    let (_, median, _) = magnitudes.select_nth_unstable_by(middle, f64::total_cmp);
    let noise = *median / 0.6745;
    let loud = (ABOVE_NOISE * noise).max(SHARE_OF_LOUDEST * loudest);
    let (quiet, rise) = ((QUIET_S * rate_hz) as usize, (RISE_S * rate_hz) as usize);
    let mut found = Vec::new();
    let mut last_loud: Option<usize> = None;
    for (at, sample) in samples.iter().enumerate() {
        if sample.abs() <= loud {
            continue;
        }
        if last_loud.is_none_or(|last| at - last > quiet) {
            let end = (at + rise).min(samples.len());
            let peak = samples[at..end]
                .iter()
                .fold(0.0f64, |peak, x| peak.max(x.abs()));
            let least = (3.0 * noise).max(SHARE_AT_ONSET * peak);
            let floor = last_loud
                .map_or(0, |last| last + 1)
                .max(at.saturating_sub(rise));
            let before = (floor..at).rev().find(|&n| samples[n].abs() <= least);
            found.push(before.unwrap_or(at));
        }
        last_loud = Some(at);
    }
    found
}
