//! The wavefront with AVX2 vectors: four samples per vector, and up to four vectors per pass.
//!
//! Each lane of 64 bits holds one sample: the lower half holds its forward signal, and the upper half the backward
//! signal that its last stage computed. The multiplications of 32 bits read only lower halves. Neighbouring samples are
//! in neighbouring vectors, so that the signal that passes from one sample to the next changes its lane once per round
//! and not in each step. Four vectors are as many as the registers can hold, and enough to fill the time in which one
//! step waits for the previous step.

use core::arch::x86_64::__m256i;

use model_format::limits::MAX_ORDER;
use pulp::x86::V3;
use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::Rotation;

/// Number of samples per vector.
const LANES: usize = 4;

/// Half of full scale. Values beyond it saturate when they are doubled.
const HALF_SCALE: i32 = 1 << 30;

/// Runs a closure and compiles everything that is inlined into it with the instructions of `simd`.
#[inline(always)]
fn dispatched<Output>(simd: V3, work: impl FnOnce(V3) -> Output) -> Output {
    simd.vectorize(
        #[inline(always)]
        || work(simd),
    )
}

/// See [`Arithmetic::rotate_block`].
pub fn rotate_block(simd: V3, rotations: &[Rotation], backward: &mut [i32], samples: &mut [i32]) {
    // A single sample has no neighbour with which it could be processed in parallel.
    if rotations.is_empty() || samples.len() < 2 {
        return Portable::rotate_block(rotations, backward, samples);
    }
    // Only the last pass may be narrower than four vectors.
    let whole = samples.len() - samples.len() % MAX_SAMPLES;
    let (whole, rest) = samples.split_at_mut(whole);
    for samples in [whole, rest] {
        match samples.len().div_ceil(LANES) {
            0 => {}
            1 => passes::<1, 2>(simd, rotations, backward, samples),
            2 => passes::<2, 4>(simd, rotations, backward, samples),
            3 => passes::<3, 6>(simd, rotations, backward, samples),
            _ => passes::<4, 8>(simd, rotations, backward, samples),
        }
    }
}

/// Passes `samples` through the lattice in passes of `V` vectors. Each sample is two stages behind the previous one.
fn passes<const V: usize, const SPACING: usize>(
    simd: V3,
    rotations: &[Rotation],
    backward: &mut [i32],
    samples: &mut [i32],
) {
    const { assert!(SPACING == 2 * V && V * LANES <= MAX_SAMPLES) };
    let lattice = Lattice {
        stages: rotations.len() as isize,
        rotations: &SpacedRotations::<SPACING>::new(rotations),
    };
    for samples in samples.chunks_mut(V * LANES) {
        dispatched(
            simd,
            #[inline(always)]
            |simd| lattice.pass::<V>(simd, backward, samples),
        );
    }
}

/// A lattice with at least one stage.
#[derive(Clone, Copy)]
struct Lattice<'a, const SPACING: usize> {
    stages: isize,
    rotations: &'a SpacedRotations<SPACING>,
}

impl<const SPACING: usize> Lattice<'_, SPACING> {
    /// Passes `samples` through the lattice, at most four for each of the `V` vectors.
    ///
    /// In step t, sample j is at stage M - 1 - t + 2j, counted from 0, where M is the number of stages. Samples that
    /// have not begun are above the last stage, and samples that have ended are below the first. The rotations there
    /// are zero.
    #[inline(always)]
    fn pass<const V: usize>(self, simd: V3, backward: &mut [i32], samples: &mut [i32]) {
        let step = Step::new(simd);
        let behind = 2 * (samples.len() as isize - 1);
        let last = self.stages - 1;
        let mut lanes = [simd.avx._mm256_set1_epi32(0); V];
        // Samples begin one after the other.
        let begun = behind.min(last);
        for stage in (last - begun + 1..=last).rev() {
            let at = last - stage;
            if at % 2 == 0 {
                step.begin(&mut lanes, at / 2, samples);
            }
            let below = backward[stage as usize];
            let shifted = step.backward(&lanes, below);
            step.rotate(&mut lanes, &shifted, self.rotations, stage);
        }
        // All samples are within the lattice. The last sample leaves its backward signals for the next pass.
        if behind < last {
            step.begin(&mut lanes, behind / 2, samples);
        }
        for stage in (1..=last - behind).rev() {
            let below = backward[stage as usize];
            let shifted = step.backward(&lanes, below);
            step.rotate(&mut lanes, &shifted, self.rotations, stage);
            backward[(stage + behind + 1) as usize] = lane_of(&lanes, samples.len() - 1)[1];
        }
        // Samples end one after the other. In a short lattice, some have not begun yet.
        let mut output = 0;
        for stage in (-behind..=0).rev() {
            let at = last - stage;
            if at % 2 == 0 && at <= behind {
                step.begin(&mut lanes, at / 2, samples);
            }
            let below = backward[stage.max(0) as usize];
            let mut shifted = step.backward(&lanes, below);
            let at_first_stage = (stage % 2 == 0).then_some((-stage / 2) as usize);
            if let Some(number) = at_first_stage.filter(|&number| number > 0) {
                // The backward signal below the first stage is the output of the previous sample.
                step.put_lower_half(&mut shifted, number, output);
            }
            step.rotate(&mut lanes, &shifted, self.rotations, stage);
            if let Some(number) = at_first_stage {
                output = lane_of(&lanes, number)[0];
                samples[number] = output;
            }
            if at >= behind {
                backward[(stage + behind + 1) as usize] = lane_of(&lanes, samples.len() - 1)[1];
            }
        }
        backward[0] = output;
    }
}

