//! Recording without a lock between the tick and thread mode.
//!
//! The tick puts one sample a tick into a queue, [`Tap`], and thread mode packs them into blocks, [`Recorder`]. A block's
//! number follows from the tick of its samples, so a sample that did not fit the queue makes its block a gap in the numbers,
//! which both sides can count.

use heapless::spsc::{Consumer, Producer, Queue};
use model_format::link::{
    BLOCK_SAMPLES, PackedSample, RecordBlock, RecordCounters, RecordError, RecordSample,
    RecordStarted, RecordStopped,
};

use crate::SAMPLE_RATE_HZ;

/// Length of the queue: 100 ms of samples, one place stays empty.
pub const QUEUE_SAMPLES: usize = 512;

/// A sample with the lower digits of its tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimedSample {
    tick: u32,
    sample: PackedSample,
}

/// The queue from the tick to thread mode.
pub type SampleQueue = Queue<TimedSample, QUEUE_SAMPLES>;

/// The tick's end of the queue.
pub struct Tap<'q> {
    queue: Producer<'q, TimedSample>,
}

impl<'q> Tap<'q> {
    /// On the queue's producing end.
    pub const fn new(queue: Producer<'q, TimedSample>) -> Self {
        Self { queue }
    }

    /// Notes the sample of `tick`. If the queue is full it is lost, and the recorder finds the gap.
    #[inline(always)]
    pub fn put(&mut self, tick: u64, sample: RecordSample) {
        let timed = TimedSample {
            tick: tick as u32,
            sample: sample.into(),
        };
        let _ = self.queue.enqueue(timed);
    }
}

/// Thread mode's end: blocks of a recording.
pub struct Recorder<'q> {
    queue: Consumer<'q, TimedSample>,
    recording: bool,
    /// The tick of the recording's first sample, once it is known.
    start: Option<u64>,
    /// How many samples from the start the next one is.
    next: u64,
    /// Samples of the block under way, unless one of it is missing.
    samples: [PackedSample; BLOCK_SAMPLES],
    whole: bool,
    blocks: u32,
    lost_blocks: u32,
}

impl<'q> Recorder<'q> {
    /// On the queue's consuming end, not recording.
    pub const fn new(queue: Consumer<'q, TimedSample>) -> Self {
        Self {
            queue,
            recording: false,
            start: None,
            next: 0,
            samples: [PackedSample::ZERO; BLOCK_SAMPLES],
            whole: true,
            blocks: 0,
            lost_blocks: 0,
        }
    }

    /// Begins a recording with the next sample after what is in the queue.
    ///
    /// # Errors
    /// One is under way.
    pub fn start(&mut self) -> Result<RecordStarted, RecordError> {
        if self.recording {
            return Err(RecordError::Recording);
        }
        // What is left of the time before belongs to no recording. A bounded number, or a fast tick would hold us here.
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
    ///
    /// # Errors
    /// None is under way.
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

    /// The next whole block, if enough samples have come. `now` is about the present tick, within 2^31 ticks or 5 days.
    pub fn next_block(&mut self, now: u64) -> Option<RecordBlock> {
        // No more than a queue full at a time: the tick fills it while we read.
        for _ in 0..QUEUE_SAMPLES {
            let timed = self.queue.dequeue()?;
            if self.recording
                && let Some(block) = self.take(whole_tick(timed.tick, now), timed.sample)
            {
                return Some(block);
            }
        }
        None
    }

    /// Takes the sample of `tick`; the block that it completes.
    fn take(&mut self, tick: u64, sample: PackedSample) -> Option<RecordBlock> {
        let start = *self.start.get_or_insert(tick);
        let index = tick.saturating_sub(start);
        self.close_missed(index);
        self.samples[(index % BLOCK_SAMPLES as u64) as usize] = sample;
        self.next = index + 1;
        if !self.next.is_multiple_of(BLOCK_SAMPLES as u64) {
            return None;
        }
        self.close_block().map(|sequence| RecordBlock {
            sequence,
            first_tick: start + u64::from(sequence) * BLOCK_SAMPLES as u64,
            lost_blocks: self.lost_blocks,
            samples: self.samples,
        })
    }

    /// Counts what is missing before the sample at `index`.
    fn close_missed(&mut self, index: u64) {
        if index <= self.next {
            return;
        }
        self.whole = false;
        let (block, missed_to) = (
            self.next / BLOCK_SAMPLES as u64,
            index / BLOCK_SAMPLES as u64,
        );
        let missed = (missed_to - block) as u32;
        self.blocks = self.blocks.saturating_add(missed);
        self.lost_blocks = self.lost_blocks.saturating_add(missed);
        // A block that begins with this very sample has lost nothing.
        if missed > 0 && index.is_multiple_of(BLOCK_SAMPLES as u64) {
            self.whole = true;
        }
    }

    /// Ends the block under way; its number if it is whole.
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

    /// What is counted, of this recording or the last.
    pub fn counters(&self) -> RecordCounters {
        RecordCounters {
            recording: self.recording,
            blocks: self.blocks,
            lost_blocks: self.lost_blocks,
        }
    }
}

/// The tick nearest to `now` whose lower digits are `low`.
fn whole_tick(low: u32, now: u64) -> u64 {
    let ahead = low.wrapping_sub(now as u32) as i32;
    now.wrapping_add_signed(i64::from(ahead))
}
