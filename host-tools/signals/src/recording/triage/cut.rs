//! Parts that triage leaves out of a fit: dropouts, spikes, taps and silent parts, if enough remains without them.

use super::verdict::{Kind, Span, Verdict};

/// Shortest part that is kept, in samples: 0.4 s. The longest lag of a model, 80 ms, is then at most a fifth of it.
pub const LEAST_KEPT: usize = 2000;

/// Shortest part that is kept, in samples, if only dropouts are cut because too few longer parts remain: 0.1 s. Nothing
/// can replace the samples of a dropout.
const LEAST_BETWEEN_GAPS: usize = 500;

/// Least fraction of a trial without its rests that must remain; otherwise nothing is cut.
const LEAST_SHARE: f64 = 0.5;

/// Number of samples over which two parts are joined: 10 ms.
const JOINT: usize = 50;

/// Returns the parts of a trial of `samples` samples that a fit uses: the whole trial, or what remains after its
/// verdicts.
///
/// If the parts of at least [`LEAST_KEPT`] samples contain less than half of what is not at rest, only dropouts are
/// cut, and shorter parts between them are kept. If less than half remains then, too, nothing is cut, and the verdicts
/// apply to the whole trial.
pub fn usable(verdicts: &[Verdict], samples: usize) -> Vec<Span> {
    let of = |kind| verdicts.iter().filter(move |verdict| verdict.kind() == kind);
    let rests = of(Kind::PartlySilent).flat_map(Verdict::spans);
    let moving = samples.saturating_sub(rests.map(ExactSizeIterator::len).sum());
    let least = |of: usize| LEAST_SHARE * of as f64;
    between(verdicts.iter(), samples, LEAST_KEPT, least(moving))
        .or_else(|| between(of(Kind::Dropouts), samples, LEAST_BETWEEN_GAPS, least(samples)))
        .unwrap_or_else(|| std::iter::once(0..samples).collect())
}

/// Returns the parts of `samples` samples that lie between the spans of `verdicts`, of at least `least` samples each;
/// `None` if together they contain fewer than `least_left`.
fn between<'a>(
    verdicts: impl Iterator<Item = &'a Verdict>,
    samples: usize,
    least: usize,
    least_left: f64,
) -> Option<Vec<Span>> {
    let mut cuts: Vec<Span> = verdicts.flat_map(|verdict| verdict.spans().iter().cloned()).collect();
    cuts.sort_by_key(|cut| cut.start);
    let mut parts = Vec::new();
    let mut from = 0;
    for cut in cuts.into_iter().chain(std::iter::once(samples..samples)) {
        // A verdict about another version of the file may lie beyond the end.
        let end = cut.start.min(samples);
        if end >= from + least {
            parts.push(from..end);
        }
        // Spans of different verdicts may overlap.
        from = from.max(cut.end);
    }
    let left: usize = parts.iter().map(ExactSizeIterator::len).sum();
    (left > 0 && left as f64 >= least_left).then_some(parts)
}

/// Returns the `parts` of `axes`, at least one and in order, joined to one recording.
///
/// Each part fades into the next over 10 ms with weights whose squares sum to one. The parts are uncorrelated, so the
/// power is preserved. A lag includes products across a joint, whose mean is zero, as at the ends of a recording. The
/// mean over the parts is subtracted before joining and added again afterwards.
pub fn kept(axes: Vec<Vec<f64>>, parts: &[Span]) -> Vec<Vec<f64>> {
    let [first, rest @ ..] = parts else {
        return axes;
    };
    if rest.is_empty() && axes.iter().all(|axis| first.len() == axis.len()) {
        return axes;
    }
    axes.into_iter().map(|axis| kept_of(&axis, parts)).collect()
}

/// Returns the positions of `spans` of a trial after its `parts` have been joined to one recording. Every joint is
/// returned as a span, too.
pub fn kept_spans(spans: &[Span], parts: &[Span]) -> Vec<Span> {
    let mut moved = Vec::new();
    let mut length = 0;
    for part in parts {
        let joint = length.min(JOINT);
        let begin = length - joint;
        if joint > 0 {
            moved.push(begin..begin + joint.min(part.len()));
        }
        for span in spans {
            let (start, end) = (span.start.max(part.start), span.end.min(part.end));
            if start < end {
                moved.push(begin + start - part.start..begin + end - part.start);
            }
        }
        length = begin + part.len().max(joint);
    }
    moved
}

/// Returns the stretches of a trial that was joined of its `parts` within which time goes on without a jump: each from
/// the middle of a joint to the middle of the next.
pub fn stretches(parts: &[Span]) -> Vec<Span> {
    let (mut begin, mut length) = (0, 0);
    let mut stretches = Vec::new();
    for part in parts {
        let joint = length.min(JOINT);
        if length > 0 {
            stretches.push(begin..length - joint / 2);
            begin = length - joint / 2;
        }
        length += part.len().max(joint) - joint;
    }
    stretches.push(begin..length);
    stretches
}

