//! A library being played, block by block, as the device plays it.

use model_format::scene::Scene;
use model_format::{Library, MillimetresPerSecond, Newton, OutputSample, Texture};
use stylus_kernel::Motion;
use stylus_kernel::digest::{DIGEST_WORDS, Digest, Stroke};
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::position::Position;
use stylus_kernel::scene::{ContactDetector, ContactThreshold, Interaction, Plan, ScenePlayer};

use crate::fault::{Fault, MOST_BLOCKS};

/// Samples of so many blocks at 10 kHz.
pub const MOST_SAMPLES: usize = MOST_BLOCKS * 20;

/// Numbers of a block's motion.
pub const BLOCK_NUMBERS: usize = 5;

/// Numbers of a voice in a state.
pub const VOICE_NUMBERS: usize = 14;

/// Numbers of a state: four, and those of two voices.
pub const STATE_NUMBERS: usize = 4 + 2 * VOICE_NUMBERS;

/// A texture or scene, by its place in the library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// A texture, everywhere and without effects.
    Texture(usize),
    /// A scene.
    Scene(usize),
}

/// Parts of textures that are left out, for comparisons.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Without(u32);

impl Without {
    /// Codebooks: Gaussian noise excites the filter instead.
    pub const CODEBOOKS: Self = Self(1);
    /// The track of the level.
    pub const TRACK: Self = Self(2);
    /// Lines that are locked to place.
    pub const LINES: Self = Self(4);

    /// Parts by their bits; others are ignored.
    pub const fn of_bits(bits: u32) -> Self {
        Self(bits & 7)
    }

    const fn has(self, part: Self) -> bool {
        self.0 & part.0 != 0
    }

    fn of(self, mut texture: Texture<'_>) -> Texture<'_> {
        if self.has(Self::CODEBOOKS) {
            texture = texture.without_codebooks();
        }
        if self.has(Self::TRACK) {
            texture = texture.without_track();
        }
        if self.has(Self::LINES) {
            texture = texture.without_lines();
        }
        texture
    }
}

/// The motion of one block. A value that is not a number stands for one that is not known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockMotion {
    /// Tangential speed, mm/s, signed by the direction.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Position at the block's first sample, mm; with that at its last one, or not at all.
    pub begin_mm: f64,
    /// Position at the block's last sample, mm.
    pub end_mm: f64,
    /// Contact, 0 or another number; not a number: by force.
    pub contact: f64,
}

impl BlockMotion {
    /// A motion whose position and contact follow from speed, mm/s, and force, N.
    pub const fn new(speed_mm_s: f64, force_n: f64) -> Self {
        Self {
            speed_mm_s,
            force_n,
            begin_mm: f64::NAN,
            end_mm: f64::NAN,
            contact: f64::NAN,
        }
    }

    /// The motion of the digest's stroke at `block` of a plan at `sample_rate_hz`.
    pub fn of_digest(block: u32, sample_rate_hz: u32) -> Self {
        let stroke = Stroke::at(block, sample_rate_hz);
        Self {
            begin_mm: stroke.begin_mm,
            end_mm: stroke.end_mm,
            ..Self::new(f64::from(stroke.speed_mm_s), f64::from(stroke.force_n))
        }
    }

    /// The motion of these numbers, in the order of the fields.
    pub const fn of_numbers(numbers: [f64; BLOCK_NUMBERS]) -> Self {
        let [speed_mm_s, force_n, begin_mm, end_mm, contact] = numbers;
        Self {
            speed_mm_s,
            force_n,
            begin_mm,
            end_mm,
            contact,
        }
    }

    /// The numbers of the motion, in the order of the fields.
    pub const fn numbers(self) -> [f64; BLOCK_NUMBERS] {
        [
            self.speed_mm_s,
            self.force_n,
            self.begin_mm,
            self.end_mm,
            self.contact,
        ]
    }

