//! Verdicts on a trial that do not need other trials.

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::high_pass::SLOW_HZ;
use stylus_dsp::sums::{Moments, moments, sum_of};
use stylus_dsp::wide;
use stylus_support::number::counted;

use super::level;
use super::scale::{SILENCE_FLOOR_M_S2, scale};
use super::verdict::{Kind, Span, Verdict};
use crate::recording::defects::{Defects, Truncation};
use crate::recording::trial::Samples;

/// Number of samples below which a trial is too short: 0.4 s at 5 kHz.
pub const SHORT_SAMPLES: usize = 2000;

/// Lowest sample rate, Hz, of a file that contains what skin feels, up to 1 kHz (Verrillo 1963), with a margin of a
/// tenth for the logger's filter.
pub const LEAST_RATE_HZ: f64 = 2200.0;

/// Fraction of samples at the extremes from which on a recording counts as clipped.
pub const CLIPPED_SHARE: f64 = 1e-3;

/// Fraction of an axis's energy, explained by a straight line, from which on a recording counts as drifting.
pub const DRIFT_SHARE: f64 = 0.05;

/// Least fraction of the energy below [`SLOW_HZ`] in a wandering trial. A fit would then use its first coefficients for
/// the slow motion.
const SLOW_SHARE: f64 = 0.25;

/// Number of samples on either side that a spike disturbs when the file is resampled.
const SPIKE_REACH: usize = 20;

/// Number of samples at each end of a resampled file that depend on what is assumed beyond it: 20 ms.
const END_REACH: usize = 100;

/// Least ratio of the signal to the round-off of its steps, dB. Below it, round-off becomes noticeable in the quiet
/// bands of a texture, which are about 40 dB below its strong bands.
pub const COARSE_SNR_DB: f64 = 20.0;

/// Returns the verdicts that do not need other trials, except [silence](Verdict::silent), which depends on the
/// reduction. The [`slow_share`](Samples::slow_share) of the samples is an argument, because it takes the most time and
/// is needed elsewhere, too.
pub fn samples(samples: &Samples, slow_share: f64) -> Vec<Verdict> {
    let axes = samples.axes.as_slice();
    let mut verdicts = of_file(samples);
    let moments: Vec<Moments> = axes.iter().map(|axis| moments(axis)).collect();
    verdicts.extend(scale(&moments, &samples.account));
    let power: f64 = moments.iter().map(|axis| axis.variance).sum();
    // In a silent trial, only a drift can be judged.
    if power.sqrt() >= SILENCE_FLOOR_M_S2 {
        verdicts.extend(of_defects(samples));
        verdicts.extend(dead_axes(&moments));
        verdicts.extend(level::verdicts(axes));
        verdicts.extend(wandering(axes, slow_share, samples.source_rate_hz));
    }
    let share = worst(axes, drift_share);
    if share >= DRIFT_SHARE {
        let words = format!("drifting: {:.0} % of energy", 100.0 * share);
        verdicts.push(Verdict::new(Kind::Drifting, words));
    }
    verdicts
}

/// Returns the verdict on slow motion, which has the fraction `share` of the power of all axes together.
fn wandering(axes: &[Vec<f64>], share: f64, source_rate_hz: f64) -> Option<Verdict> {
    let is_short = axes.first().map_or(0, Vec::len) < SHORT_SAMPLES;
    // Of a slow sensor's band, even a flat spectrum has much below 10 Hz.
    let least = SLOW_SHARE.max(2.0 * SLOW_HZ / (source_rate_hz / 2.0));
    (share >= least && !is_short).then(|| {
        let percent = 100.0 * share;
        let words = format!("wandering: {percent:.0} % of energy below {SLOW_HZ} Hz");
        Verdict::new(Kind::Wandering, words)
    })
}

/// Returns the verdicts on length, rate and completeness.
fn of_file(samples: &Samples) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let count = samples.axes.first().map_or(0, Vec::len);
    if count < SHORT_SAMPLES {
        let words = format!("too short: {count} samples");
        verdicts.push(Verdict::new(Kind::TooShort, words));
    }
    let rate_hz = samples.source_rate_hz;
    if rate_hz < LEAST_RATE_HZ {
        let words = format!("wrong rate: {rate_hz} Hz, nothing above {} Hz", rate_hz / 2.0);
        verdicts.push(Verdict::new(Kind::WrongRate, words));
    }
    verdicts.extend(of_times(samples));
    if let Some(Truncation { declared, held }) = samples.defects.truncation {
        let words = format!("truncated: the file holds {held} of {declared} samples");
        verdicts.push(Verdict::new(Kind::Truncated, words));
    }
    verdicts
}

