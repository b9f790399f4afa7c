//! The two sides of a player: the mover, which moves and chooses, and the filler, which takes samples.

use core::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use model_format::{OutputSample, PlayRate};
use stylus_kernel::update_interval_samples;

use crate::choice::SharedLibrary;
use crate::choice::{ChoiceError, Selection, Without, plan_of};
use crate::exchange::{Given, Handover};
use crate::follow::{Follower, HELD_BLOCKS, MOST_MOTION, MoverMessage, Moves};
use crate::playing::BlockMotion;
use crate::playing::Playing;
use crate::resampler::{self, Resampler};
use crate::stages::{Blocker, Output, Scale};

/// Duration of a block, s.
const BLOCK_S: f64 = 0.002;
const BLOCKS_PER_S: u64 = 500;

/// Time for which a motion is held in addition to the length of a buffer, s. The length counts in blocks of 2 ms,
/// rounded up, and up to 1 s.
pub const HELD_S: f64 = HELD_BLOCKS as f64 * BLOCK_S;

/// Samples of the longest block.
const MOST_SAMPLES: usize = 20;

/// Output rates, Hz: the lowest, the highest, and a number that divides them all. The divisor bounds the number of
/// phases.
const OUTPUT_RATES_HZ: (u32, u32, u32) = (1000, 192_000, 25);

/// A call that was refused. What is playing continues.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// An output rate, Hz, that is not played.
    OutputRate(u32),
    /// A texture or scene that does not exist or cannot be played.
    Choice(ChoiceError),
    /// A sample rate of a texture or scene, Hz, that is not played.
    SampleRate(u32),
    /// A motion that cannot be played, with its remedy.
    Motion(&'static str),
    /// A gain or limit that is not a number, an infinite gain, or a negative limit.
    Gain,
    /// A resistance or power of a coil that is not a number above zero, or a product of them that is none.
    Coil,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (least, most, step) = OUTPUT_RATES_HZ;
        match self {
            Self::OutputRate(rate) => write!(
                f,
                "an output rate of {rate} Hz is not played: give a multiple of {step} Hz from {least} to {most} Hz"
            ),
            Self::Choice(error) => error.fmt(f),
            Self::SampleRate(rate) => write!(
                f,
                "a sample rate of {rate} Hz is not played: fit the texture at 5000 or 10000 Hz"
            ),
            Self::Motion(problem) => f.write_str(problem),
            Self::Gain => f.write_str("give a finite gain and a limit that is not negative"),
            Self::Coil => f.write_str("give a coil's resistance, Ω, and power, W, as finite numbers above zero"),
        }
    }
}

impl core::error::Error for Fault {}

self_cell::self_cell!(
    /// Player of a choice, together with the library that it plays from.
    struct Voice {
        owner: SharedLibrary,
        #[covariant]
        dependent: Playing,
    }
);

/// A choice; none is silence.
type Choice = Option<Voice>;

struct Shared {
    moves: Moves,
    choices: Handover<Choice>,
    /// Gain and limit, both `f32`.
    scale: AtomicU64,
    /// Mean square of the coil's voltage at its power limit, `f32`; infinite without a coil.
    coil: AtomicU32,
}

/// Creates a player at `output_rate_hz`: the handle that moves it and the one that fills buffers. It is silent until
/// something is chosen. A DC blocker takes the mean out of what it plays.
pub fn player(output_rate_hz: u32) -> Result<(Mover, Filler), Fault> {
    with(output_rate_hz, Some(Blocker::new()))
}

/// Like [`player`], without the DC blocker: at a texture's own rate, samples are those of `stylus render`, to the bit.
pub fn player_as_rendered(output_rate_hz: u32) -> Result<(Mover, Filler), Fault> {
    with(output_rate_hz, None)
}

fn with(output_rate_hz: u32, blocker: Option<Blocker>) -> Result<(Mover, Filler), Fault> {
    let (least, most, step) = OUTPUT_RATES_HZ;
    let is_played = (least..=most).contains(&output_rate_hz) && output_rate_hz.is_multiple_of(step);
    if !is_played {
        return Err(Fault::OutputRate(output_rate_hz));
    }
    let shared = Arc::new(Shared {
        moves: Moves::new(),
        choices: Handover::new(),
        scale: AtomicU64::new(packed(1.0, f32::INFINITY)),
        coil: AtomicU32::new(f32::INFINITY.to_bits()),
    });
    let mover = Mover {
        shared: Arc::clone(&shared),
    };
    Ok((mover, Filler::new(shared, output_rate_hz, blocker)))
}

