//! Integers that do not mean what they seem: two's complement that was read as unsigned, and converters that wrap.

use stylus_support::number::counted;

use super::unit::Unscaled;

/// Least number of jumps, least size of a jump, and largest size of a step, as fractions of the span of the numbers.
/// Steps between them are those of loud samples, of which there may be a quarter as many as of jumps.
const JUMPS: (usize, f64, f64) = (4, 0.6, 0.4);

/// Undoes the jumps of `channels` by the span of their numbers, if they have such jumps, and returns a remark about
/// them. The span of whole numbers is the least power of two that holds them.
pub(super) fn gone_on(channels: &mut [Vec<f64>], unscaled: Unscaled) -> Option<String> {
    let (least, most) = channels
        .iter()
        .flatten()
        .fold((0.0, 0.0), |(least, most): (f64, f64), x| (least.min(*x), most.max(*x)));
    let (span, words) = if unscaled == Unscaled::OfFullScale {
        (2.0, "their whole span".to_owned())
    } else {
        let largest = if least < 0.0 {
            2.0 * most.max(-1.0 - least)
        } else {
            most
        };
        let span = 2f64.powi((largest + 1.0).log2().ceil() as i32);
        (span, span.to_string())
    };
    let (fewest, jump, step) = JUMPS;
    let (mut jumps, mut between) = (0, 0);
    for axis in &*channels {
        let ends = [f64::min, f64::max].map(|of| axis.iter().copied().reduce(of));
        for pair in axis.windows(2) {
            let size = (pair[1] - pair[0]).abs() / span;
            // A clipped signal steps from one end of its range to the other.
            let is_clipped = pair.iter().all(|x| ends.contains(&Some(*x)));
            jumps += usize::from(size > jump && !is_clipped);
            between += usize::from((step..=jump).contains(&size));
        }
    }
    if jumps < fewest || 4 * between > jumps {
        return None;
    }
    let found = counted(jumps, "jump");
    let found = format!("its samples have {found} by {words}, as of signed numbers read as unsigned, or wrapped ones");
    let ways: Vec<Way> = channels.iter().map(|axis| Way::of(axis, span)).collect();
    // Where a true step was as large as a jump, the samples after it are off by the span.
    if ways.iter().any(|way| way.furthest > span) {
        return Some(format!("{found}: read them as signed, or record with a larger range"));
    }
    for (axis, way) in channels.iter_mut().zip(ways) {
        let mut before = axis[0];
        for x in axis {
            before = near(*x, before, span);
            *x = before - way.shift;
        }
    }
    Some(format!("{found}; they are taken to go on"))
}

/// Returns `x`, moved by a multiple of `span` to the sample `before` it.
fn near(x: f64, before: f64, span: f64) -> f64 {
    x + span * ((before - x) / span).round()
}

/// The way of an axis whose samples go on from each other.
struct Way {
    /// Multiple of the span by which the way is moved to be about zero.
    shift: f64,
    /// Largest magnitude of a sample on the moved way.
    furthest: f64,
}

impl Way {
    fn of(axis: &[f64], span: f64) -> Self {
        let (mut before, mut sum, mut low, mut high) = (axis[0], 0.0, f64::INFINITY, f64::NEG_INFINITY);
        for x in axis {
            before = near(*x, before, span);
            sum += before;
            (low, high) = (low.min(before), high.max(before));
        }
        let shift = span * (sum / axis.len() as f64 / span).round();
        Self {
            shift,
            furthest: (high - shift).max(shift - low),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::noise;

    proptest! {
        /// Resting between gravity and none, in counts of a sensor of any width.
        #[test]
        fn unsigned_and_wrapped_numbers_are_signed_again_and_others_stay(
            bits in 10i32..=24, level in 0.005..0.16f64, offset in -0.1..0.1f64, seed in 0u64..1000,
        ) {
            let span = 2f64.powi(bits);
            let smooth = noise(seed, 5006);
            let smooth = smooth.windows(6).map(|near| near.iter().sum::<f64>() / 6f64.sqrt());
            // Amplified before they are converted, so that the converter's steps stay small.
            let loud: Vec<f64> = smooth.clone().map(|x| 0.5 * x).collect();
            let offset = if level < 0.1 { 0.0 } else { offset };
            let signed: Vec<f64> = smooth.map(|x| (span * (level * x + offset)).round()).collect();
            let unsigned: Vec<f64> = signed.iter().map(|x| x.rem_euclid(span)).collect();
            let mut found = [unsigned.clone(), signed.clone()];
            let told = gone_on(&mut found[..1], Unscaled::Counts);
            let has_negative = signed.iter().any(|x| *x < 0.0);
            prop_assert!(told.is_some() == has_negative && found[0] == signed, "{:?}", told);
            prop_assert_eq!(gone_on(&mut found[1..], Unscaled::Counts), None);
            // A converter that wraps at the ends of its range, and one that clips there.
            let wrapped = loud.iter().map(|x| (x + 1.0).rem_euclid(2.0) - 1.0);
            let mut wrapped = [wrapped.collect::<Vec<f64>>()];
            prop_assert!(gone_on(&mut wrapped, Unscaled::OfFullScale).is_some());
            let clipped: Vec<f64> = loud.iter().map(|x| (16.0 * x).clamp(-1.0, 1.0)).collect();
            prop_assert_eq!(gone_on(&mut [clipped], Unscaled::OfFullScale), None);
        }
    }

    #[test]
    fn noise_over_the_whole_range_does_not_wrap() {
        let noise: Vec<f64> = noise(3, 5000)
            .iter()
            .map(|x| (600.0 * x).round().clamp(-512.0, 511.0))
            .collect();
        assert_eq!(gone_on(&mut [noise.clone()], Unscaled::Counts), None);
        let even: Vec<f64> = noise.iter().map(|x| x / 512.0 % 1.0).collect();
        assert_eq!(gone_on(&mut [even], Unscaled::OfFullScale), None);
    }
}