/// Returns the verdicts on the times of a file's samples.
fn of_times(samples: &Samples) -> Vec<Verdict> {
    let (timing, length) = (&samples.defects.timing, samples.axes.first().map_or(0, Vec::len));
    let mut verdicts = Vec::new();
    let mut found = |kind, words: String| verdicts.push(Verdict::new(kind, words));
    if let Some(unit) = timing.guessed_unit {
        let words = format!("times: taken for {}, because of their steps", unit.name());
        found(Kind::TimeUnit, words);
    }
    if timing.joined_rows > 0 {
        let rows = counted(timing.joined_rows, "row");
        found(Kind::Joined, format!("joined: {rows} of other sensors taken out"));
    }
    if let Some(size) = timing.bunch {
        let words = format!("bunches: times come in bunches of {size}, and were taken for the samples' own");
        found(Kind::Bunches, words);
    }
    let (lost, all) = (counted(timing.lost, "sample"), timing.samples);
    let lost = format!("{lost} of {all} missing one by one, interpolated");
    let mut gaps: Vec<Span> = timing
        .gaps
        .iter()
        .map(|gap| span(gap.start_s, gap.seconds, SPIKE_REACH, length))
        .collect();
    // The margins may let neighbouring gaps overlap.
    gaps.dedup_by(|next, last| {
        let meets = next.start <= last.end;
        last.end = if meets { next.end } else { last.end };
        meets
    });
    if gaps.is_empty() && timing.lost > 0 {
        verdicts.push(Verdict::new(Kind::Dropouts, format!("dropouts: {lost}")));
    } else if !gaps.is_empty() {
        let verdict = Verdict::on(Kind::Dropouts, "gaps in the times", gaps);
        let lost = if timing.lost > 0 {
            format!(", and {lost}")
        } else {
            String::new()
        };
        verdicts.push(verdict.with(&lost));
    }
    verdicts
}

/// Returns the samples at the models' rate, out of `length`, that a time span of the file covers with a margin.
fn span(start_s: f64, seconds: f64, margin: usize, length: usize) -> Span {
    let at = |time_s: f64| (time_s * f64::from(SAMPLE_RATE_HZ)) as usize;
    at(start_s).saturating_sub(margin).min(length)..(at(start_s + seconds) + margin + 1).min(length)
}

/// Returns the stretches of a trial with these `verdicts` that do not come from a surface, even if a fit uses them:
/// those that triage would cut, the ends of a resampled file, and every clipped peak, even if there are too few for a
/// verdict. They are in order of their starts.
pub fn flaws(samples: &Samples, verdicts: &[Verdict]) -> Vec<Span> {
    let length = samples.axes.first().map_or(0, Vec::len);
    let clips = samples
        .defects
        .clips
        .iter()
        .map(|clip| span(clip.start_s, clip.seconds, SPIKE_REACH, length));
    let found = verdicts.iter().flat_map(|verdict| verdict.spans().iter().cloned());
    let is_resampled = (samples.source_rate_hz - f64::from(SAMPLE_RATE_HZ)).abs() > 0.0;
    let ends = [0..END_REACH.min(length), length.saturating_sub(END_REACH)..length]
        .into_iter()
        .filter(|_| is_resampled);
    let mut flaws: Vec<Span> = found.chain(clips).chain(ends).collect();
    flaws.sort_by_key(|flaw| flaw.start);
    flaws
}

/// Returns the verdicts on defects that are visible only at the file's own rate.
fn of_defects(samples: &Samples) -> Vec<Verdict> {
    let defects = &samples.defects;
    let length = samples.axes.first().map_or(0, Vec::len);
    let span = |start_s, seconds, margin| span(start_s, seconds, margin, length);
    let holds = |is_zero: bool| -> Vec<Span> {
        defects
            .holds
            .iter()
            .filter(|hold| hold.is_zero == is_zero)
            .map(|hold| span(hold.start_s, hold.seconds, 0))
            .collect()
    };
    let mut verdicts = Vec::new();
    let shares = [
        (defects.clipped_share, ""),
        (defects.rounded_share, " at tops of one height, which a filter rounded"),
    ];
    if let Some((share, how)) = shares.into_iter().find(|(share, _)| *share >= CLIPPED_SHARE) {
        let words = format!("clipped: {:.2} % of samples{how}", 100.0 * share);
        verdicts.push(Verdict::new(Kind::Clipped, words));
    }
    if let Some(read_hz) = defects.read_at_hz {
        let own_hz = samples.source_rate_hz;
        let words = format!(
            "repeated: values of {own_hz} Hz held at {read_hz:.0} Hz, nothing above {:.0} Hz",
            own_hz / 2.0
        );
        verdicts.push(Verdict::new(Kind::Repeated, words));
    }
    for (kind, name, spans) in [
        (Kind::Dropouts, "dropouts", holds(true)),
        (Kind::Stuck, "stuck", holds(false)),
    ] {
        if !spans.is_empty() {
            verdicts.push(Verdict::on(kind, name, spans));
        }
    }
    verdicts.extend(of_wild_samples(defects, span));
    if defects.quantisation_snr_db < COARSE_SNR_DB {
        let snr_db = defects.quantisation_snr_db;
        let words = format!("coarse: its steps are {snr_db:.0} dB below it");
        verdicts.push(Verdict::new(Kind::Coarse, words));
    }
    verdicts
}