fn kept_of(axis: &[f64], parts: &[Span]) -> Vec<f64> {
    let count: usize = parts.iter().map(ExactSizeIterator::len).sum();
    let mean = parts.iter().flat_map(|part| &axis[part.clone()]).sum::<f64>() / count as f64;
    let mut joined: Vec<f64> = Vec::with_capacity(count);
    for part in parts {
        let mut samples = axis[part.clone()].iter().map(|x| x - mean);
        let joint = joined.len().saturating_sub(JOINT);
        let before = &mut joined[joint..];
        let length = before.len() as f64;
        for (index, (last, next)) in before.iter_mut().zip(samples.by_ref()).enumerate() {
            // The half makes both ends of the joint alike.
            let angle = std::f64::consts::FRAC_PI_2 * (index as f64 + 0.5) / length;
            *last = *last * angle.cos() + next * angle.sin();
        }
        joined.extend(samples);
    }
    joined.iter().map(|x| x + mean).collect()
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init, reason = "the spans are ranges")]
mod tests {
    use super::super::test_signals::bounded_noise;
    use super::*;

    fn silent(spans: Vec<Span>) -> Vec<Verdict> {
        vec![Verdict::on(Kind::PartlySilent, "partly silent", spans)]
    }

    #[test]
    fn what_is_left_is_long_enough_or_all() {
        assert_eq!(usable(&[], 10_000), [0..10_000]);
        assert_eq!(usable(&silent(vec![0..1000]), 10_000), [1000..10_000]);
        assert_eq!(usable(&silent(vec![3000..3500]), 10_000), [0..3000, 3500..10_000]);
        // The part between two cuts is too short.
        assert_eq!(
            usable(&silent(vec![3000..3500, 4000..4500]), 10_000),
            [0..3000, 4500..10_000]
        );
        // Too little would remain.
        assert_eq!(usable(&silent(vec![500..10_000]), 10_000), [0..10_000]);
        // Rests count for nothing, however long they are.
        assert_eq!(usable(&silent(vec![0..5000, 7500..10_000]), 10_000), [5000..7500]);
        let many = (0..100).map(|n| 100 * n..100 * n + 10).collect();
        assert_eq!(usable(&silent(many), 10_000), [0..10_000]);
        assert_eq!(usable(&[], 100), [0..100]);
        // Cuts beyond the end have no effect.
        assert_eq!(
            usable(&silent(vec![11_000..12_000, 20_000..20_010]), 10_000),
            [0..10_000]
        );
    }

    #[test]
    fn gaps_are_cut_from_between_shorter_parts_where_no_longer_ones_are_left() {
        let of = |kind, step: usize| {
            let spans = (1..10_000 / step).map(|n| step * n..step * n + 40).collect();
            Verdict::on(kind, "gaps", spans)
        };
        let parts = usable(&[of(Kind::Dropouts, 1000)], 10_000);
        assert_eq!((parts.len(), parts[1].clone()), (10, 1040..2000));
        assert_eq!(usable(&[of(Kind::Spikes, 1000)], 10_000), [0..10_000]);
        assert_eq!(usable(&[of(Kind::Dropouts, 400)], 10_000), [0..10_000]);
        // Longer parts, without any of the findings, have priority.
        let both = [of(Kind::Dropouts, 3000), of(Kind::Spikes, 3000)];
        assert_eq!(usable(&both, 10_000)[1], 3040..6000);
    }

    #[test]
    fn spans_move_with_the_samples_that_they_are_of() {
        let axis: Vec<f64> = (0..10_000).map(f64::from).collect();
        let parts = [0..4000, 6000..10_000];
        let joined = kept(vec![axis], &parts).remove(0);
        let moved = kept_spans(&[100..110, 3999..6001, 7000..7003], &parts);
        assert_eq!(moved, [100..110, 3999..4000, 3950..4000, 3950..3951, 4950..4953]);
        let value = |index: usize| (joined[index] - joined[100]).round();
        assert_eq!(value(4950), 6900.0);
        assert_eq!(kept_spans(&[5..9], &[0..10_000]), [5..9]);
        assert_eq!(stretches(&parts), [0..3975, 3975..joined.len()]);
        assert_eq!(stretches(&[500..10_000]), [0..9500]);
    }

    #[test]
    fn joined_parts_keep_their_samples_their_mean_and_their_power() {
        let axis: Vec<f64> = bounded_noise(1).iter().map(|x| x + 9.81).collect();
        let joined = kept(vec![axis.clone()], &[0..4000, 6000..10_000]).remove(0);
        assert_eq!(joined.len(), 8000 - JOINT);
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(close(&joined[..4000 - JOINT], &axis[..4000 - JOINT]));
        assert!(close(&joined[4000..], &axis[6000 + JOINT..]));
        let joint = &joined[4000 - JOINT..4000];
        let power = joint.iter().map(|x| (x - 9.81) * (x - 9.81)).sum::<f64>() / JOINT as f64;
        assert!((0.3..1.4).contains(&power), "{power}");
        assert_eq!(kept(vec![axis.clone()], &[0..10_000]), [axis]);
    }
}
