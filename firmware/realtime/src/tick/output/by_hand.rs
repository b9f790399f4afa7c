//! The output, set by the self test instead of the texture, with the amplifier disabled.
//!
//! These codes take the path of all codes: the tick writes them into the ring, so they end when ticks end. The tick
//! uses them only while the amplifier is off. A new code begins in the middle of a tick's codes, when no handler runs
//! that would delay reading it back.

use core::sync::atomic::{AtomicI32, Ordering};

use model_format::DacCode;
use stylus_app::safety::OVERSAMPLING;

use crate::tick::output::{amplifier, is_out};

/// Value of [`CODE`] while the output is not set by hand.
const NOBODY: i32 = i32::MIN;

/// The code, steps from mid-scale, or [`NOBODY`].
static CODE: AtomicI32 = AtomicI32::new(NOBODY);

/// The code of the previous tick, steps from mid-scale. Only the tick uses it.
static BEFORE: AtomicI32 = AtomicI32::new(0);

/// Returns true while the output is moved by hand.
#[inline(always)]
pub fn is_held() -> bool {
    CODE.load(Ordering::Relaxed) != NOBODY
}

/// The codes to put out in place of `codes`, which have passed the safety stages.
#[inline(always)]
pub fn instead_of(codes: [DacCode; OVERSAMPLING]) -> [DacCode; OVERSAMPLING] {
    let code = CODE.load(Ordering::Relaxed);
    if code == NOBODY || amplifier::is_on() {
        BEFORE.store(0, Ordering::Relaxed);
        return codes;
    }
    let before = BEFORE.load(Ordering::Relaxed);
    BEFORE.store(code, Ordering::Relaxed);
    let [before, code] = [before, code].map(DacCode::from_mid_scale);
    core::array::from_fn(|place| if place < OVERSAMPLING / 2 { before } else { code })
}

/// The right to set the output by hand. When it is dropped, the tick has the output again, and the amplifier is enabled
/// if it was before.
pub struct ByHand {
    was_wanted: bool,
}

impl ByHand {
    /// Disables the amplifier and takes the output, which is at rest.
    pub fn take() -> Self {
        let was_wanted = amplifier::is_wanted();
        amplifier::disable();
        CODE.store(0, Ordering::Relaxed);
        Self { was_wanted }
    }

    /// Sets the code, which is on the pin within three ticks.
    pub fn set(&self, code: DacCode) {
        let middle = i32::from(DacCode::MID_SCALE.get());
        CODE.store(i32::from(code.get()) - middle, Ordering::Relaxed);
    }

    /// The code that was set last; mid-scale at first.
    pub fn code(&self) -> DacCode {
        DacCode::from_mid_scale(CODE.load(Ordering::Relaxed))
    }

    /// Returns true if `code` is on the pin.
    #[inline(always)]
    pub fn is_out(&self, code: DacCode) -> bool {
        is_out(code)
    }
}

impl Drop for ByHand {
    fn drop(&mut self) {
        CODE.store(NOBODY, Ordering::Relaxed);
        if self.was_wanted {
            amplifier::enable();
        }
    }
}
