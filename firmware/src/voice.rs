//! What is played: two frames, of which the tick plays one while the update computes the other, and the playback.
//!
//! Whose turn it is:
//! - **Playback and the frame that is played** are the tick's while it plays ([`crate::tick::play`]). The update may look at
//!   that frame too: the tick changes none.
//! - **The other frame and what the tick has noted** are the update's from the tick's request until it says that it is ready,
//!   and the tick's otherwise.
//! - **All of it** is the tasks' while the tick does not play: an update that finds nothing played touches no frame.
#![expect(unsafe_code, reason = "values that go from hand to hand; see above")]

use core::sync::atomic::{AtomicBool, Ordering};

use model_format::{OutputSample, Texture};
use stylus_app::inputs::Sensors;
use stylus_firmware::CortexM;
use stylus_kernel::{Frame, Motion, Playback, UPDATE_INTERVAL_SAMPLES};

use crate::priority;
use crate::shared::Handed;

/// One of the two frames.
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
    /// Which frame is played, if any.
    pub playing: Option<Place>,
}

static FRAMES: [Handed<Option<Frame>>; 2] = [const { Handed::new(None) }; 2];
static PLAYBACK: Handed<Option<Playback>> = Handed::new(None);
static NOTED: Handed<Noted> = Handed::new(Noted {
    sensors: Sensors::new(),
    tick: 0,
    playing: None,
});

/// Whether it is the update's turn.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Puts `texture` in place, at rest and silent; `seed` is its noise's. For tasks, while nothing is played.
///
/// # Safety
/// The tick does not play.
pub unsafe fn load(texture: &Texture<'_>, seed: u64) {
    // SAFETY: the caller vouches that it is the tasks' turn.
    unsafe {
        for frame in &FRAMES {
            *frame.get() = Some(Frame::silent(texture));
        }
        *PLAYBACK.get() = Some(Playback::new(texture, seed));
    }
}

/// How many samples were at full scale since [`load`].
pub fn saturations() -> u32 {
    // One word, which the tick may be writing: with interrupts masked it is not.
    critical_section::with(|_| {
        // SAFETY: the tick does not run meanwhile.
        unsafe { PLAYBACK.get() }
            .as_ref()
            .map_or(0, Playback::saturations)
    })
}

/// The next sample of the frame in `place`.
///
/// # Safety
/// Called by the tick, which plays `place`.
#[inline(always)]
pub unsafe fn next_sample(place: Place) -> OutputSample {
    // SAFETY: the caller is whose turn it is.
    let (playback, frame) = unsafe { (PLAYBACK.get(), FRAMES[place as usize].look()) };
    match (playback, frame) {
        (Some(playback), Some(frame)) => playback.next_sample::<CortexM>(frame),
        _ => OutputSample::SILENCE,
    }
}

/// Hands what is noted to the update, unless it is still at work on the last: then false, and nothing is handed.
///
/// # Safety
/// Called by the tick.
#[inline(always)]
pub unsafe fn request(noted: Noted) -> bool {
    if REQUESTED.load(Ordering::Acquire) {
        return false;
    }
    // SAFETY: it is not the update's turn.
    unsafe { *NOTED.get() = noted };
    REQUESTED.store(true, Ordering::Release);
    priority::pend_update();
    true
}

/// Begins the ramps of a frame that was not played before.
///
/// # Safety
/// Called by the tick, while it plays.
#[inline(always)]
pub unsafe fn begin_frame() {
    // SAFETY: the caller is whose turn it is.
    if let Some(playback) = unsafe { PLAYBACK.get() } {
        playback.begin_frame(UPDATE_INTERVAL_SAMPLES);
    }
}

/// What the tick has noted.
///
/// # Safety
/// Called by the update, before [`ready`].
pub unsafe fn noted() -> Noted {
    // SAFETY: it is the update's turn.
    *unsafe { NOTED.look() }
}

/// Computes the frame that follows the one in `playing`, for `motion` on `texture`.
///
/// # Safety
/// Called by the update, before [`ready`].
pub unsafe fn compute(texture: &Texture<'_>, motion: Motion, playing: Place) {
    // SAFETY: it is the update's turn; of the frame that is played nobody changes anything.
    let (next, before) = unsafe {
        (
            FRAMES[playing.other() as usize].get(),
            FRAMES[playing as usize].look(),
        )
    };
    if let (Some(next), Some(before)) = (next, before) {
        next.update(texture, motion, before.levels(0), UPDATE_INTERVAL_SAMPLES);
    }
}

/// The update has done what it was asked for.
pub fn ready() {
    REQUESTED.store(false, Ordering::Release);
}
