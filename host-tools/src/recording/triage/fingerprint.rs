//! Fingerprints of recordings, by which copies are found: equal ones, and those that were scaled, inverted or shifted.
//!
//! A recording is whitened by its own linear predictor, because the whitened vibrations of two takes of one surface are
//! uncorrelated whatever their common spectrum is. The largest peaks of the whitened signal are landmarks. The gaps
//! between four successive landmarks depend neither on the scale nor on the sign nor on the start of the recording, so
//! a copy shares them. What shares two of them at one shift is correlated there in full.
//!
//! A signal that its predictor explains but for round-off, such as a pure tone, has no whitened signal: any two tones
//! of a frequency are shifted copies of each other. Only equal samples make such signals copies.

use std::borrow::Cow;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hash, Hasher};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::likeness::{Content, Likeness, likeness_at};
use crate::dsp::sums::mean;
use crate::dsp::wide;
use crate::support::error::Result;

/// Number of samples on either side within which a landmark is the largest: 10 ms.
const LANDMARK_REACH: usize = 50;

/// Number of common landmarks at one shift from which two recordings are correlated.
const COMMON_LANDMARKS: usize = 2;

/// The content of a recording, to be compared with that of others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Hash of the samples' bits.
    hash: u64,
    /// The signal, if it is held.
    #[serde(skip)]
    content: Option<Content>,
    /// Positions of the landmarks, ascending.
    landmarks: Vec<u32>,
}

/// Returns the fingerprint of a signal of one axis at 5 kHz, in any unit.
pub fn fingerprint(signal: &[f64]) -> Fingerprint {
    let (content, whitened) = Content::of(centred(signal));
    Fingerprint {
        hash: hash(signal),
        landmarks: landmarks(&whitened),
        content: Some(content),
    }
}

/// Returns `signal` as fingerprints compare it.
pub fn centred(signal: &[f64]) -> Vec<f32> {
    let mean = mean(signal);
    signal.iter().map(|x| (x - mean) as f32).collect()
}

/// Returns how `copy` was made of `original`, or `None` if it was not. Both hold their signals.
///
/// A copy has equal samples, or a [correlation](super::COPY_CORRELATION) with the original over 0.2 s or more.
pub fn likeness(original: &Fingerprint, copy: &Fingerprint) -> Option<Likeness> {
    let both = [original, copy].map(|print| Member { group: 0, print });
    let never = |_| Ok(Vec::new());
    copies(&both, &never).ok()?[1].map(|(_, likeness)| likeness)
}

/// A recording among others.
#[derive(Clone, Copy, Debug)]
pub struct Member<'a> {
    /// Number of its group, such as a texture.
    pub group: usize,
    /// Its content.
    pub print: &'a Fingerprint,
}

/// Recordings up to which each is compared with every earlier one. Of more, a recording is compared with those of its
/// group, and with all others by a longer row of landmarks, whose gaps must be the same to the sample: copies that are
/// equal, scaled, inverted or cut are found there, those that are shifted by part of a sample are not.
const MOST_COMPARED_WITH_ALL: usize = 5000;

/// Returns for each recording the index of the earliest that it is a copy of, and the relation to it. `signal_of` reads
/// the [`centred`] signal of a recording whose fingerprint does not hold it.
///
/// # Errors
/// Those of `signal_of`.
pub fn copies(
    recordings: &[Member<'_>],
    signal_of: &(impl Fn(usize) -> Result<Vec<f32>> + Sync),
) -> Result<Vec<Option<(usize, Likeness)>>> {
    copies_among(recordings, signal_of, MOST_COMPARED_WITH_ALL)
}

fn copies_among(
    recordings: &[Member<'_>],
    signal_of: &(impl Fn(usize) -> Result<Vec<f32>> + Sync),
    most_compared_with_all: usize,
) -> Result<Vec<Option<(usize, Likeness)>>> {
    let mut first_with = HashMap::new();
    // Of equal recordings the first one stands for all.
    let equal_to: Vec<Option<usize>> = recordings
        .iter()
        .enumerate()
        .map(|(number, recording)| {
            let first = *first_with.entry(recording.print.hash).or_insert(number);
            (first != number).then_some(first)
        })
        .collect();
    let candidates = if recordings.len() <= most_compared_with_all {
        let all: Vec<usize> = (0..recordings.len()).collect();
        candidates_among(recordings, &all, &equal_to)
    } else {
        let mut found = candidates_within_groups(recordings, &equal_to);
        found.extend(candidates_across(recordings, &equal_to));
        found
    };
    let mut of_each: Vec<Vec<(usize, i64)>> = vec![Vec::new(); recordings.len()];
    for (copy, original, shift) in candidates {
        of_each[copy].push((original, shift));
    }
    let signal = |number: usize| -> Result<Cow<'_, [f32]>> {
        Ok(match &recordings[number].print.content {
            Some(content) => Cow::Borrowed(content.signal.as_slice()),
            None => Cow::Owned(signal_of(number)?),
        })
    };
    let content = |number: usize| -> Result<Cow<'_, Content>> {
        Ok(match &recordings[number].print.content {
            Some(content) => Cow::Borrowed(content),
            None => Cow::Owned(Content::of(signal_of(number)?).0),
        })
    };
    let verified = |(number, mut originals): (usize, Vec<(usize, i64)>)| {
        if let Some(equal) = equal_to[number] {
            return Ok(Some((equal, Likeness::EQUAL)));
        }
        if originals.is_empty() {
            return Ok(None);
        }
        originals.sort_unstable();
        originals.dedup();
        let copy = signal(number)?;
        for (original, shift) in originals {
            if let Some(found) = likeness_at(&*content(original)?, &copy, shift) {
                return Ok(Some((original, found)));
            }
        }
        Ok(None)
    };
    of_each
        .into_par_iter()
        .enumerate()
        .map(verified)
        .collect::<Result<_>>()
}

