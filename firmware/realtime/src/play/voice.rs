//! State of what is played: two frames and a playback per voice, two blocks, and the ringing. The tick plays one block
//! while the update decides the other block.
//!
//! Owners:
//! - **The block that is played, the frames and playbacks that it names, and the ringing** belong to the tick while the
//!   tick plays ([`crate::tick::play`]). The update may read those frames too, because the tick changes none.
//! - **The other block, the other frames and playbacks, and the tick's note** belong to the update from the tick's
//!   request until [`ready`], and to the tick otherwise. The director chooses frames and playbacks that the block that
//!   is played does not name, see [`stylus_kernel::scene::Voices`].
//! - **All of it** belongs to the tasks while the tick does not play: an update touches none of it if nothing is
//!   played.
#![expect(unsafe_code, reason = "values that change owners; see above")]

use core::sync::atomic::{AtomicBool, Ordering};

use model_format::OutputSample;
use stylus_app::UPDATE_LEAD_TICKS;
use stylus_app::inputs::Sensors;
use stylus_kernel::scene::{Block, Director, Interaction, Ringing, SLOTS, ScenePlayback, VoiceStage, Voices};
use stylus_kernel::{Frame, Levels, Playback};

use crate::CortexM;
use crate::boot::priority;
use crate::play::shared::Handed;

/// Index of one of the two blocks: false is the first. It is a `bool`, because the match of an enumeration compiled to
/// a branch, which cost the tick an instruction in every second block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockIndex(bool);

impl BlockIndex {
    /// The index of the first block.
    pub const FIRST: Self = Self(false);

    /// The index of the other block.
    #[must_use]
    #[inline(always)]
    pub const fn other(self) -> Self {
        Self(!self.0)
    }

    #[inline(always)]
    fn get(self) -> usize {
        usize::from(self.0)
    }
}

/// The tick's note for an update.
#[derive(Clone, Copy)]
pub struct Noted {
    /// Values of the sensors.
    pub sensors: Sensors,
    /// Number of the tick.
    pub tick: u64,
    /// The block that is played, if any.
    pub playing: Option<Played>,
}

/// The block that is played while an update decides the next one.
#[derive(Clone, Copy)]
pub struct Played {
    /// Index of the block.
    pub block: BlockIndex,
    /// The ringing when the block began.
    pub ringing: Ringing,
}

/// Frames of each slot, two each. They are empty until [`begin`], because initial values would take 27 KB of flash.
static FRAMES: [[Handed<Option<Frame>>; 2]; SLOTS] = [const { [const { Handed::empty() }; 2] }; SLOTS];
static PLAYBACKS: [Handed<Option<Playback>>; SLOTS] = [const { Handed::empty() }; SLOTS];
static BLOCKS: [Handed<Block>; 2] = [const { Handed::new(Block::silent()) }; 2];
static SCENE: Handed<ScenePlayback> = Handed::new(ScenePlayback::new());
static NOTED: Handed<Noted> = Handed::new(Noted {
    sensors: Sensors::new(),
    tick: 0,
    playing: None,
});

/// True from the tick's request until the update has finished.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Gives frames and playbacks their first value: silent frames, and no playback. Called once, before everything else
/// here.
///
/// Out of line, because a frame takes kilobytes of the stack.
#[inline(never)]
pub fn begin() {
    critical_section::with(|_| {
        // SAFETY: interrupts are masked, and no reference lives beyond a call in a task.
        unsafe {
            for frame in FRAMES.iter().flatten() {
                frame.set(Some(Frame::empty()));
            }
            for playback in &PLAYBACKS {
                playback.set(None);
            }
        }
    });
}

/// Makes both blocks silent and forgets the voices. For tasks, while nothing is played.
///
/// # Safety
/// The tick does not play.
pub unsafe fn clear() {
    // SAFETY: by the caller's contract everything here belongs to the tasks.
    unsafe {
        for block in &BLOCKS {
            *block.get() = Block::silent();
        }
        for playback in &PLAYBACKS {
            *playback.get() = None;
        }
        *SCENE.get() = ScenePlayback::new();
    }
}

/// Number of samples that reached full scale since [`clear`], in voices, their sum, or the equaliser.
pub fn saturations() -> u32 {
    // The tick may write these words, but not while interrupts are masked.
    critical_section::with(|_| {
        // SAFETY: interrupts are masked, so neither the tick nor the update runs.
        let (scene, playbacks) = unsafe { (SCENE.look(), PLAYBACKS.each_ref().map(|one| one.look())) };
        let voices = playbacks.into_iter().flatten().map(Playback::saturations);
        voices.fold(scene.saturations(), u32::saturating_add)
    })
}

