//! A library being played, block by block, as the device plays it; and the faults of a call, with their numbers and
//! texts.

use core::fmt;

use model_format::{DecodeError, Library, OutputSample, Texture};
use stylus_kernel::digest::{DIGEST_WORDS, Digest, Stroke};
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::scene::Plan;
use stylus_player::{BlockMotion, ChoiceError, Playing, Selection, Without, plan_of};

/// Samples of so many blocks at 10 kHz.
pub const MOST_SAMPLES: usize = MOST_BLOCKS * 20;

/// Numbers of a voice in a state.
pub const VOICE_NUMBERS: usize = 14;

/// Numbers of a state: four, and those of two voices.
pub const STATE_NUMBERS: usize = 4 + 2 * VOICE_NUMBERS;

/// A choice, and what was played of it.
struct Chosen<'a> {
    playing: Playing<'a>,
    digest: Digest,
    words: u32,
}

impl<'a> Chosen<'a> {
    fn new(plan: Plan<'a>, seed: u64) -> Self {
        Self {
            playing: Playing::new(plan, seed),
            digest: Digest::default(),
            words: 0,
        }
    }

    fn play(&mut self, outputs: &mut [OutputSample]) {
        self.playing.play(outputs);
        // Digests are compared over a fixed number of words, whatever is played after them.
        let left = (DIGEST_WORDS - self.words) as usize;
        let counted = &outputs[..left.min(outputs.len())];
        for &sample in counted {
            self.digest.add(sample);
        }
        self.words += counted.len() as u32;
    }
}

/// The motion of the digest's stroke at `block` of a plan at `sample_rate_hz`.
pub fn motion_of_digest(block: u32, sample_rate_hz: u32) -> BlockMotion {
    let stroke = Stroke::at(block, sample_rate_hz);
    BlockMotion {
        begin_mm: stroke.begin_mm,
        end_mm: stroke.end_mm,
        ..BlockMotion::new(f64::from(stroke.speed_mm_s), f64::from(stroke.force_n))
    }
}

/// A library being played. Once something was chosen, nothing is allocated.
pub struct Session<'a> {
    library: Library<'a>,
    chosen: Option<Chosen<'a>>,
    /// The choice that waits for what sounds to fade, and its seed.
    next: Option<(Plan<'a>, u64)>,
}

impl<'a> Session<'a> {
    /// A session of `library` in which nothing is chosen.
    pub fn new(library: Library<'a>) -> Self {
        Self {
            library,
            chosen: None,
            next: None,
        }
    }

    /// Plays `selection` from the next block on, or as soon as what sounds has faded, with the noise of `seed`.
    ///
    /// # Errors
    /// A texture or scene that is not there, or a scene that cannot be played. What played before goes on.
    pub fn choose(&mut self, selection: Selection, without: Without, seed: u64) -> Result<(), Fault> {
        let plan = plan_of(&self.library, selection, without)?;
        match &mut self.chosen {
            Some(chosen) if chosen.playing.plan().sample_rate_hz() == plan.sample_rate_hz() => {
                chosen.playing.leave();
                self.next = Some((plan, seed));
            }
            // Nothing to fade, or blocks of another length.
            _ => {
                self.chosen = Some(Chosen::new(plan, seed));
                self.next = None;
            }
        }
        Ok(())
    }

    /// Sample rate of the choice, Hz; 0 without one.
    pub fn sample_rate_hz(&self) -> u32 {
        let plan = self.chosen.as_ref().map(|chosen| chosen.playing.plan());
        plan.map_or(0, Plan::sample_rate_hz)
    }

    /// Samples of a block of the choice; 0 without one.
    pub fn block_samples(&self) -> u32 {
        let plan = self.chosen.as_ref().map(|chosen| chosen.playing.plan());
        plan.map_or(0, Plan::block_samples)
    }

    /// Plays a block for each of `motions` into `outputs`, which has room for all their samples.
    ///
    /// # Errors
    /// No choice, more than [`MOST_BLOCKS`], or a motion that cannot be played. Nothing is played then.
    pub fn play(&mut self, motions: &[BlockMotion], outputs: &mut [OutputSample]) -> Result<(), Fault> {
        let Some(chosen) = &mut self.chosen else {
            return Err(Fault::NothingChosen);
        };
        if motions.len() > MOST_BLOCKS {
            return Err(Fault::TooManyBlocks(motions.len()));
        }
        for (block, motion) in motions.iter().enumerate() {
            let checked = motion.check();
            checked.map_err(|problem| Fault::Motion { block, problem })?;
        }
        let samples = chosen.playing.plan().block_samples() as usize;
        for (motion, outputs) in motions.iter().zip(outputs.chunks_mut(samples)) {
            chosen.playing.follow(motion);
            // Nothing sounds any more: the new choice begins, with a noise of its own.
            if !chosen.playing.is_leaving()
                && let Some((plan, seed)) = self.next.take()
            {
                *chosen = Chosen::new(plan, seed);
                chosen.playing.follow(motion);
            }
            chosen.play(outputs);
        }
        Ok(())
    }