/// Returns the time from a move to the middle of the change that it makes, s, for a texture at `sample_rate_hz`: at
/// most so much in the mean, and 1 ms more for a move just after a block began. It is the duration of a block plus the
/// interpolator's delay, which is 0 between equal rates.
pub fn latency_s(sample_rate_hz: u32, output_rate_hz: u32) -> f64 {
    let is_resampled = sample_rate_hz != output_rate_hz;
    let delay_s = is_resampled.then(|| resampler::delay_s(sample_rate_hz, output_rate_hz));
    BLOCK_S + delay_s.unwrap_or(0.0)
}

/// Returns the band, Hz, of a texture at `sample_rate_hz` that an output of `output_rate_hz` has left.
pub fn band_hz(sample_rate_hz: u32, output_rate_hz: u32) -> f64 {
    if sample_rate_hz == output_rate_hz {
        return f64::from(sample_rate_hz) / 2.0;
    }
    resampler::band_hz(sample_rate_hz, output_rate_hz)
}

/// The side that moves and chooses, from any thread. Moving never waits and never allocates.
#[derive(Clone)]
pub struct Mover {
    shared: Arc<Shared>,
}

impl Mover {
    /// Moves at a speed, mm/s, signed by the direction, with a force, N. The position is the integral of the speed.
    pub fn rub(&self, speed_mm_s: f64, force_n: f64) -> Result<(), Fault> {
        self.follow(BlockMotion::new(speed_mm_s, force_n))
    }

    /// Moves by `motion` in the next block, and continues at its speed in the blocks after it.
    pub fn follow(&self, motion: BlockMotion) -> Result<(), Fault> {
        checked(&motion)?;
        self.shared.moves.put(MoverMessage::Block(motion).words());
        Ok(())
    }

    /// Moves to a position, mm, with a force, N, at `time_s` of the caller's clock. The speed follows from the previous
    /// position, and the texture is played at this one.
    pub fn reach(&self, time_s: f64, position_mm: f64, force_n: f64) -> Result<(), Fault> {
        let motion = BlockMotion {
            begin_mm: position_mm,
            end_mm: position_mm,
            ..BlockMotion::new(0.0, force_n)
        };
        checked(&motion)?;
        // NaN stands for an unknown position in the check before, which lets it pass.
        if !time_s.is_finite() || position_mm.is_nan() {
            let problem = "the time or the position is not finite: give them in s and mm";
            return Err(Fault::Motion(problem));
        }
        let told = MoverMessage::Place {
            time_s,
            position_mm,
            force_n,
        };
        self.shared.moves.put(told.words());
        Ok(())
    }

    /// Plays `selection` from `library` with the noise of `seed`, as soon as what is playing has faded out. This takes
    /// at most two blocks; at another sample rate, the interpolator must be empty, too. Allocates memory, and frees
    /// what was played before.
    pub fn choose(
        &self,
        library: &SharedLibrary,
        selection: Selection,
        without: Without,
        seed: u64,
    ) -> Result<(), Fault> {
        let voice = Voice::try_new(library.clone(), |shared| {
            let plan = plan_of(&shared.library(), selection, without).map_err(Fault::Choice)?;
            let rate_hz = plan.sample_rate_hz();
            PlayRate::of(rate_hz).ok_or(Fault::SampleRate(rate_hz))?;
            Ok(Playing::new(plan, seed))
        });
        self.shared.choices.give(Some(voice?));
        Ok(())
    }

    /// Fades out what is playing, and plays nothing until the next choice. Allocates memory, like [`Mover::choose`].
    pub fn stop(&self) {
        self.shared.choices.give(None);
    }

    /// Multiplies what is played, m/s², by `gain`, and clamps it to `limit` on either side: volts, if the gain is in
    /// V per m/s². The gain changes over a block, the limit at once.
    pub fn set_gain(&self, gain: f32, limit: f32) -> Result<(), Fault> {
        if !gain.is_finite() || limit.is_nan() || limit < 0.0 {
            return Err(Fault::Gain);
        }
        self.shared
            .scale
            // Both in one word, so that the filler never sees the one without the other.
            .store(packed(gain, limit), Ordering::Release);
        Ok(())
    }