/// The constants that every step uses.
#[derive(Clone, Copy)]
struct Step {
    simd: V3,
    half_scale: __m256i,
    /// The highest word that does not saturate when it is doubled.
    highest: __m256i,
    /// The lowest word that does not saturate when it is doubled, before truncation toward zero.
    lowest: __m256i,
    /// Permutation from the upper half of each lane to the lower half of the next.
    to_next_lane: __m256i,
}

impl Step {
    #[inline(always)]
    fn new(simd: V3) -> Self {
        Self {
            simd,
            half_scale: simd.avx._mm256_set1_epi32(HALF_SCALE),
            highest: simd.avx._mm256_set1_epi32(HALF_SCALE - 1),
            lowest: simd.avx._mm256_set1_epi32(-HALF_SCALE - 1),
            to_next_lane: simd.avx._mm256_setr_epi32(7, 7, 1, 1, 3, 3, 5, 5),
        }
    }

    /// Returns the backward signals that the samples read, in lower halves: for each sample the signal from the
    /// previous sample, and `below` for the first sample.
    #[inline(always)]
    fn backward<const V: usize>(self, lanes: &[__m256i; V], below: i32) -> [__m256i; V] {
        let Self { simd, .. } = self;
        let below = simd.sse2._mm_cvtsi32_si128(below);
        let below = simd.avx._mm256_castsi128_si256(below);
        let turned = (simd.avx2)._mm256_permutevar8x32_epi32(lanes[V - 1], self.to_next_lane);
        let mut backward = [simd.avx2._mm256_blend_epi32::<1>(turned, below); V];
        for (to, &from) in backward[1..].iter_mut().zip(lanes) {
            *to = simd.avx2._mm256_srli_epi64::<32>(from);
        }
        backward
    }

    /// Computes one stage of each sample, with the first sample at `stage`; see [`stylus_kernel::arithmetic::rotated`].
    #[inline(always)]
    fn rotate<const V: usize, const SPACING: usize>(
        self,
        lanes: &mut [__m256i; V],
        backward: &[__m256i; V],
        rotations: &SpacedRotations<SPACING>,
        stage: isize,
    ) {
        let simd = self.simd;
        for (index, (vector, &backward)) in lanes.iter_mut().zip(backward).enumerate() {
            let forward = *vector;
            let entries = rotations.at_stage::<LANES>(stage + 2 * index as isize);
            let cos: __m256i = pulp::cast(entries);
            let sin = simd.avx2._mm256_srli_epi64::<32>(cos);
            let down = (simd.avx2)._mm256_sub_epi64(
                simd.avx2._mm256_mul_epi32(cos, forward),
                simd.avx2._mm256_mul_epi32(sin, backward),
            );
            let up = (simd.avx2)._mm256_add_epi64(
                simd.avx2._mm256_mul_epi32(sin, forward),
                simd.avx2._mm256_mul_epi32(cos, backward),
            );
            // The high words: that of `up` is in the upper half already.
            let down = simd.avx2._mm256_srli_epi64::<32>(down);
            let high = simd.avx2._mm256_blend_epi32::<0b1010_1010>(down, up);
            *vector = self.doubled_toward_zero(high);
        }
    }