/// A recording that may be a copy of an earlier one, at a shift.
type Candidate = (usize, usize, i64);

/// Candidates among the recordings `numbers`, which ascend: those with enough common landmarks at one shift.
fn candidates_among(
    recordings: &[Member<'_>],
    numbers: &[usize],
    equal_to: &[Option<usize>],
) -> Vec<Candidate> {
    let mut index = LandmarkIndex::default();
    let mut found = Vec::new();
    for &number in numbers.iter().filter(|&&number| equal_to[number].is_none()) {
        let print = recordings[number].print;
        let originals = index.candidates(print).into_iter();
        found.extend(originals.map(|(original, shift)| (number, original, shift)));
        index.insert(number, print);
    }
    found
}

fn candidates_within_groups(
    recordings: &[Member<'_>],
    equal_to: &[Option<usize>],
) -> Vec<Candidate> {
    let mut groups: HashMap<usize, Vec<usize>> = HashMap::new();
    for (number, recording) in recordings.iter().enumerate() {
        groups.entry(recording.group).or_default().push(number);
    }
    let groups: Vec<Vec<usize>> = groups.into_values().collect();
    let among = |numbers: &Vec<usize>| candidates_among(recordings, numbers, equal_to);
    groups.par_iter().flat_map_iter(among).collect()
}

/// Rows of landmarks that are kept at most while all recordings are compared, 16 bytes each.
const MOST_ROWS: usize = 8_000_000;

/// Landmarks of a row by which recordings of different groups are compared.
const ROW: usize = 6;

/// Candidates of any group, by rows of landmarks with the same gaps. A share of the rows is enough if there are many:
/// which ones, their gaps say, so that a copy keeps those of its original.
fn candidates_across(recordings: &[Member<'_>], equal_to: &[Option<usize>]) -> Vec<Candidate> {
    let rows = |print: &Fingerprint| print.landmarks.len().saturating_sub(ROW - 1);
    let total: usize = recordings
        .iter()
        .map(|recording| rows(recording.print))
        .sum();
    let share = total.div_ceil(MOST_ROWS).max(1) as u64;
    let mut kept: Vec<(u64, u32, u32)> = Vec::with_capacity(total / share as usize + 1);
    for (number, recording) in recordings.iter().enumerate() {
        if equal_to[number].is_some() {
            continue;
        }
        for row in recording.print.landmarks.windows(ROW) {
            let mut hasher = GapHasher::default();
            row.windows(2)
                .for_each(|pair| hasher.write_u32(pair[1] - pair[0]));
            let hash = hasher.finish();
            if hash % share == 0 {
                kept.push((hash, number as u32, row[0]));
            }
        }
    }
    kept.par_sort_unstable();
    let alike = kept
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|alike| alike.len() > 1);
    let pairs = alike.flat_map(|alike| {
        let (_, original, at) = alike[0];
        alike[1..].iter().map(move |&(_, copy, there)| {
            let shift = i64::from(there) - i64::from(at);
            (copy as usize, original as usize, shift)
        })
    });
    let mut found: Vec<Candidate> = pairs
        .filter(|(copy, original, _)| copy != original)
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Hash of gaps: quick, because a set has millions of them, and the same in every run.
#[derive(Default)]
struct GapHasher(u64);

impl Hasher for GapHasher {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 29)
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes
            .iter()
            .for_each(|&byte| self.write_u32(u32::from(byte)));
    }

    fn write_u32(&mut self, value: u32) {
        // A multiplier of Steele and Vigna's (Computationally easy, spectrally good multipliers, 2021).
        let mixed = (self.0.rotate_left(23) ^ u64::from(value)).wrapping_mul(0xf135_7aea_2e62_a9c5);
        self.0 = mixed ^ (mixed >> 32);
    }
}

/// Gaps between four successive landmarks, in samples.
type Gaps = [u32; 3];

/// Gaps as a key, hashed as three numbers and not byte by byte.
#[derive(PartialEq, Eq)]
struct GapsKey(Gaps);

impl Hash for GapsKey {
    fn hash<H: Hasher>(&self, hasher: &mut H) {
        self.0.iter().for_each(|&gap| hasher.write_u32(gap));
    }
}

/// Landmarks of recordings by their gaps.
#[derive(Default)]
struct LandmarkIndex(HashMap<GapsKey, Vec<(usize, u32)>, BuildHasherDefault<GapHasher>>);

impl LandmarkIndex {
    fn insert(&mut self, number: usize, recording: &Fingerprint) {
        for (gaps, position) in recording.gaps() {
            self.0
                .entry(GapsKey(gaps))
                .or_default()
                .push((number, position));
        }
    }

    /// Returns the recordings with enough common landmarks at one shift, in their order, with that shift.
    fn candidates(&self, recording: &Fingerprint) -> Vec<(usize, i64)> {
        let mut shifts: HashMap<usize, Vec<i64>> = HashMap::new();
        for (gaps, position) in recording.gaps() {
            for near in neighbours(gaps) {
                for &(number, original) in self.0.get(&GapsKey(near)).into_iter().flatten() {
                    let shift = i64::from(position) - i64::from(original);
                    shifts.entry(number).or_default().push(shift);
                }
            }
        }
        let mut found: Vec<(usize, i64)> = shifts
            .into_iter()
            .filter_map(|(number, shifts)| Some((number, commonest(shifts)?)))
            .collect();
        found.sort_unstable();
        found
    }
}

impl Fingerprint {
    /// Memory that the signal takes, bytes.
    pub fn signal_bytes(&self) -> usize {
        let content = self.content.as_ref();
        content.map_or(0, |content| size_of_val(content.signal.as_slice()))
    }

    /// Returns whether the landmarks are different places of a recording, in ascending order.
    pub fn is_sound(&self) -> bool {
        let ascend = self.landmarks.is_sorted_by(|a, b| a < b);
        let last = self.landmarks.last().copied().unwrap_or(0);
        ascend && (last as usize) < crate::recording::MAX_FRAMES
    }

    /// Lets go of the signal. It is read again where it is compared.
    pub fn forget_signal(&mut self) {
        self.content = None;
    }

    fn gaps(&self) -> impl Iterator<Item = (Gaps, u32)> + '_ {
        self.landmarks.windows(4).map(|marks| {
            let gaps = [0, 1, 2].map(|gap| marks[gap + 1] - marks[gap]);
            (gaps, marks[0])
        })
    }
}