    /// Digest of the words of the choice so far, at most [`DIGEST_WORDS`], and their number.
    pub fn digest(&self) -> (Digest, u32) {
        let chosen = self.chosen.as_ref();
        chosen.map_or_else(Default::default, |chosen| (chosen.digest, chosen.words))
    }

    /// State after the last block; the package's page has the order of its numbers.
    pub fn state(&self) -> [f64; STATE_NUMBERS] {
        let Some(Chosen { playing, .. }) = &self.chosen else {
            return [0.0; STATE_NUMBERS];
        };
        let plan = playing.plan();
        // A scene with a motion of its own plays at that, wherever the hand is.
        let motion = plan.constant_motion().unwrap_or(playing.motion());
        let located = plan.locate(playing.at_mm() as f32);
        let mut numbers = [0.0; STATE_NUMBERS];
        numbers[0] = playing.at_mm();
        numbers[1] = f64::from(u8::from(playing.contact()));
        numbers[2] = f64::from(playing.saturations());
        numbers[3] = located.len() as f64;
        let share = |steps: u32| f64::from(steps) / f64::from(ONE);
        let voices = numbers[4..].chunks_exact_mut(VOICE_NUMBERS);
        for (voice, there) in voices.zip(&located) {
            let surface = usize::from(there.surface);
            let (texture, gain) = plan.surfaces().nth(surface).unwrap_or((None, 0));
            voice[0] = f64::from(there.surface);
            voice[1] = texture.map_or(-1.0, |texture| self.index_of(&texture));
            voice[2] = share(there.weight) * share(gain);
            let Some(texture) = texture else {
                continue;
            };
            let point = GridPoint::locate(&texture, motion);
            let forces = texture.force_axis().len();
            voice[3] = share(point.fade);
            for corner in 0..4 {
                let (speed, force) = point.nodes[corner];
                voice[4 + corner] = (speed * forces + force) as f64;
                voice[8 + corner] = share(point.weights[corner]);
            }
            voice[12] = f64::from(motion.speed_mm_s());
            voice[13] = f64::from(motion.force_n());
        }
        numbers
    }

    /// Index of a texture of the library, which is there.
    fn index_of(&self, texture: &Texture<'_>) -> f64 {
        let mut textures = self.library.textures();
        let found = textures.position(|other| other.name() == texture.name());
        found.map_or(-1.0, |index| index as f64)
    }
}

/// Blocks that one call plays at most: half a second.
pub const MOST_BLOCKS: usize = 256;

/// A call that was refused. What played before goes on.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// No library is loaded.
    NoLibrary,
    /// Bytes that are no library, or a damaged one.
    Library(DecodeError),
    /// A library is loaded already.
    Loaded,
    /// A texture or scene that is not there, or cannot be played.
    Choice(ChoiceError),
    /// Nothing is chosen.
    NothingChosen,
    /// More blocks than one call plays.
    TooManyBlocks(usize),
    /// A speed, force or position that cannot be played.
    Motion {
        /// The block of the call, from 0.
        block: usize,
        /// The column and its fault.
        problem: &'static str,
    },
}

impl Fault {
    /// Number of the fault, as exports return it; never 0.
    pub const fn status(&self) -> u32 {
        match self {
            Self::NoLibrary => 1,
            Self::Library(_) => 2,
            Self::Loaded => 3,
            Self::Choice(ChoiceError::NoTexture { .. }) => 4,
            Self::Choice(_) => 5,
            Self::NothingChosen => 6,
            Self::TooManyBlocks(_) => 7,
            Self::Motion { .. } => 8,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoLibrary => f.write_str("no library is loaded: call reserve, write it there, and call load"),
            Self::Library(error) => write!(f, "this is no library that can be played: {error}"),
            Self::Loaded => f.write_str("a library is loaded already: make another instance of the module"),
            Self::Choice(error) => error.fmt(f),
            Self::NothingChosen => f.write_str("nothing is chosen: call choose_texture or choose_scene"),
            Self::TooManyBlocks(blocks) => {
                write!(
                    f,
                    "{blocks} blocks are more than one call plays: ask for at most {MOST_BLOCKS}"
                )
            }
            Self::Motion { block, problem } => write!(f, "block {block} of the motion: {problem}"),
        }
    }
}

impl core::error::Error for Fault {}

impl From<ChoiceError> for Fault {
    fn from(error: ChoiceError) -> Self {
        Self::Choice(error)
    }
}