    /// Protects a coil for as long as the player lives, by its resistance, the volts for each m/s², and its lasting
    /// power.
    ///
    /// The volts become the gain, and the output is the coil's voltage whatever gain is set later. It is then at most
    /// four times the voltage at that power, reaches that in 0.4 ms or more, and is attenuated before its mean power
    /// over 10 s exceeds the limit. Behind an amplifier of gain a, give `ohms` / a² and `volts_per_m_s2` / a: the
    /// output is the amplifier's input.
    pub fn set_coil(&self, ohms: f32, volts_per_m_s2: f32, watts: f32) -> Result<(), Fault> {
        let is_above_zero = |value: f32| value > 0.0 && value.is_finite();
        let mean_square = ohms * watts;
        if ![ohms, watts, mean_square].into_iter().all(is_above_zero) {
            return Err(Fault::Coil);
        }
        if !volts_per_m_s2.is_finite() {
            return Err(Fault::Gain);
        }
        self.shared.coil.store(mean_square.to_bits(), Ordering::Relaxed);
        // Whoever sees the gain sees the coil, too.
        let gain = |scale: u64| packed(volts_per_m_s2, f32::from_bits(scale as u32));
        self.shared.scale.update(Ordering::Release, Ordering::Relaxed, gain);
        Ok(())
    }
}

/// Checks that the motion can be played, and that a hand could have it.
fn checked(motion: &BlockMotion) -> Result<(), Fault> {
    motion.check().map_err(Fault::Motion)?;
    let (fastest, farthest) = MOST_MOTION;
    if motion.speed_mm_s.abs() > fastest {
        return Err(Fault::Motion("no hand has this speed: give it in mm/s"));
    }
    // NaN is a position that is not known.
    if motion.begin_mm.abs() > farthest || motion.end_mm.abs() > farthest {
        return Err(Fault::Motion("no path is as long: give the position in mm"));
    }
    Ok(())
}

const fn packed(gain: f32, limit: f32) -> u64 {
    (gain.to_bits() as u64) << 32 | limit.to_bits() as u64
}

/// The side that takes samples, one thread at a time. It allocates nothing, takes no lock, makes no system call, and
/// needs a bounded time per sample.
pub struct Filler {
    source: Source,
    /// Interpolators of [`PlayRate::ALL`]; none where the output has that rate.
    resamplers: [Option<Resampler>; PlayRate::ALL.len()],
    output_rate_hz: u32,
    output: Output,
}

impl Filler {
    fn new(shared: Arc<Shared>, output_rate_hz: u32, blocker: Option<Blocker>) -> Self {
        let resampler = |rate: PlayRate| {
            let differs = rate.hz() != output_rate_hz;
            differs.then(|| Resampler::new(rate.hz(), output_rate_hz))
        };
        Self {
            resamplers: PlayRate::ALL.map(resampler),
            output_rate_hz,
            source: Source::new(shared, blocker),
            output: Output::new(output_rate_hz),
        }
    }

    /// Output rate, Hz.
    pub fn output_rate_hz(&self) -> u32 {
        self.output_rate_hz
    }

    /// Fills `samples` with the next samples, in m/s² times the gain of [`Mover::set_gain`], clamped to its limit.
    /// Every sample is finite.
    pub fn fill(&mut self, samples: &mut [f32]) {
        let blocks = (samples.len() as u64 * BLOCKS_PER_S).div_ceil(u64::from(self.output_rate_hz));
        self.source
            .follower
            .begin_buffer(u32::try_from(blocks).unwrap_or(u32::MAX));
        let shared = &self.source.shared;
        let scale = shared.scale.load(Ordering::Acquire);
        self.output.aim(Scale {
            gain: f32::from_bits((scale >> 32) as u32),
            limit: f32::from_bits(scale as u32),
            mean_square: f32::from_bits(shared.coil.load(Ordering::Relaxed)),
        });
        for sample in samples {
            let next = self.next();
            *sample = self.output.next(next);
        }
    }

    /// Returns the next sample. When the source changes to another rate, the old rate's interpolator has only silence
    /// left, and the new rate's interpolator begins.
    fn next(&mut self) -> f32 {
        loop {
            let rate = self.source.rate;
            let resampler = &mut self.resamplers[rate as usize];
            let tail = resampler.as_ref().map_or(0, Resampler::memory);
            let source = &mut self.source;
            let mut taken = || source.next(rate, tail);
            let sample = match resampler {
                Some(resampler) => resampler.next(taken),
                None => taken(),
            };
            // Another rate begins only after the tail, so the sample that is dropped here is silence.
            if self.source.rate == rate {
                return sample;
            }
            if let Some(resampler) = &mut self.resamplers[self.source.rate as usize] {
                resampler.reset();
            }
        }
    }
}