/// The next sample of block `index`.
///
/// # Safety
/// Called by the tick, which plays that block.
#[inline(always)]
pub unsafe fn next_sample(index: BlockIndex) -> OutputSample {
    // SAFETY: by the caller's contract the playback of the scene and the block belong to the tick.
    let (scene, block) = unsafe { (SCENE.get(), BLOCKS[index.get()].look()) };
    scene.next_sample(block, |voice| {
        let (slot, buffer) = indices(voice);
        // SAFETY: the block that is played names this playback and this frame.
        let (playback, frame) = unsafe { (PLAYBACKS[slot].get(), FRAMES[slot][buffer].look()) };
        match (playback, frame) {
            (Some(playback), Some(frame)) => playback.next_sample::<CortexM>(frame),
            _ => OutputSample::SILENCE,
        }
    })
}

/// Begins block `index`, which was not played before, and returns the ringing at the beginning of the block.
///
/// The function is never inlined, so that it takes no registers from the ticks that begin no block.
///
/// # Safety
/// Called by the tick, while it plays and the update is ready.
#[inline(never)]
pub unsafe fn begin_block(index: BlockIndex) -> Ringing {
    // SAFETY: by the caller's contract the playback of the scene and the block belong to the tick.
    let (scene, block) = unsafe { (SCENE.get(), BLOCKS[index.get()].look()) };
    scene.begin_block(block, |voice| {
        let (slot, _) = indices(voice);
        // SAFETY: the block that is played names this playback.
        if let Some(playback) = unsafe { PLAYBACKS[slot].get() } {
            playback.begin_frame(block.samples());
        }
    });
    scene.ringing()
}

/// Slot and buffer of a stage, reduced to their ranges, so that no index panics.
#[inline(always)]
fn indices(voice: VoiceStage) -> (usize, usize) {
    (usize::from(voice.slot) % SLOTS, usize::from(voice.buffer) % 2)
}

/// True if the update has finished the tick's last request.
#[inline(always)]
pub fn is_ready() -> bool {
    !REQUESTED.load(Ordering::Acquire)
}

/// Hands `noted` to the update and requests it.
///
/// # Safety
/// Called by the tick, while the update is ready.
#[inline(always)]
pub unsafe fn request(noted: Noted) {
    // SAFETY: the update is ready, so the note belongs to the tick.
    unsafe { *NOTED.get() = noted };
    REQUESTED.store(true, Ordering::Release);
    priority::pend_update();
}

/// The tick's note.
///
/// # Safety
/// Called by the update, before [`ready`].
pub unsafe fn noted() -> Noted {
    // SAFETY: before `ready` the note belongs to the update.
    *unsafe { NOTED.look() }
}

/// Makes `director` decide the block that follows `played`. That block begins [`UPDATE_LEAD_TICKS`] after `tick`, the
/// tick of the request.
///
/// # Safety
/// Called by the update, before [`ready`], with the director of what is played.
pub unsafe fn direct(director: &mut Director<'_>, interaction: Interaction, tick: u64, played: Played) {
    // SAFETY: before `ready` the other block belongs to the update.
    let block = unsafe { BLOCKS[played.block.other().get()].get() };
    let ringing = played.ringing;
    // A plan that waits has the same rate, because a change of rate starts from silence.
    let samples = director.plan().block_samples();
    director.at_tick(tick + u64::from(UPDATE_LEAD_TICKS));
    // Every block is played to its end, so the next one begins with no samples left over.
    director.next_block(interaction, samples, 0, ringing, &mut SharedVoices, block);
}

/// Reports that the update has finished.
pub fn ready() {
    REQUESTED.store(false, Ordering::Release);
}

/// The voices, as the director sees them during an update.
struct SharedVoices;

impl Voices for SharedVoices {
    type Arithmetic = CortexM;

    fn frame(&mut self, slot: usize, buffer: usize) -> &mut Option<Frame> {
        // SAFETY: the director asks only for frames that the block that is played does not name; these belong to the
        // update.
        unsafe { FRAMES[slot][buffer].get() }
    }

    fn levels(&self, slot: usize, buffer: usize, left: u32) -> Levels {
        // SAFETY: nothing changes a frame that is played, and the other frame belongs to the update.
        let frame = unsafe { FRAMES[slot][buffer].look() };
        frame.as_ref().map_or(Levels::SILENT, |frame| frame.levels(left))
    }

    fn playback(&mut self, slot: usize) -> &mut Option<Playback> {
        // SAFETY: as above.
        unsafe { PLAYBACKS[slot].get() }
    }
}
