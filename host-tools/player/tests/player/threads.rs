//! Threads that move and choose while another takes samples.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::common::{LIBRARIES, choose, playing};

#[test]
fn what_is_taken_while_threads_move_and_choose_is_a_texture_and_then_the_last_choice() {
    let (mover, mut filler) = playing(&LIBRARIES[0], 0, 48_000);
    let is_over = AtomicBool::new(false);
    std::thread::scope(|threads| {
        for thread in 0..2 {
            let (mover, is_over) = (mover.clone(), &is_over);
            threads.spawn(move || {
                let mut count = 0u32;
                while !is_over.load(Ordering::Relaxed) {
                    let speed_mm_s = 50.0 + f64::from(count % 100);
                    mover.rub(speed_mm_s, 0.5).expect("it is finite");
                    if thread == 0 && count.is_multiple_of(1000) {
                        choose(&mover, &LIBRARIES[count as usize / 1000 % 2], 1);
                    }
                    count += 1;
                }
            });
        }
        let mut samples = [0.0f32; 64];
        for _ in 0..3000 {
            filler.fill(&mut samples);
            assert!(samples.iter().all(|sample| sample.is_finite()));
        }
        is_over.store(true, Ordering::Relaxed);
    });
    choose(&mover, &LIBRARIES[0], 2);
    let mut samples = vec![0.0f32; 4800];
    mover.rub(100.0, 1.0).expect("it is finite");
    filler.fill(&mut samples);
    assert!(samples.iter().any(|sample| *sample != 0.0));
}
