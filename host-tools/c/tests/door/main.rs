//! The library as other languages use it. What fills and moves allocates nothing and frees nothing.
#![expect(unsafe_code, reason = "the functions under test take addresses")]

mod calls;
mod examples;
mod header;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};

use kernel_vectors::digest_library;
use stylus_player::{Selection, SharedLibrary, Without};
use stylusplayer::{Status, stylus_player_fill, stylus_player_move};

use crate::calls::Opened;

thread_local! {
    /// Calls of the allocator while it is forbidden; none while it is allowed.
    static FORBIDDEN: Cell<Option<u32>> = const { Cell::new(None) };
}

struct Watched;

fn note() {
    // A thread that ends has no note any more.
    let _ = FORBIDDEN.try_with(|forbidden| forbidden.set(forbidden.get().map(|calls| calls + 1)));
}

// SAFETY: the system's allocator does all; a note is no allocation.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: as the caller's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, address: *mut u8, layout: Layout) {
        note();
        // SAFETY: as the caller's.
        unsafe { System.dealloc(address, layout) }
    }
}

#[global_allocator]
static WATCHED: Watched = Watched;

/// Calls of the allocator by this thread in `run`.
fn allocations(run: impl FnOnce()) -> u32 {
    FORBIDDEN.set(Some(0));
    run();
    FORBIDDEN.take().unwrap_or_default()
}

#[test]
fn filling_and_moving_allocate_and_free_nothing_while_libraries_change() {
    let player = Opened::player(48_000);
    let (mover, mut filler) = stylus_player::player(44_100).expect("it is played");
    let is_over = AtomicBool::new(false);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            let mut seed = 0;
            while !is_over.load(Ordering::Relaxed) {
                // A library that nothing holds but what plays.
                let library = SharedLibrary::decode(digest_library()).expect("it is valid");
                let selection = Selection::Texture(0);
                mover
                    .choose(&library, selection, Without::default(), seed)
                    .expect("it is there");
                if seed % 5 == 0 {
                    mover.stop();
                }
                player.choose(&Opened::library(), 0);
                seed += 1;
            }
        });
        let mut samples = [0.0f32; 32];
        let calls = allocations(|| {
            for count in 0..20_000u32 {
                let speed_mm_s = f64::from(count % 300);
                mover.rub(speed_mm_s, 0.5).expect("it is finite");
                filler.fill(&mut samples);
                // SAFETY: the player is open, and the samples are there.
                let statuses = unsafe {
                    [
                        stylus_player_move(player.handle(), speed_mm_s, 0.5),
                        stylus_player_fill(player.handle(), samples.as_mut_ptr(), samples.len()),
                        stylus_player_move(player.handle(), f64::NAN, 0.5),
                    ]
                };
                assert_eq!(statuses, [Status::STYLUS_OK, Status::STYLUS_OK, Status::STYLUS_MOTION]);
            }
        });
        is_over.store(true, Ordering::Relaxed);
        assert_eq!(calls, 0);
    });
    assert_ne!(
        allocations(|| drop(std::hint::black_box(Box::new(1)))),
        0,
        "the watch works"
    );
}
