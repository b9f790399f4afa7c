//! Blocks of the recorder compared with the samples that were put in, with and without loss.

use model_format::AdcCode;
use model_format::link::{BLOCK_SAMPLES, RecordBlock, RecordSample};
use proptest::prelude::*;
use stylus_app::recorder::{QUEUE_SAMPLES, Recorder, SampleQueue, Tap};

use crate::budget;

/// A sample that contains the number of its tick.
fn sample(tick: u64) -> RecordSample {
    RecordSample {
        acceleration: [tick, tick >> 16, tick >> 32].map(|part| AdcCode(part as u16)),
        force: AdcCode(!tick as u16),
        encoder_delta: (tick * 3) as i16,
    }
}

/// Returns true if all conversions of `tick` belong to it, which is false for one tick in seven.
fn is_whole(tick: u64) -> bool {
    tick % 7 != 3
}

fn check_block(block: &RecordBlock, start: u64) {
    assert_eq!(
        block.first_tick,
        start + u64::from(block.sequence) * BLOCK_SAMPLES as u64
    );
    for (index, &packed) in block.samples.iter().enumerate() {
        assert_eq!(RecordSample::from(packed), sample(block.first_tick + index as u64));
        let tick = block.first_tick + index as u64;
        assert_eq!(block.is_whole(index), is_whole(tick), "the mark of tick {tick}");
    }
}

#[test]
fn a_recording_holds_nothing_from_before_it_began() {
    let mut queue = SampleQueue::new();
    let (producer, consumer) = queue.split();
    let (mut tap, mut recorder) = (Tap::new(producer), Recorder::new(consumer));
    for tick in 0..100 {
        tap.put(tick, sample(tick), is_whole(tick));
    }
    assert_eq!(recorder.next_block(100), None, "none is under way");
    for tick in 100..200 {
        tap.put(tick, sample(tick), is_whole(tick));
    }
    recorder.start().expect("none is under way");
    for tick in 200..300 {
        tap.put(tick, sample(tick), is_whole(tick));
    }
    let block = recorder.next_block(300).expect("three whole ones are there");
    assert_eq!((block.first_tick, block.sequence), (200, 0));
}

proptest! {
    #![proptest_config(budget::config(300))]

    /// However long the reader pauses, every block is right, and the numbers show exactly which blocks are missing.
    #[test]
    fn loss_is_counted_block_by_block(start in 0u64..1 << 34, pauses in prop::collection::vec(1u64..1500, 1..40)) {
        let mut queue = SampleQueue::new();
        let (producer, consumer) = queue.split();
        let (mut tap, mut recorder) = (Tap::new(producer), Recorder::new(consumer));
        recorder.start().expect("none is under way");
        let (mut tick, mut came, mut whole) = (start, Vec::new(), Vec::new());
        let mut in_queue = 0u64;
        // The oracle: a sample is lost if the queue, which holds one less than its length, is full.
        let mut lost_ticks = std::collections::BTreeSet::new();
        for pause in pauses {
            for _ in 0..pause {
                tap.put(tick, sample(tick), is_whole(tick));
                if in_queue == QUEUE_SAMPLES as u64 - 1 {
                    lost_ticks.insert(tick);
                } else {
                    in_queue += 1;
                }
                tick += 1;
            }
            while let Some(block) = recorder.next_block(tick) {
                check_block(&block, start);
                came.push(block.sequence);
            }
            in_queue = 0;
        }
        let block_of = |tick: u64| (tick - start) / BLOCK_SAMPLES as u64;
        let lost: std::collections::BTreeSet<_> = lost_ticks.iter().map(|&tick| block_of(tick)).collect();
        let last_seen = (start..tick).rev().find(|tick| !lost_ticks.contains(tick)).expect("the first comes");
        // Number of blocks that have ended, as far as the reader can know.
        let over = (last_seen + 1 - start) / BLOCK_SAMPLES as u64;
        whole.extend((0..over).filter(|block| !lost.contains(block)).map(|block| block as u32));
        prop_assert_eq!(&came, &whole);
        let stopped = recorder.stop().expect("one is under way");
        prop_assert_eq!(u64::from(stopped.blocks), over);
        prop_assert_eq!(stopped.lost_blocks as usize, over as usize - whole.len());
    }
}
