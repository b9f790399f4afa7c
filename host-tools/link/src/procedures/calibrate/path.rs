//! Path per count of the encoder, from a known distance that the tip moves there and back.

use model_format::link::{BLOCK_SAMPLES, Setting, SettingChange, Settings};

use super::rest::refuse_if_playing;
use crate::link::Device;
use crate::link::Result as LinkResult;
use crate::link::capture::Stream;

/// Least number of counts over the distance, for a resolution of half a per cent.
const LEAST_COUNTS: i64 = 200;
/// Largest relative difference between the counts there and back.
const MOST_SHARE: f64 = 0.02;
/// Largest fraction of the counted path that may not add to the distance, because the tip overshoots or shakes.
const MOST_ASTRAY: f64 = 0.1;

/// Longest time until the last counts of a movement arrive, s.
const ARRIVAL_S: f64 = 0.2;

/// A movement of the tip, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Travel {
    /// Counts from its beginning to its end.
    pub counts: i64,
    /// Sum of the counts of both directions.
    pub walked: i64,
}

impl Travel {
    /// Records a movement. Calls `begun` once the recording runs, and continues for a short time after `ended` returns
    /// true, because counts take a while to arrive.
    ///
    /// # Errors
    /// A lost link, a texture or scene that is playing, or a recording with holes.
    pub fn record(device: &Device, begun: impl FnOnce(), mut ended: impl FnMut() -> bool) -> LinkResult<Self> {
        refuse_if_playing(device)?;
        let mut stream = Stream::start(device)?;
        begun();
        let mut travel = Self::default();
        let mut left = stream.samples_in(ARRIVAL_S)?;
        while left > 0 {
            // The wait counts blocks and not time, because a virtual stylus may be slower than real time.
            if ended() {
                left = left.saturating_sub(BLOCK_SAMPLES);
            }
            let arrival = stream.wait()?;
            if !arrival.is_continuous {
                let what = "counts were lost on the way to this computer: calibrate again, over USB";
                return Err(device.not_verified(what.to_owned()));
            }
            for sample in arrival.samples {
                let counts = i64::from(sample.encoder_delta);
                travel.counts += counts;
                travel.walked += counts.abs();
            }
        }
        stream.stop()?;
        Ok(travel)
    }
}

/// Path per count, and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PathScale {
    /// Path per count, mm; negative if the counts fall on the way there.
    pub mm_per_count: f64,
    /// Counts there and back.
    pub counts: [i64; 2],
    /// Difference of the paths there and back, mm.
    pub difference_mm: f64,
}

/// Reason why two movements give no path per count.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PathFault {
    /// The encoder moved by only this number of counts.
    #[error(
        "the encoder moved by {0} counts, fewer than {LEAST_COUNTS}: move it over a longer distance, see that its \
         wheel turns, and check both of its wires"
    )]
    TooFew(i64),
    /// Both movements were counted in one direction.
    #[error("there and back were counted in the same direction: move back to the beginning the second time")]
    SameDirection,
    /// Over a distance of the first number of counts, the second number was counted in both directions together.
    #[error(
        "the encoder counted {1} counts for a way of {0}: move straight to the end and stop there; if you did, one of \
         its wires is broken or picks up noise"
    )]
    Astray(i64, i64),
    /// The counts there and back differ by this percentage.
    #[error(
        "{0} counts there and {1} back differ by {2:.1} %: begin and end at the same marks, and press so that the \
         wheel does not slip"
    )]
    Unequal(i64, i64, f64),
    /// With the stored setting, the known distance, mm, reads as the second one, mm.
    #[error(
        "{0} mm show as {1:.2} mm by the path per count that was just set: go from the same mark to the other as \
         before, and calibrate again"
    )]
    NotVerified(f64, f64),
}

impl PathScale {
    /// Computes the scale from a distance of `mm`, moved there and back.
    ///
    /// # Errors
    /// Ways that are too short, not straight, in the same direction, or not equal.
    pub fn of(mm: f64, [there, back]: [Travel; 2]) -> Result<Self, PathFault> {
        for way in [there, back] {
            let counts = way.counts.abs();
            let astray = (way.walked - counts) as f64 > MOST_ASTRAY * way.walked as f64;
            // An encoder with only one wire counts back and forth between two values, so few counts remain from end to
            // end.
            if astray && way.walked >= LEAST_COUNTS {
                return Err(PathFault::Astray(counts, way.walked));
            }
            if counts < LEAST_COUNTS {
                return Err(PathFault::TooFew(counts));
            }
        }
        if there.counts.signum() == back.counts.signum() {
            return Err(PathFault::SameDirection);
        }
        // The way back has the opposite sign.
        let mean = (there.counts - back.counts) as f64 / 2.0;
        let share = ((there.counts + back.counts) as f64 / mean).abs();
        if share > MOST_SHARE {
            let [there, back] = [there, back].map(|way| way.counts.abs());
            return Err(PathFault::Unequal(there, back, 100.0 * share));
        }
        Ok(Self {
            mm_per_count: mm / mean,
            counts: [there.counts, back.counts],
            difference_mm: share * mm,
        })
    }

    /// Verifies that a movement of `mm` in the first direction reads as `mm` by the `stored` settings.
    ///
    /// # Errors
    /// A reading that differs by more than [`PathScale::of`] allows.
    pub fn verify(mm: f64, way: Travel, stored: &Settings) -> Result<(), PathFault> {
        let shown = way.counts as f64 * f64::from(stored.get(Setting::PathPerCount));
        if (shown - mm).abs() <= MOST_SHARE * mm {
            return Ok(());
        }
        Err(PathFault::NotVerified(mm, shown))
    }

    /// Returns the setting of the path per count, rounded to five digits. The measurement is less accurate than that.
    pub fn change(&self) -> SettingChange {
        let text = format!("{:.4e}", self.mm_per_count);
        SettingChange {
            setting: Setting::PathPerCount,
            value: text.parse().unwrap_or(self.mm_per_count as f32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn straight(counts: i64) -> Travel {
        let walked = counts.abs();
        Travel { counts, walked }
    }

    proptest! {
        #[test]
        fn a_distance_there_and_back_gives_its_scale_in_both_directions(
            counts in 200i64..1_000_000, sign in prop_oneof![Just(-1i64), Just(1)], mm in 5.0f64..500.0,
        ) {
            let ways = [straight(sign * counts), straight(-sign * counts)];
            let scale = PathScale::of(mm, ways).expect("they are equal");
            prop_assert!((scale.mm_per_count * (sign * counts) as f64 / mm - 1.0).abs() < 1e-12);
            prop_assert_eq!(scale.difference_mm, 0.0);
            let stored = f64::from(scale.change().value) / scale.mm_per_count;
            prop_assert!((stored - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn ways_that_are_no_distance_are_refused_by_their_name() {
        let of = |there, back| PathScale::of(100.0, [there, back]);
        assert!(of(straight(10_000), straight(-9_900)).is_ok());
        let slipped = of(straight(10_000), straight(-9_500));
        assert!(matches!(slipped, Err(PathFault::Unequal(..))));
        assert_eq!(of(straight(900), straight(900)), Err(PathFault::SameDirection));
        assert!(matches!(of(straight(0), straight(0)), Err(PathFault::TooFew(..))));
        let one_wire = Travel {
            counts: 1,
            walked: 9_001,
        };
        assert!(matches!(of(one_wire, one_wire), Err(PathFault::Astray(..))));
    }
}