/// Gaps that differ by one sample at most, because a shift by part of a sample moves peaks.
fn neighbours(gaps: Gaps) -> impl Iterator<Item = Gaps> {
    (0..27u32).map(move |code| {
        let by = [code % 3, code / 3 % 3, code / 9];
        [0, 1, 2].map(|gap| gaps[gap] + by[gap] - 1)
    })
}

/// Returns the shift that occurs most often, give or take a sample, if it occurs often enough.
fn commonest(mut shifts: Vec<i64>) -> Option<i64> {
    shifts.sort_unstable();
    let within = |from: usize| shifts.partition_point(|&shift| shift <= shifts[from] + 2) - from;
    let best = (0..shifts.len()).max_by_key(|&from| within(from))?;
    let count = within(best);
    (count >= COMMON_LANDMARKS).then(|| shifts[best + count / 2])
}

/// Positions at which the magnitude is the largest within [`LANDMARK_REACH`].
fn landmarks(whitened: &[f32]) -> Vec<u32> {
    let is_landmark = |middle: usize| {
        let top = whitened[middle].abs();
        let before = &whitened[middle - LANDMARK_REACH..middle];
        let after = &whitened[middle + 1..=middle + LANDMARK_REACH];
        before.iter().all(|x| x.abs() < top) && after.iter().all(|x| x.abs() <= top)
    };
    let last = whitened.len().saturating_sub(LANDMARK_REACH);
    let tops = tops(whitened);
    let mut found = Vec::new();
    for (block, &top) in tops.iter().enumerate() {
        // The blocks on either side are within reach of every sample here, and rule out most.
        let around =
            block.saturating_sub(BLOCKS_WITHIN)..(block + BLOCKS_WITHIN + 1).min(tops.len());
        if tops[around].iter().any(|&other| other > top) {
            continue;
        }
        let first = block * BLOCK;
        let here = first.max(LANDMARK_REACH)..(first + BLOCK).min(last);
        let highest = here.filter(|&middle| whitened[middle].abs() >= top && is_landmark(middle));
        found.extend(highest.map(|middle| middle as u32));
    }
    found
}

