//! What is played: for each voice two frames and a playback, for all of them two blocks and what rings. The tick plays one block
//! while the update decides the other.
//!
//! Whose turn it is:
//! - **The block that is played, the frames and playbacks that it names, and what rings** are the tick's while it plays
//!   ([`crate::tick::play`]). The update may look at those frames too: the tick changes none.
//! - **The other block, the other frames and playbacks, and what the tick has noted** are the update's from the tick's request
//!   until it says that it is ready, and the tick's otherwise. Which ones these are is the director's care, see
//!   [`stylus_kernel::scene::Voices`].
//! - **All of it** is the tasks' while the tick does not play: an update that finds nothing played touches none of it.
#![expect(unsafe_code, reason = "values that go from hand to hand; see above")]

use core::sync::atomic::{AtomicBool, Ordering};

use model_format::OutputSample;
use stylus_app::inputs::Sensors;
use stylus_firmware::CortexM;
use stylus_kernel::scene::{
    Block, Director, Interaction, Ringing, SLOTS, ScenePlayback, VoiceStage, Voices,
};
use stylus_kernel::{Frame, Levels, Playback, UPDATE_INTERVAL_SAMPLES};

use crate::boot::priority;
use crate::play::shared::Handed;

/// One of the two blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The first.
    First,
    /// The second.
    Second,
}

impl Place {
    /// The one that this is not.
    #[inline(always)]
    pub const fn other(self) -> Self {
        match self {
            Self::First => Self::Second,
            Self::Second => Self::First,
        }
    }
}

/// What the tick notes for an update.
#[derive(Clone, Copy)]
pub struct Noted {
    /// The sensors.
    pub sensors: Sensors,
    /// The tick.
    pub tick: u64,
    /// What is played, if anything.
    pub playing: Option<Played>,
}

/// What is played while an update decides what follows.
#[derive(Clone, Copy)]
pub struct Played {
    /// The block.
    pub place: Place,
    /// What rang when it began.
    pub ringing: Ringing,
}

static FRAMES: [[Handed<Option<Frame>>; 2]; SLOTS] =
    [const { [const { Handed::new(None) }; 2] }; SLOTS];
static PLAYBACKS: [Handed<Option<Playback>>; SLOTS] = [const { Handed::new(None) }; SLOTS];
static BLOCKS: [Handed<Block>; 2] = [const { Handed::new(Block::silent()) }; 2];
static SCENE: Handed<ScenePlayback> = Handed::new(ScenePlayback::new());
static NOTED: Handed<Noted> = Handed::new(Noted {
    sensors: Sensors::new(),
    tick: 0,
    playing: None,
});

/// Whether it is the update's turn.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Makes both blocks silent and forgets what was played. For tasks, while nothing is played.
///
/// # Safety
/// The tick does not play.
pub unsafe fn clear() {
    // SAFETY: the caller vouches that it is the tasks' turn.
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

/// How many samples were at full scale since [`clear`], in voices, their sum, or the equaliser.
pub fn saturations() -> u32 {
    // Words that the tick may be writing: with interrupts masked it is not.
    critical_section::with(|_| {
        // SAFETY: neither the tick nor the update runs meanwhile.
        let (scene, playbacks) =
            unsafe { (SCENE.look(), PLAYBACKS.each_ref().map(|one| one.look())) };
        let voices = playbacks.into_iter().flatten().map(Playback::saturations);
        voices.fold(scene.saturations(), u32::saturating_add)
    })
}

/// The next sample of the block in `place`.
///
/// # Safety
/// Called by the tick, which plays `place`.
#[inline(always)]
pub unsafe fn next_sample(place: Place) -> OutputSample {
    // SAFETY: the caller is whose turn it is.
    let (scene, block) = unsafe { (SCENE.get(), BLOCKS[place as usize].look()) };
    scene.next_sample(block, |voice| {
        let (slot, buffer) = indices(voice);
        // SAFETY: they are named by the block that is played.
        let (playback, frame) = unsafe { (PLAYBACKS[slot].get(), FRAMES[slot][buffer].look()) };
        match (playback, frame) {
            (Some(playback), Some(frame)) => playback.next_sample::<CortexM>(frame),
            _ => OutputSample::SILENCE,
        }
    })
}

/// Begins the block in `place`, which was not played before; what rings then.
///
/// # Safety
/// Called by the tick, while it plays and the update is ready.
#[inline(always)]
pub unsafe fn begin_block(place: Place) -> Ringing {
    // SAFETY: the caller is whose turn it is.
    let (scene, block) = unsafe { (SCENE.get(), BLOCKS[place as usize].look()) };
    scene.begin_block(block, |voice| {
        // SAFETY: it is named by the block that is played.
        if let Some(playback) = unsafe { PLAYBACKS[indices(voice).0].get() } {
            playback.begin_frame(UPDATE_INTERVAL_SAMPLES);
        }
    });
    scene.ringing()
}

/// Slot and buffer of a stage, in range whatever it says.
#[inline(always)]
fn indices(voice: VoiceStage) -> (usize, usize) {
    (
        usize::from(voice.slot) % SLOTS,
        usize::from(voice.buffer) % 2,
    )
}

/// Whether the update has done what it was last asked for.
#[inline(always)]
pub fn is_ready() -> bool {
    !REQUESTED.load(Ordering::Acquire)
}

/// Hands what is noted to the update.
///
/// # Safety
/// Called by the tick, while the update is ready.
#[inline(always)]
pub unsafe fn request(noted: Noted) {
    // SAFETY: it is not the update's turn.
    unsafe { *NOTED.get() = noted };
    REQUESTED.store(true, Ordering::Release);
    priority::pend_update();
}

/// What the tick has noted.
///
/// # Safety
/// Called by the update, before [`ready`].
pub unsafe fn noted() -> Noted {
    // SAFETY: it is the update's turn.
    *unsafe { NOTED.look() }
}

/// Has `director` decide the block that follows `played`.
///
/// # Safety
/// Called by the update, before [`ready`], with the director of what is played.
pub unsafe fn direct(director: &mut Director<'_>, interaction: Interaction, played: Played) {
    // SAFETY: it is the update's turn.
    let block = unsafe { BLOCKS[played.place.other() as usize].get() };
    let ringing = played.ringing;
    // Blocks are played to their end.
    director.next_block(
        interaction,
        UPDATE_INTERVAL_SAMPLES,
        0,
        ringing,
        &mut Shared,
        block,
    );
}

/// The update has done what it was asked for.
pub fn ready() {
    REQUESTED.store(false, Ordering::Release);
}

/// The voices, as the director sees them during an update.
struct Shared;

impl Voices for Shared {
    fn frame(&mut self, slot: usize, buffer: usize) -> &mut Option<Frame> {
        // SAFETY: it is the update's turn, and the director asks for what the block that is played does not name.
        unsafe { FRAMES[slot][buffer].get() }
    }

    fn levels(&self, slot: usize, buffer: usize, left: u32) -> Levels {
        // SAFETY: of a frame that is played nobody changes anything, and the other is the update's.
        let frame = unsafe { FRAMES[slot][buffer].look() };
        frame
            .as_ref()
            .map_or(Levels::SILENT, |frame| frame.levels(left))
    }

    fn playback(&mut self, slot: usize) -> &mut Option<Playback> {
        // SAFETY: as above.
        unsafe { PLAYBACKS[slot].get() }
    }
}
