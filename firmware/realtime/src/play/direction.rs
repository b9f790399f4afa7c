//! The director, which decides each block, and the plan that follows the one it plays.
//!
//! Owners:
//! - **The director** belongs to the update while the tick plays, and to the tasks otherwise: an update that finds
//!   nothing played does not touch it.
//! - **The next plan** belongs to the update while [`WAITS`] is set, and to the tasks otherwise. Tasks take it back by
//!   clearing that flag. The update interrupts tasks, but they never interrupt it, so it has taken all of the plan or
//!   nothing.
//!
//! Each is some kilobytes, which the tick does not touch. Both lie in SRAM 4, and so does the waveform of a probe.
#![expect(unsafe_code, reason = "values that change owners; see above")]

use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, AtomicI16, Ordering, compiler_fence};

use stylus_app::control::{NotPrepared, Waveform};
use stylus_app::inputs::Follower;
use stylus_kernel::scene::{Director, Plan};

use crate::play::shared::Handed;

/// The director of what is played, and the follower of the hand.
pub struct Direction {
    /// The director.
    pub director: Director<'static>,
    /// The follower of the hand.
    pub follower: Follower,
}

/// A plan that is ready to be played, and the follower of the hand through it.
pub struct Next {
    /// The plan.
    pub plan: Plan<'static>,
    /// A follower that has seen nothing yet.
    pub follower: Follower,
}

#[unsafe(link_section = ".sram4.direction")]
static DIRECTION: Handed<MaybeUninit<Direction>> = Handed::new(MaybeUninit::uninit());
#[unsafe(link_section = ".sram4.next")]
static NEXT: Handed<MaybeUninit<Next>> = Handed::new(MaybeUninit::uninit());

/// Written by tasks before the plan that plays it, and read by the update.
#[unsafe(link_section = ".sram4.waveform")]
static WAVEFORM: Waveform = [const { AtomicI16::new(0) }; _];

/// True while there is a director.
static DIRECTS: AtomicBool = AtomicBool::new(false);

/// True while the next plan is there for the update.
static WAITS: AtomicBool = AtomicBool::new(false);

/// True while the next plan is there for [`start`]. Only tasks use this flag.
static PREPARED: AtomicBool = AtomicBool::new(false);

/// Memory of a probe's waveform.
pub fn waveform() -> &'static Waveform {
    &WAVEFORM
}

/// Keeps `next` for [`start`]. For tasks.
pub fn prepare(next: Next) {
    write_next(next);
    PREPARED.store(true, Ordering::Relaxed);
}

/// Plays the prepared plan from silence, with noise from `seed`. For tasks, while nothing is played.
///
/// # Errors
/// No plan was prepared; there is no director then.
///
/// # Safety
/// The tick does not play.
pub unsafe fn start(seed: u64) -> Result<(), NotPrepared> {
    DIRECTS.store(false, Ordering::Relaxed);
    WAITS.store(false, Ordering::Relaxed);
    if !PREPARED.swap(false, Ordering::Relaxed) {
        return Err(NotPrepared);
    }
    // SAFETY: it was prepared, so it was written, and nothing waits, so it is the tasks'; it is read once.
    let Next { plan, follower } = unsafe { NEXT.get().assume_init_read() };
    // SAFETY: the tick does not play, so the director is the tasks'. The one before has nothing to drop.
    unsafe { DIRECTION.get() }.write(Direction {
        director: Director::new(plan, seed),
        follower,
    });
    DIRECTS.store(true, Ordering::Release);
    Ok(())
}

/// Forgets the director and the next plan, and all textures with them. For tasks, while nothing is played.
///
/// # Safety
/// The tick does not play.
pub unsafe fn clear() {
    PREPARED.store(false, Ordering::Relaxed);
    WAITS.store(false, Ordering::Relaxed);
    DIRECTS.store(false, Ordering::Release);
}

/// Hands `next` to the director at the next update; the director fades what is played. For tasks.
pub fn switch(next: Next) {
    write_next(next);
    WAITS.store(true, Ordering::Release);
}

/// Replaces the next plan, which neither [`start`] nor the update takes until it is marked for one of them.
fn write_next(next: Next) {
    PREPARED.store(false, Ordering::Relaxed);
    WAITS.store(false, Ordering::Relaxed);
    // The update may come at any instruction, and must find all of the plan or nothing.
    compiler_fence(Ordering::SeqCst);
    // SAFETY: nothing waits, so it is the tasks', and one task at a time calls this. What was there has nothing to
    // drop.
    unsafe { NEXT.get() }.write(next);
}

/// The director, after it was told of the plan that waits.
///
/// # Safety
/// Called by the update, once each time it runs, while the tick plays.
pub unsafe fn directed() -> Option<&'static mut Direction> {
    if !DIRECTS.load(Ordering::Acquire) {
        return None;
    }
    // SAFETY: the tick plays, so it is the update's, and there is a director, so it was written.
    let direction = unsafe { DIRECTION.get().assume_init_mut() };
    if WAITS.swap(false, Ordering::AcqRel) {
        // SAFETY: it waited, so it was written and is the update's; it is read once.
        let Next { plan, follower } = unsafe { NEXT.get().assume_init_read() };
        direction.director.switch(plan);
        direction.follower = follower;
    }
    Some(direction)
}