/// Returns the verdicts on spikes and bursts. `span` converts a time, a duration and a margin to samples.
fn of_wild_samples(defects: &Defects, span: impl Fn(f64, f64, usize) -> Span) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let (spikes, bursts) = (&defects.spikes, &defects.bursts);
    if !spikes.is_empty() {
        let ratio = spikes.iter().map(|spike| spike.ratio).fold(0.0, f64::max);
        let spans = spikes.iter().map(|spike| span(spike.time_s, 0.0, SPIKE_REACH));
        let words = format!(", up to {ratio:.0} times what is around");
        verdicts.push(Verdict::on(Kind::Spikes, "spikes", spans.collect()).with(&words));
    }
    if let Some(first) = bursts.first() {
        let ratio = bursts.iter().map(|burst| burst.ratio).fold(0.0, f64::max);
        let mut spans: Vec<Span> = bursts
            .iter()
            .map(|burst| span(burst.start_s, burst.seconds, SPIKE_REACH))
            .collect();
        spans.sort_by_key(|span| span.start);
        let axis = if bursts.iter().all(|burst| burst.axis == first.axis) {
            format!("axis {}", first.axis)
        } else {
            "one axis at a time".to_owned()
        };
        let words = format!(", on {axis}, up to {ratio:.0} times as unpredictable as all else");
        verdicts.push(Verdict::on(Kind::Bursts, "bursts", spans).with(&words));
    }
    verdicts
}

fn worst(axes: &[Vec<f64>], measure: fn(&[f64]) -> f64) -> f64 {
    axes.iter().map(|axis| measure(axis)).fold(0.0, f64::max)
}

/// Length of a chunk that the compiler keeps in vector registers.
const LANES: usize = 8;

/// Returns the fraction of the energy about the mean that a straight line explains.
fn drift_share(axis: &[f64]) -> f64 {
    let n = axis.len() as f64;
    // The first sample is subtracted, so that a large offset costs no digits.
    let first = axis.first().copied().unwrap_or(0.0);
    let (mut sum, mut moment) = (0.0, 0.0);
    // One moment per chunk is enough, because the line's rise within a chunk is negligible compared with the chunk's
    // scatter.
    for (index, chunk) in axis.chunks(LANES).enumerate() {
        let chunk_sum: f64 = chunk.iter().map(|x| x - first).sum();
        let middle = (index * LANES) as f64 + (chunk.len() as f64 - 1.0) / 2.0;
        sum += chunk_sum;
        moment += chunk_sum * (middle - (n - 1.0) / 2.0);
    }
    let square = wide(
        #[inline(always)]
        || sum_of(axis, |x| (x - first) * (x - first)),
    );
    let energy = square - sum * sum / n;
    let line = 12.0 * moment * moment / (n * (n * n - 1.0));
    // An energy below the round-off of the sums counts as zero.
    if energy > 1e-12 * square && line.is_finite() {
        line / energy
    } else {
        0.0
    }
}

/// Ratio of the RMS of a dead axis to that of the strongest axis. The cross-axis sensitivity of accelerometers is about
/// one per cent, so an axis that is 60 dB below another does not measure even that.
const DEAD_RATIO: f64 = 1e-3;

/// Returns the verdicts on dead axes of a trial whose axes have these `moments`.
fn dead_axes(moments: &[Moments]) -> Vec<Verdict> {
    let rms = |axis: &Moments| axis.variance.sqrt();
    let strongest = moments.iter().map(rms).fold(0.0, f64::max);
    let mut verdicts = Vec::new();
    for (number, axis) in (1..).zip(moments) {
        if rms(axis) < DEAD_RATIO * strongest {
            let below_db = 20.0 * (strongest / rms(axis)).log10();
            let words = if below_db.is_finite() {
                format!("dead axis {number}: {below_db:.0} dB below the strongest")
            } else {
                format!("dead axis {number}: constant")
            };
            verdicts.push(Verdict::new(Kind::DeadAxis, words));
        }
    }
    verdicts
}
