//! The update: every 2 ms it turns the motion of the hand into the next block. It runs at a lower priority than the
//! tick and a higher one than all tasks.

#![expect(
    unsafe_code,
    reason = "a vector's name, its place in memory, and values that the update owns"
)]

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::DWT;
use model_format::link::{CycleRange, MotionSource};
use stylus_app::inputs::{self, Estimator, InputConfig, Timed};

use crate::play::shared::OfHandler;
use crate::play::{direction, voice};

/// True if, at the last update, the motion that is followed was too old.
static STALE: AtomicBool = AtomicBool::new(true);

/// True if the motion that is followed was too old because the force sensor was at a rail of its converter.
static RAILED: AtomicBool = AtomicBool::new(false);

/// Inputs of an update in addition to the tick's note.
pub struct Update {
    /// Conversion of counts and codes to speed and force.
    pub config: InputConfig,
    /// Estimate of the tool's motion from the encoder's counts.
    encoder: Estimator,
    /// Source of the motion that is followed.
    pub source: MotionSource,
    /// The last motion from the host.
    pub host: Timed,
    /// Durations since the last [`take_range`].
    range: CycleRange,
}

/// The inputs; none before [`start`].
static UPDATE: OfHandler<Option<Update>> = OfHandler::new(None);

/// Sets the inputs, with no motion yet.
pub fn start(config: InputConfig) {
    UPDATE.with(|_, update| {
        *update = Some(Update {
            config,
            encoder: Estimator::new(),
            source: MotionSource::Sensors,
            host: Timed::NEVER,
            range: CycleRange::NONE,
        });
    });
}

/// Returns true if the motion that is followed was too old at the last update.
pub fn is_stale() -> bool {
    STALE.load(Ordering::Relaxed)
}

/// Returns the range of the updates' durations since the last call, and begins a new range. A duration includes the
/// interrupts that came in between.
pub fn take_range() -> CycleRange {
    UPDATE.with(|_, update| {
        let range = update.as_mut().map(|update| &mut update.range);
        range.map_or(CycleRange::NONE, |range| core::mem::replace(range, CycleRange::NONE))
    })
}

/// Returns true if the motion that is followed was too old because the force sensor was at a rail of its converter.
pub fn is_railed() -> bool {
    RAILED.load(Ordering::Relaxed)
}

/// Changes the inputs before the next update.
pub fn change(change: impl FnOnce(&mut Update)) {
    UPDATE.with(|_, update| {
        if let Some(update) = update {
            change(update);
        }
    });
}

/// The update's interrupt, pended by the tick. **Deadline: 0.6 ms, until the next block.**
///
/// The time of an update is bounded: at most two voices, the highest order of their textures, four nodes around the
/// motion, twenty samples of excitation from codebooks, and the ticks that interrupt it. If the update
/// is late, the previous block continues with its ramps at their ends. A voice with codebooks then has no
/// excitation, so that its filter rings out. `status` counts the late update.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.update")]
extern "C" fn SWPMI1() {
    let begin = DWT::cycle_count();
    #[cfg(feature = "fault-injection")]
    crate::injection::in_update();
    // SAFETY: this is the update, which the tick has requested.
    let noted = unsafe { voice::noted() };
    // SAFETY: this is the handler that owns the value.
    if let Some(update) = unsafe { UPDATE.in_handler() } {
        let sensors = update.encoder.motion(&noted.sensors, &update.config);
        let chosen = inputs::choose(update.source, sensors, update.host);
        let stale = chosen.is_stale(noted.tick);
        let by_rail = update.source == MotionSource::Sensors && noted.sensors.is_railed();
        STALE.store(stale, Ordering::Relaxed);
        RAILED.store(stale && by_rail, Ordering::Relaxed);
        if let Some(played) = noted.playing {
            // SAFETY: this is the update, and the tick plays.
            if let Some(direction) = unsafe { direction::directed() } {
                let follower = &mut direction.follower;
                let interaction = follower.follow(chosen, &update.encoder, &update.config, noted.tick);
                // SAFETY: as above. The director is the one of the block that is played.
                unsafe { voice::direct(&mut direction.director, interaction, noted.tick, played) };
            }
        }
        let cycles = DWT::cycle_count().wrapping_sub(begin);
        update.range = update.range.merged(CycleRange {
            runs: 1,
            shortest: cycles,
            longest: cycles,
        });
    }
    voice::ready();
}
