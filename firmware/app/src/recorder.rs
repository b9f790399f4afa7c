//! Recording, without a lock between the tick and thread mode.
//!
//! The tick puts one sample per tick into a queue ([`Tap`]), and thread mode packs them into blocks ([`Recorder`]). The
//! number of a block follows from the ticks of its samples. A block that lacks a sample, because the queue was full, is
//! left out. It leaves a gap in the numbers, which device and host can count.

use heapless::spsc::{Consumer, Producer, Queue};
use model_format::link::{
    BLOCK_SAMPLES, PackedSample, RecordBlock, RecordCounters, RecordError, RecordSample, RecordStarted, RecordStopped,
};

use crate::SAMPLE_RATE_HZ;
use crate::levels::{Accumulator, Sums};

/// Length of the queue: 100 ms of samples. One entry always stays empty.
pub const QUEUE_SAMPLES: usize = 512;

/// A sample with the lower 32 bits of its tick's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimedSample {
    tick: u32,
    sample: PackedSample,
    /// True if all conversions belong to this tick.
    whole: bool,
}

/// The queue from the tick to thread mode.
pub type SampleQueue = Queue<TimedSample, QUEUE_SAMPLES>;

/// Producing end of the queue, for the tick.
pub struct Tap<'q> {
    queue: Producer<'q, TimedSample>,
}

impl<'q> Tap<'q> {
    /// A tap on the queue's producing end.
    pub const fn new(queue: Producer<'q, TimedSample>) -> Self {
        Self { queue }
    }

    /// Queues the sample of `tick`. `whole` is true if all its conversions belong to that tick. If the queue is full,
    /// the sample is lost, and the recorder finds the gap.
    #[inline(always)]
    pub fn put(&mut self, tick: u64, sample: RecordSample, whole: bool) {
        let timed = TimedSample {
            tick: tick as u32,
            sample: sample.into(),
            whole,
        };
        let _ = self.queue.enqueue(timed);
    }
}

/// Consuming end of the queue, for thread mode: it packs samples into the blocks of a recording, and sums all of them
/// up for the sensors' levels.
pub struct Recorder<'q> {
    queue: Consumer<'q, TimedSample>,
    recording: bool,
    /// Tick of the recording's first sample, once it is known.
    start: Option<u64>,
    /// Index of the next sample, counted from the first one.
    next: u64,
    /// Samples of the block under way.
    samples: [PackedSample; BLOCK_SAMPLES],
    /// One bit per sample of the block under way: set if its conversions do not all belong to its tick.
    torn: u32,
    /// True if the block under way misses no sample so far.
    whole: bool,
    blocks: u32,
    lost_blocks: u32,
    levels: Accumulator,
}

impl<'q> Recorder<'q> {
    /// A recorder on the queue's consuming end that does not record.
    pub const fn new(queue: Consumer<'q, TimedSample>) -> Self {
        Self {
            queue,
            recording: false,
            start: None,
            next: 0,
            samples: [PackedSample::ZERO; BLOCK_SAMPLES],
            torn: 0,
            whole: true,
            blocks: 0,
            lost_blocks: 0,
            levels: Accumulator::new(),
        }
    }

    /// Begins a recording with the next sample after those in the queue.
    pub fn start(&mut self) -> Result<RecordStarted, RecordError> {
        if self.recording {
            return Err(RecordError::Recording);
        }
        // Samples from before the start belong to no recording. The loop is bounded, because the tick continues to
        // queue samples.
        for _ in 0..QUEUE_SAMPLES {
            self.queue.dequeue();
        }
        self.recording = true;
        self.start = None;
        self.next = 0;
        self.whole = true;
        self.blocks = 0;
        self.lost_blocks = 0;
        Ok(RecordStarted {
            sample_rate_hz: SAMPLE_RATE_HZ,
            block_samples: BLOCK_SAMPLES as u32,
        })
    }

    /// Ends the recording; a block that is not full is dropped.
    pub fn stop(&mut self) -> Result<RecordStopped, RecordError> {
        if !self.recording {
            return Err(RecordError::NotRecording);
        }
        self.recording = false;
        Ok(RecordStopped {
            blocks: self.blocks,
            lost_blocks: self.lost_blocks,
        })
    }

    /// The next whole block, if enough samples have come. `now` is within 2³¹ ticks, 5 days, of the present tick.
    pub fn next_block(&mut self, now: u64) -> Option<RecordBlock> {
        // The loop is bounded, because the tick continues to queue samples.
        for _ in 0..QUEUE_SAMPLES {
            let timed = self.queue.dequeue()?;
            // The levels are those of all samples, also while nothing is recorded.
            self.levels.take(timed.sample.into());
            if self.recording
                && let Some(block) = self.take(whole_tick(timed.tick, now), timed)
            {
                return Some(block);
            }
        }
        None
    }

    /// Adds the sample of `tick` to its block, and returns the block if the sample completes it.
    fn take(&mut self, tick: u64, timed: TimedSample) -> Option<RecordBlock> {
        let start = *self.start.get_or_insert(tick);
        let index = tick.saturating_sub(start);
        self.close_missed(index);
        let place = (index % BLOCK_SAMPLES as u64) as usize;
        self.samples[place] = timed.sample;
        // The word still has the bits of the block before, so a whole sample clears its own.
        let bit = 1 << place;
        self.torn = if timed.whole { self.torn & !bit } else { self.torn | bit };
        self.next = index + 1;
        if !self.next.is_multiple_of(BLOCK_SAMPLES as u64) {
            return None;
        }
        self.close_block().map(|sequence| RecordBlock {
            sequence,
            first_tick: start + u64::from(sequence) * BLOCK_SAMPLES as u64,
            lost_blocks: self.lost_blocks,
            torn: self.torn,
            samples: self.samples,
        })
    }

    /// Counts the blocks that miss samples before the sample at `index`.
    fn close_missed(&mut self, index: u64) {
        if index <= self.next {
            return;
        }
        self.whole = false;
        let (block, missed_to) = (self.next / BLOCK_SAMPLES as u64, index / BLOCK_SAMPLES as u64);
        let missed = (missed_to - block) as u32;
        self.blocks = self.blocks.saturating_add(missed);
        self.lost_blocks = self.lost_blocks.saturating_add(missed);
        // A block that begins with this sample misses nothing.
        if missed > 0 && index.is_multiple_of(BLOCK_SAMPLES as u64) {
            self.whole = true;
        }
    }

    /// Ends the block under way and returns its number if it is whole.
    fn close_block(&mut self) -> Option<u32> {
        let sequence = self.blocks;
        self.blocks = self.blocks.saturating_add(1);
        let whole = core::mem::replace(&mut self.whole, true);
        if whole {
            return Some(sequence);
        }
        self.lost_blocks = self.lost_blocks.saturating_add(1);
        None
    }

    /// Sums of the last whole window of samples, recorded or not.
    pub fn sums(&self) -> Sums {
        self.levels.sums()
    }

    /// Counters of this recording or the last one.
    pub fn counters(&self) -> RecordCounters {
        RecordCounters {
            recording: self.recording,
            blocks: self.blocks,
            lost_blocks: self.lost_blocks,
        }
    }
}

/// The tick nearest to `now` whose lower 32 bits are `low`.
fn whole_tick(low: u32, now: u64) -> u64 {
    let ahead = low.wrapping_sub(now as u32) as i32;
    now.wrapping_add_signed(i64::from(ahead))
}
