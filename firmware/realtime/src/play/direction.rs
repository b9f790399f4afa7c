//! The director, which decides each block, and the plan that follows the one that the director plays.
//!
//! Owners:
//! - **The director** belongs to the update while the tick plays, and to the tasks otherwise: an update does not touch
//!   it if nothing is played.
//! - **The next plan** belongs to the update while [`WAITS`] is set, and to the tasks otherwise. Tasks take it back by
//!   clearing that flag. The update interrupts tasks, but tasks never interrupt the update, so it has taken either all
//!   of the plan or nothing.
//!
//! The director and the next plan take some kilobytes each, and the tick touches neither. They lie in SRAM 4, like the
//! waveform of a probe.
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

/// The waveform of a probe. Tasks write it before the plan that plays it; the update reads it.
#[unsafe(link_section = ".sram4.waveform")]
static WAVEFORM: Waveform = [const { AtomicI16::new(0) }; _];

/// True while there is a director.
static DIRECTS: AtomicBool = AtomicBool::new(false);

/// True while the next plan is ready for the update.
static WAITS: AtomicBool = AtomicBool::new(false);

/// True while the next plan is ready for [`start`]. Only tasks use this flag.
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
/// No plan was prepared. Then there is no director.
///
/// # Safety
/// The tick does not play.
pub unsafe fn start(seed: u64) -> Result<(), NotPrepared> {
    DIRECTS.store(false, Ordering::Relaxed);
    WAITS.store(false, Ordering::Relaxed);
    if !PREPARED.swap(false, Ordering::Relaxed) {
        return Err(NotPrepared);
    }
    // SAFETY: the plan was prepared, so it was written. `WAITS` is clear, so the plan belongs to the tasks. It is read
    // once.
    let Next { plan, follower } = unsafe { NEXT.get().assume_init_read() };
    // SAFETY: the tick does not play, so the director belongs to the tasks. The previous director has nothing to drop.
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

/// Replaces the next plan. Neither [`start`] nor the update takes it until its flag is set.
fn write_next(next: Next) {
    PREPARED.store(false, Ordering::Relaxed);
    WAITS.store(false, Ordering::Relaxed);
    // The update may come at any instruction, and must find all of the plan or nothing.
    compiler_fence(Ordering::SeqCst);
    // SAFETY: `WAITS` is clear, so the plan belongs to the tasks, and one task at a time calls this. The plan that is
    // overwritten has nothing to drop.
    unsafe { NEXT.get() }.write(next);
}

/// Returns the director, after handing it the next plan if one waits.
///
/// # Safety
/// Called by the update, once each time it runs, while the tick plays.
pub unsafe fn directed() -> Option<&'static mut Direction> {
    if !DIRECTS.load(Ordering::Acquire) {
        return None;
    }
    // SAFETY: the tick plays, so the director belongs to the update; `DIRECTS` is set, so it was written.
    let direction = unsafe { DIRECTION.get().assume_init_mut() };
    if WAITS.swap(false, Ordering::AcqRel) {
        // SAFETY: `WAITS` was set, so the plan was written and belongs to the update. It is read once.
        let Next { plan, follower } = unsafe { NEXT.get().assume_init_read() };
        direction.director.switch(plan);
        direction.follower = follower;
    }
    Some(direction)
}