    /// Returns twice the words of `high`, the upper halves of sums, as `high_word_toward_zero` and a saturating
    /// doubling do.
    ///
    /// Negative words get 1 added first, so those below -2³⁰ - 1 saturate. Words from 2³⁰ on are held at 2³⁰. The
    /// comparison that finds them yields -1, which makes 2·2³⁰ - 1, the positive full scale.
    #[inline(always)]
    fn doubled_toward_zero(self, high: __m256i) -> __m256i {
        let avx2 = self.simd.avx2;
        let is_negative = avx2._mm256_srli_epi32::<31>(high);
        let is_beyond = avx2._mm256_cmpgt_epi32(high, self.highest);
        let correction = avx2._mm256_add_epi32(is_negative, is_negative);
        let correction = avx2._mm256_add_epi32(correction, is_beyond);
        let clamped = avx2._mm256_max_epi32(high, self.lowest);
        let clamped = avx2._mm256_min_epi32(clamped, self.half_scale);
        avx2._mm256_add_epi32(avx2._mm256_add_epi32(clamped, clamped), correction)
    }

    /// Starts sample `number`, if there is one.
    #[inline(always)]
    fn begin<const V: usize>(self, lanes: &mut [__m256i; V], number: isize, samples: &[i32]) {
        let number = number as usize;
        if let Some(&sample) = samples.get(number) {
            self.put_lower_half(lanes, number, sample);
        }
    }

    /// Writes `word` into the lower half of the lane of sample `number`.
    #[inline(always)]
    fn put_lower_half<const V: usize>(self, lanes: &mut [__m256i; V], number: usize, word: i32) {
        const NONE: i32 = i32::MIN;
        let Self { simd, .. } = self;
        let word = simd.avx._mm256_set1_epi32(word);
        let halves = (simd.avx)._mm256_setr_epi32(0, NONE, 1, NONE, 2, NONE, 3, NONE);
        // A mask for each vector keeps them all in registers, which an index would not.
        for (index, vector) in lanes.iter_mut().enumerate() {
            let lane = if index == number % V { (number / V) as i32 } else { -1 };
            let is_lane = simd.avx2._mm256_cmpeq_epi32(halves, simd.avx._mm256_set1_epi32(lane));
            *vector = simd.avx2._mm256_blendv_epi8(*vector, word, is_lane);
        }
    }
}

/// Returns both halves of the lane of sample `number`, the lower half first.
#[inline(always)]
fn lane_of<const V: usize>(lanes: &[__m256i; V], number: usize) -> [i32; 2] {
    let mut lane = [0; 2];
    // Indices that are known at compile time keep the vectors in registers.
    for (index, &vector) in lanes.iter().enumerate() {
        if index == number % V {
            let halves: [[i32; 2]; LANES] = pulp::cast(vector);
            lane = halves[number / V % LANES];
        }
    }
    lane
}

/// Largest number of samples per pass.
pub const MAX_SAMPLES: usize = 16;

/// Number of additional stages above the last stage and below the first, so that lanes that have not begun, or have
/// ended, read zeros. Each sample is two stages behind the previous one.
const MARGIN: usize = 2 * MAX_SAMPLES;

/// Number of entries of all planes, rounded up so that every read of several lanes stays within the array. Six planes
/// leave two entries unused.
const ENTRIES: usize = (MAX_ORDER + 2 * MARGIN + 2 * MAX_SAMPLES).next_multiple_of(64);

/// Rotations in `SPACING` planes. A plane holds every `SPACING`-th stage, so that neighbouring entries load into
/// neighbouring lanes.
///
/// An entry holds cos θ in its lower half and sin θ in its upper half. Stages outside the lattice have zeros in both
/// halves, so their results are zero.
pub struct SpacedRotations<const SPACING: usize> {
    entries: [u64; ENTRIES],
}

impl<const SPACING: usize> SpacedRotations<SPACING> {
    /// Number of entries per plane.
    const PLANE: usize = ENTRIES / SPACING;

    /// Arranges `rotations` in planes; there may be at most [`MAX_ORDER`].
    pub fn new(rotations: &[Rotation]) -> Self {
        let mut entries = [0; ENTRIES];
        for (place, rotation) in (MARGIN..).zip(rotations) {
            debug_assert_eq!(rotation.neg_sin, -rotation.sin);
            let (cos, sin) = (rotation.cos.cast_unsigned(), rotation.sin.cast_unsigned());
            entries[Self::index(place)] = u64::from(cos) | u64::from(sin) << 32;
        }
        Self { entries }
    }

    /// Returns the entries of `stage` and of every `SPACING`-th stage above it, `COUNT` in total. Stages are counted
    /// from the first, and may be outside the lattice by up to [`MARGIN`].
    #[inline(always)]
    pub fn at_stage<const COUNT: usize>(&self, stage: isize) -> [u64; COUNT] {
        let place = stage.wrapping_add_unsigned(MARGIN).cast_unsigned();
        let entries = self.entries[Self::index(place)..].first_chunk();
        *entries.expect("no lane is farther outside than the margin")
    }

    #[inline(always)]
    fn index(place: usize) -> usize {
        place % SPACING * Self::PLANE + place / SPACING
    }
}