/// Samples at the rate of what is played.
struct Source {
    shared: Arc<Shared>,
    follower: Follower,
    playing: Option<Box<Given<Choice>>>,
    /// The choice that waits until what is playing has faded out.
    next: Option<Box<Given<Choice>>>,
    rate: PlayRate,
    blocker: Option<Blocker>,
    block: [OutputSample; MOST_SAMPLES],
    /// Samples of the block that are left.
    left: usize,
    /// Samples since the last block in which something sounded.
    silent: u32,
}

impl Source {
    fn new(shared: Arc<Shared>, blocker: Option<Blocker>) -> Self {
        Self {
            shared,
            follower: Follower::new(),
            playing: None,
            next: None,
            rate: PlayRate::default(),
            blocker,
            block: [OutputSample::SILENCE; MOST_SAMPLES],
            left: 0,
            // Nothing was played yet, so no interpolator has a tail.
            silent: u32::MAX,
        }
    }

    /// Returns the next sample at `rate`, m/s²; silence if another rate has begun. The interpolator still holds `tail`
    /// samples.
    fn next(&mut self, rate: PlayRate, tail: u32) -> f32 {
        if self.left == 0 {
            self.begin_block(tail);
        }
        if self.rate != rate {
            return 0.0;
        }
        let sample = self.block[self.block_samples() - self.left];
        self.left -= 1;
        sample.metres_per_second_squared().0
    }

    fn block_samples(&self) -> usize {
        update_interval_samples(self.rate.hz()) as usize
    }

    fn playing(&mut self) -> Option<&mut Voice> {
        self.playing.as_mut()?.it.as_mut()
    }

    fn begin_block(&mut self, tail: u32) {
        self.take_choice();
        // A block of n samples spans n - 1 intervals.
        let last_s = (self.block_samples() - 1) as f64 / f64::from(self.rate.hz());
        let motion = self.follower.next_block(&self.shared.moves, last_s);
        let is_leaving = self.playing().is_some_and(|voice| {
            voice.with_dependent_mut(|_, playing| {
                // Whether something still fades out is known only after the motion of this block.
                playing.follow(&motion);
                playing.is_leaving()
            })
        });
        if self.next.is_some() && !is_leaving {
            self.begin_choice(&motion, tail);
        }
        self.left = self.block_samples();
        self.block.fill(OutputSample::SILENCE);
        let Self { playing, block, .. } = self;
        let block = &mut block[..self.left];
        let voice = playing.as_mut().and_then(|given| given.it.as_mut());
        let is_muted = voice.is_none() || self.follower.is_over();
        if let Some(voice) = voice {
            voice.with_dependent_mut(|_, playing| playing.play(block));
        }
        if let Some(blocker) = &mut self.blocker {
            blocker.process(self.rate, block, is_muted);
        }
        let is_silent = block.iter().all(|sample| *sample == OutputSample::SILENCE);
        let silent = self.silent.saturating_add(self.left as u32);
        self.silent = if is_silent { silent } else { 0 };
    }

    /// Makes the latest choice the one that waits, and fades out what is playing.
    fn take_choice(&mut self) {
        let Some(given) = self.shared.choices.take() else {
            return;
        };
        match self.next.replace(given) {
            // What is playing already fades out, for a choice that was never played.
            Some(unplayed) => self.shared.choices.give_back(unplayed),
            None => {
                if let Some(voice) = self.playing() {
                    voice.with_dependent_mut(|_, playing| playing.leave());
                }
            }
        }
    }

    /// Begins the choice that waits, because nothing is playing any more. At another rate it begins only after the
    /// `tail`.
    fn begin_choice(&mut self, motion: &BlockMotion, tail: u32) {
        // It goes back to the mover, because freeing memory here would take a lock.
        if let Some(faded) = self.playing.take() {
            self.shared.choices.give_back(faded);
        }
        let next = self.next.as_ref().and_then(|given| given.it.as_ref());
        let rate = next.map_or(self.rate, |voice| {
            let rate_hz = voice.borrow_dependent().plan().sample_rate_hz();
            PlayRate::of(rate_hz).unwrap_or(self.rate)
        });
        // Only one interpolator is heard at a time, so the old one must first have only silence left.
        if rate != self.rate && self.silent < tail {
            return;
        }
        self.rate = rate;
        self.playing = self.next.take();
        if let Some(voice) = self.playing() {
            // This block is the first of the new choice, which has not followed a motion yet.
            voice.with_dependent_mut(|_, playing| playing.follow(motion));
        }
    }
}
