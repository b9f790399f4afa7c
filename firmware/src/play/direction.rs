//! Who decides what is played: the director, and what is to be played next.
//!
//! Whose turn it is:
//! - **The director** is the update's while the tick plays, and the tasks' otherwise: an update that finds nothing played does
//!   not touch it.
//! - **What is next** is the update's while [`WAITS`] says so, and the tasks' otherwise. Tasks take it back by clearing that; the
//!   update interrupts them, but they never interrupt it, so it has taken all or nothing.
//!
//! Both are some kilobytes, which the tick does not touch; they lie in SRAM 4.
#![expect(unsafe_code, reason = "values that go from hand to hand; see above")]

use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering, compiler_fence};

use stylus_app::inputs::Follower;
use stylus_kernel::scene::{Director, Plan};

use crate::play::shared::Handed;

/// What decides, and how it follows the hand.
pub struct Direction {
    /// What decides.
    pub director: Director<'static>,
    /// How the hand is followed.
    pub follower: Follower,
}

/// What is to be played next.
struct Next {
    plan: Plan<'static>,
    follower: Follower,
}

#[unsafe(link_section = ".sram4.direction")]
static DIRECTION: Handed<MaybeUninit<Direction>> = Handed::new(MaybeUninit::uninit());
#[unsafe(link_section = ".sram4.next")]
static NEXT: Handed<MaybeUninit<Next>> = Handed::new(MaybeUninit::uninit());

/// Whether there is a director.
static DIRECTS: AtomicBool = AtomicBool::new(false);

/// Whether something is to be played next.
static WAITS: AtomicBool = AtomicBool::new(false);

/// Lets `plan` be decided from silence; `seed` is its noise's. For tasks, while nothing is played.
///
/// # Safety
/// The tick does not play.
pub unsafe fn start(plan: Plan<'static>, follower: Follower, seed: u64) {
    WAITS.store(false, Ordering::Relaxed);
    // SAFETY: the caller vouches that it is the tasks' turn. What was there has nothing to drop.
    unsafe { DIRECTION.get() }.write(Direction {
        director: Director::new(plan, seed),
        follower,
    });
    DIRECTS.store(true, Ordering::Release);
}

/// Forgets the director, and all textures with it. For tasks, while nothing is played.
///
/// # Safety
/// The tick does not play.
pub unsafe fn clear() {
    WAITS.store(false, Ordering::Relaxed);
    DIRECTS.store(false, Ordering::Release);
}

/// From the next update on, `plan` waits for what is played to fade. For tasks.
pub fn switch(plan: Plan<'static>, follower: Follower) {
    WAITS.store(false, Ordering::Relaxed);
    // The update, which may come at any instruction, must find all of it or nothing.
    compiler_fence(Ordering::SeqCst);
    // SAFETY: nothing waits, so it is the tasks' turn, and there is one task that calls this at a time.
    unsafe { NEXT.get() }.write(Next { plan, follower });
    WAITS.store(true, Ordering::Release);
}

/// The director, after it was told of what waits.
///
/// # Safety
/// Called by the update, once each time it runs, while the tick plays.
pub unsafe fn directed() -> Option<&'static mut Direction> {
    if !DIRECTS.load(Ordering::Acquire) {
        return None;
    }
    // SAFETY: it is the update's turn, and there is a director, so it was written.
    let direction = unsafe { DIRECTION.get().assume_init_mut() };
    if WAITS.swap(false, Ordering::AcqRel) {
        // SAFETY: it waited, so it was written, and it is the update's turn; it is read once.
        let Next { plan, follower } = unsafe { NEXT.get().assume_init_read() };
        direction.director.switch(plan);
        direction.follower = follower;
    }
    Some(direction)
}