    /// Speed and force, as the kernel takes them.
    fn motion(&self) -> Result<Motion, &'static str> {
        // What single precision cannot hold becomes infinite, and is refused.
        let speed = MillimetresPerSecond(self.speed_mm_s as f32);
        let motion = Motion::new(speed, Newton(self.force_n as f32));
        motion.map_err(|error| match error {
            stylus_kernel::MotionError::Speed => "the speed is not finite: give it in mm/s",
            stylus_kernel::MotionError::Force => "the force is not finite: give it in N",
        })
    }

    fn check(&self) -> Result<(), &'static str> {
        self.motion()?;
        let (begin, end) = (self.begin_mm, self.end_mm);
        if begin.is_nan() != end.is_nan() {
            return Err("one of its two positions is not a number: give both or none");
        }
        if begin.is_infinite() || end.is_infinite() {
            return Err("a position is infinite: give it in mm");
        }
        Ok(())
    }
}

/// A choice and its state.
struct Playing<'a> {
    plan: Plan<'a>,
    player: ScenePlayer<'a>,
    detector: ContactDetector,
    /// Position after the last block, mm.
    at_mm: f64,
    contact: bool,
    motion: Motion,
    digest: Digest,
    words: u32,
}

impl<'a> Playing<'a> {
    fn new(plan: Plan<'a>, seed: u64) -> Self {
        Self {
            player: ScenePlayer::new(plan.clone(), seed),
            plan,
            detector: ContactDetector::new(),
            at_mm: 0.0,
            contact: false,
            motion: Motion::REST,
            digest: Digest::default(),
            words: 0,
        }
    }

    /// Follows `motion`, which was checked, for the next block.
    fn follow(&mut self, motion: &BlockMotion) {
        let samples = self.plan.block_samples();
        let rate_hz = f64::from(self.plan.sample_rate_hz());
        let (begin_mm, end_mm) = if motion.begin_mm.is_nan() {
            let last_s = f64::from(samples - 1) / rate_hz;
            (self.at_mm, self.at_mm + motion.speed_mm_s * last_s)
        } else {
            (motion.begin_mm, motion.end_mm)
        };
        self.at_mm = if motion.begin_mm.is_nan() {
            begin_mm + motion.speed_mm_s * f64::from(samples) / rate_hz
        } else {
            end_mm
        };
        self.motion = motion.motion().unwrap_or(Motion::REST);
        let touches = self.detector.touches(self.motion, ContactThreshold::LEAST);
        self.contact = if motion.contact.is_nan() {
            touches
        } else {
            motion.contact != 0.0
        };
        let farthest = f64::from(f32::MAX);
        let begin_mm = begin_mm.clamp(-farthest, farthest) as f32;
        let interaction = Interaction::new(self.motion, begin_mm, self.contact);
        let interaction = interaction.unwrap_or(Interaction::NONE);
        let end = Position::from_exact_mm(end_mm);
        self.player.follow(interaction.reaching(Some(end)), samples);
    }

    fn play(&mut self, outputs: &mut [OutputSample]) {
        self.player.next_block(outputs);
        let left = (DIGEST_WORDS - self.words) as usize;
        let counted = &outputs[..left.min(outputs.len())];
        for &sample in counted {
            self.digest.add(sample);
        }
        self.words += counted.len() as u32;
    }
}

/// A library being played. Once something was chosen, nothing is allocated.
pub struct Session<'a> {
    library: Library<'a>,
    playing: Option<Playing<'a>>,
    /// The choice that waits for what sounds to fade, and its seed.
    next: Option<(Plan<'a>, u64)>,
}

impl<'a> Session<'a> {
    /// A session of `library` in which nothing is chosen.
    pub fn new(library: Library<'a>) -> Self {
        Self {
            library,
            playing: None,
            next: None,
        }
    }