/// Samples of a block whose largest magnitude is looked at first.
const BLOCK: usize = 16;

/// Blocks on either side of a block that are within reach of each of its samples.
const BLOCKS_WITHIN: usize = (LANDMARK_REACH + 1 - BLOCK) / BLOCK;

/// The largest magnitude of each block.
fn tops(whitened: &[f32]) -> Vec<f32> {
    wide(
        #[inline(always)]
        || {
            let larger = |most: f32, x: &f32| if x.abs() > most { x.abs() } else { most };
            let blocks = whitened.chunks(BLOCK);
            blocks.map(|block| block.iter().fold(0.0, larger)).collect()
        },
    )
}

/// Hash of the samples' bits, the same on every computer: in eight lanes, by the multiplication of FNV-1a (Fowler, Noll
/// and Vo) on words instead of bytes.
fn hash(signal: &[f64]) -> u64 {
    const PRIME: u64 = 0x0100_0000_01b3;
    let mut lanes = [0xcbf2_9ce4_8422_2325_u64; 8];
    let next = |hash: u64, word: u64| {
        let mixed = (hash ^ word).wrapping_mul(PRIME);
        mixed ^ (mixed >> 32)
    };
    let (chunks, rest) = signal.as_chunks::<8>();
    for chunk in chunks {
        for (lane, x) in lanes.iter_mut().zip(chunk) {
            *lane = next(*lane, x.to_bits());
        }
    }
    let rest = rest.iter().map(|x| x.to_bits());
    let words = rest.chain([signal.len() as u64]).chain(lanes);
    words.fold(PRIME, next)
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, plus, tone};
    use super::*;

    fn found(original: &[f64], copy: &[f64]) -> Option<Likeness> {
        likeness(&fingerprint(original), &fingerprint(copy))
    }

    #[test]
    fn landmarks_that_no_recording_has_are_unsound() {
        for (landmarks, is_sound) in [
            (vec![], true),
            (vec![4, 9, 10], true),
            (vec![4, 4], false),
            (vec![9, 4], false),
            (vec![4, u32::MAX], false),
        ] {
            let print = Fingerprint {
                hash: 0,
                content: None,
                landmarks,
            };
            assert_eq!(print.is_sound(), is_sound);
        }
    }

    /// The oracle looks at every sample.
    #[test]
    fn landmarks_are_the_largest_within_their_reach() {
        for length in [0, 50, 101, 117, 5000, 9_999] {
            // Coarse steps, so that some magnitudes are equal.
            let signal: Vec<f32> = noise(length as u64)[..length]
                .iter()
                .map(|x| (20.0 * x).round() as f32)
                .collect();
            let is_landmark = |&at: &usize| {
                let top = signal[at].abs();
                let before = signal[at - LANDMARK_REACH..at].iter();
                let after = signal[at + 1..=at + LANDMARK_REACH].iter();
                before.clone().all(|x| x.abs() < top) && after.clone().all(|x| x.abs() <= top)
            };
            let all = LANDMARK_REACH..length.saturating_sub(LANDMARK_REACH);
            let expected: Vec<u32> = all.filter(is_landmark).map(|at| at as u32).collect();
            assert_eq!(landmarks(&signal), expected, "{length}");
            assert!(length < 1000 || expected.len() > 10);
        }
    }

    #[test]
    fn other_recordings_of_one_spectrum_are_no_copies() {
        let prints: Vec<_> = (1..20).map(|seed| fingerprint(&noise(seed))).collect();
        assert!(copies_of(&prints, usize::MAX).iter().all(Option::is_none));
        assert!(copies_of(&prints, 0).iter().all(Option::is_none));
        assert_eq!(
            found(
                &tone(100.0, 1.0).collect::<Vec<_>>(),
                &tone(100.0, 0.9).collect::<Vec<_>>()
            ),
            None
        );
    }

    #[test]
    fn equal_samples_are_a_copy_even_of_a_tone() {
        for signal in [noise(1), tone(100.0, 1.0).collect()] {
            assert_eq!(found(&signal, &signal.clone()), Some(Likeness::EQUAL));
        }
    }

    #[test]
    fn scale_sign_and_shift_of_a_copy_are_found() {
        let original = noise(3);
        let scaled: Vec<f64> = original.iter().map(|x| -0.37 * x).collect();
        let likeness = found(&original, &scaled).unwrap();
        assert!(
            (likeness.scale + 0.37).abs() < 1e-3 && likeness.shift == 0,
            "{likeness:?}"
        );
        for shift in [-6000i64, -41, 250, 7000] {
            let (skip, pad) = ((-shift).max(0) as usize, shift.max(0) as usize);
            let before = noise(4)[..pad].to_vec();
            let copy: Vec<f64> = before
                .into_iter()
                .chain(original[skip..].iter().copied())
                .collect();
            let likeness = found(&original, &copy).unwrap();
            assert_eq!(likeness.shift, shift, "{likeness:?}");
        }
    }

    #[test]
    fn a_copy_between_the_samples_and_one_under_noise_are_found() {
        let wide = noise(5);
        let smooth: Vec<f64> = wide.windows(3).map(|w| w.iter().sum()).collect();
        let double = crate::recording::resample(std::slice::from_ref(&smooth), 5000, 10_000)
            .unwrap()
            .remove(0);
        let half: Vec<f64> = double.iter().skip(1).step_by(2).copied().collect();
        assert!(found(&smooth, &half).is_some());
        let noisy = plus(&wide, noise(6).into_iter().map(|x| 0.01 * x));
        assert!(found(&wide, &noisy).is_some());
    }

    /// A drum that passes the same track again, under another force.
    #[test]
    fn a_track_that_is_retraced_is_no_copy() {
        let track = noise(7);
        let pass = |seed: u64| plus(&track, noise(seed).into_iter().map(|x| 0.1 * x));
        assert_eq!(found(&pass(8), &pass(9)), None);
    }

    #[test]
    fn the_earliest_original_is_named() {
        let (a, b) = (noise(7), noise(8));
        let twice: Vec<f64> = b.iter().map(|x| 2.0 * x).collect();
        let prints = [&a, &b, &twice, &b].map(|signal| fingerprint(signal));
        assert_eq!(
            originals(&copies_of(&prints, usize::MAX)),
            [None, None, Some(1), Some(1)]
        );
    }

    fn originals(found: &[Option<(usize, Likeness)>]) -> Vec<Option<usize>> {
        let original = |copy: &Option<(usize, Likeness)>| copy.map(|(original, _)| original);
        found.iter().map(original).collect()
    }

    /// Copies among recordings of a group each, none of which holds its signal.
    fn copies_of(
        prints: &[Fingerprint],
        most_compared_with_all: usize,
    ) -> Vec<Option<(usize, Likeness)>> {
        let signals: Vec<Vec<f32>> = prints
            .iter()
            .map(|print| print.content.clone().unwrap().signal)
            .collect();
        let mut bare = prints.to_vec();
        bare.iter_mut().for_each(Fingerprint::forget_signal);
        let members: Vec<Member<'_>> = bare
            .iter()
            .enumerate()
            .map(|(group, print)| Member { group, print })
            .collect();
        let signal_of = |number: usize| Ok(signals[number].clone());
        copies_among(&members, &signal_of, most_compared_with_all).unwrap()
    }

    /// In a set of too many recordings for a comparison of each with each, copies in other groups are found all the
    /// same: equal ones, scaled and inverted ones, and those that begin at another sample.
    #[test]
    fn copies_in_other_groups_of_a_large_set_are_found() {
        let (a, b) = (noise(7), noise(8));
        let inverted: Vec<f64> = a.iter().map(|x| -0.2 * x).collect();
        let cut = b[3000..].to_vec();
        let prints = [&a, &b, &inverted, &cut, &a].map(|signal| fingerprint(signal));
        let expected = [None, None, Some(0), Some(1), Some(0)];
        assert_eq!(originals(&copies_of(&prints, 0)), expected);
        assert_eq!(originals(&copies_of(&prints, usize::MAX)), expected);
    }
}