    /// The library.
    pub fn library(&self) -> &Library<'a> {
        &self.library
    }

    /// Texture number `index` of the library.
    ///
    /// # Errors
    /// Fewer textures.
    pub fn texture(&self, index: usize) -> Result<Texture<'a>, Fault> {
        let count = self.library.len();
        let texture = self.library.texture_at(index);
        texture.ok_or(Fault::NoTexture { index, count })
    }

    /// Scene number `index` of the library.
    ///
    /// # Errors
    /// Fewer scenes.
    pub fn scene(&self, index: usize) -> Result<Scene, Fault> {
        let count = self.library.scene_count();
        let scene = self.library.scene_at(index);
        scene.ok_or(Fault::NoScene { index, count })
    }

    /// Plays `selection` from the next block on, or as soon as what sounds has faded, with the noise of `seed`.
    ///
    /// # Errors
    /// A texture or scene that is not there, or a scene that cannot be played. What played before goes on.
    pub fn choose(
        &mut self,
        selection: Selection,
        without: Without,
        seed: u64,
    ) -> Result<(), Fault> {
        let plan = match selection {
            Selection::Texture(index) => Plan::of_texture(self.texture(index)?),
            Selection::Scene(index) => {
                Plan::new(&self.scene(index)?, &self.library).map_err(Fault::Scene)?
            }
        };
        let plan = plan.with_textures(|texture| without.of(texture));
        match &mut self.playing {
            Some(playing) if playing.plan.sample_rate_hz() == plan.sample_rate_hz() => {
                playing.player.switch(plan.clone());
                self.next = Some((plan, seed));
            }
            // Nothing to fade, or blocks of another length.
            _ => {
                self.playing = Some(Playing::new(plan, seed));
                self.next = None;
            }
        }
        Ok(())
    }

    /// Sample rate of the choice, Hz; 0 without one.
    pub fn sample_rate_hz(&self) -> u32 {
        let plan = self.playing.as_ref().map(|playing| &playing.plan);
        plan.map_or(0, Plan::sample_rate_hz)
    }

    /// Samples of a block of the choice; 0 without one.
    pub fn block_samples(&self) -> u32 {
        let plan = self.playing.as_ref().map(|playing| &playing.plan);
        plan.map_or(0, Plan::block_samples)
    }

    /// Plays a block for each of `motions` into `outputs`, which has room for all their samples.
    ///
    /// # Errors
    /// No choice, more than [`MOST_BLOCKS`], or a motion that cannot be played. Nothing is played then.
    pub fn play(
        &mut self,
        motions: &[BlockMotion],
        outputs: &mut [OutputSample],
    ) -> Result<(), Fault> {
        let Some(playing) = &mut self.playing else {
            return Err(Fault::NothingChosen);
        };
        if motions.len() > MOST_BLOCKS {
            return Err(Fault::TooManyBlocks(motions.len()));
        }
        for (block, motion) in motions.iter().enumerate() {
            let checked = motion.check();
            checked.map_err(|problem| Fault::Motion { block, problem })?;
        }
        let samples = playing.plan.block_samples() as usize;
        for (motion, outputs) in motions.iter().zip(outputs.chunks_mut(samples)) {
            playing.follow(motion);
            // The old player has taken the new plan up, because nothing sounds any more. The new one takes its place,
            // with a noise of its own.
            if !playing.player.director().is_switching()
                && let Some((plan, seed)) = self.next.take()
            {
                *playing = Playing::new(plan, seed);
                playing.follow(motion);
            }
            playing.play(outputs);
        }
        Ok(())
    }

    /// Digest of the words of the choice so far, at most [`DIGEST_WORDS`], and their number.
    pub fn digest(&self) -> (Digest, u32) {
        let playing = self.playing.as_ref();
        playing.map_or_else(Default::default, |playing| (playing.digest, playing.words))
    }

    /// State after the last block; the package's page has the order of its numbers.
    pub fn state(&self) -> [f64; STATE_NUMBERS] {
        let Some(playing) = &self.playing else {
            return [0.0; STATE_NUMBERS];
        };
        let plan = &playing.plan;
        let motion = plan.constant_motion().unwrap_or(playing.motion);
        let located = plan.locate(playing.at_mm as f32);
        let mut numbers = [0.0; STATE_NUMBERS];
        numbers[0] = playing.at_mm;
        numbers[1] = f64::from(u8::from(playing.contact));
        numbers[2] = f64::from(playing.player.saturations());
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
