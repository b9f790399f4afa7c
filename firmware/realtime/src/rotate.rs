//! The lattice's stages, ordered for a Cortex-M7.
//!
//! Each stage computes two sums. Each sum has a product of the backward signal, which is known long before, and a
//! product of the forward signal, which comes from the previous stage. The products of the backward signal are computed
//! while the previous stage's signal is truncated and doubled, so that a stage waits for only one product of its own.

use core::arch::asm;

use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::Rotation;

/// Stages per turn of the loop, whose backward signals are loaded two at a time.
const TURN_STAGES: usize = 4;

/// One stage with forward signal `$forward`. Its sums `$down` and `$up` already contain their products of the backward
/// signal. The stage's rotation is in `r0` to `r2`. `$low` has the low words of `$up`, and `r2` has those of `$down`.
/// `$down` becomes the forward signal of the next stage. `$up` becomes the backward signal, which is stored.
///
/// The next stage begins between the instructions of this stage: its rotation is loaded, and the products of its
/// backward signal, `$next_low`, are computed as its first sums. `$forward` becomes the next stage's sum `$next_down`.
/// `$load` loads the next two backward signals.
macro_rules! stage {
    ($forward:literal, $down:literal, $up:literal, $low:literal, $next_up:literal, $next_low:literal, $store:literal
     $(, $load:literal)?) => {
        concat!(
            "smlal r2, ", $down, ", r0, ", $forward, "\n",
            "smlal ", $low, ", ", $up, ", r1, ", $forward, "\n",
            $($load, "\n",)?
            "ldmdb r10!, {{r0, r1, r2}}\n",
            "add ", $down, ", ", $down, ", ", $down, ", lsr #31\n",
            "add ", $up, ", ", $up, ", ", $up, ", lsr #31\n",
            "smull r2, ", $forward, ", r2, ", $next_low, "\n",
            "qadd ", $down, ", ", $down, ", ", $down, "\n",
            "smull ", $next_low, ", ", $next_up, ", r0, ", $next_low, "\n",
            "qadd ", $up, ", ", $up, ", ", $up, "\n",
            "str ", $up, ", [r11, ", $store, "]\n",
        )
    };
}

/// Three stages of a turn: all but the last.
macro_rules! three_stages {
    () => {
        concat!(
            stage!("r8", "r5", "r9", "r3", "lr", "r4", "#8"),
            stage!("r5", "r8", "lr", "r4", "r9", "r3", "#12", "ldrd r4, r3, [r11, #-8]!"),
            stage!("r8", "r5", "r9", "r3", "lr", "r4", "#8"),
        )
    };
}

/// Passes one sample through the stages, in 11 instructions per stage.
#[inline(always)]
pub fn rotate(rotations: &[Rotation], backward: &mut [i32], mut forward: i32) -> i32 {
    let (turns, rest) = rotations.as_chunks::<TURN_STAGES>();
    let stages = turns.as_flattened().len();
    // The stages that do not fill a turn are the last ones, which are computed first.
    if !rest.is_empty() {
        forward = Portable::rotate(rest, &mut backward[stages..], forward);
    }
    if stages == 0 {
        return forward;
    }
    let turns = turns.as_flattened();
    let ends = backward[..=stages].as_mut_ptr_range();
    // SAFETY: with n = `stages`, a positive multiple of 4, the code reads rotations n - 1 to 0, three words each
    // (`Rotation` is `repr(C)` of three), reads words n - 1 to 0 of `backward`, and writes words n to 1. It begins at
    // the end of `rotations` and at word n, the last of the slice of n + 1 words. At the beginning of a turn the
    // rotation and the backward signals of its first stages are loaded, and the turn loads those of the next turn. The
    // last turn, which begins with three rotations left to load, is separate and loads none for a next turn. All words
    // are aligned, as LDRD and LDM require. All registers are named, Q and the flags are declared as changed, and the
    // stack is not used.
    #[expect(unsafe_code, reason = "the compiler begins no stage before the last")]
    unsafe {
        asm!(
            "ldrd r4, r3, [r11, #-8]!",
            "ldmdb r10!, {{r0, r1, r2}}",
            "smull r2, r5, r2, r3",
            "smull r3, r9, r0, r3",
            "cmp r10, r12",
            "beq 3f",
            "2:",
            three_stages!(),
            stage!("r5", "r8", "lr", "r4", "r9", "r3", "#12", "ldrd r4, r3, [r11, #-8]!"),
            "cmp r10, r12",
            "bne 2b",
            "3:",
            three_stages!(),
            "smlal r2, r8, r0, r5",
            "smlal r4, lr, r1, r5",
            "add r8, r8, r8, lsr #31",
            "add lr, lr, lr, lsr #31",
            "qadd r8, r8, r8",
            "qadd lr, lr, lr",
            "str lr, [r11, #4]",
            inout("r10") turns.as_ptr_range().end => _,
            inout("r11") ends.end.sub(1) => _,
            in("r12") turns[TURN_STAGES - 1..].as_ptr(),
            inout("r8") forward,
            out("r0") _,
            out("r1") _,
            out("r2") _,
            out("r3") _,
            out("r4") _,
            out("r5") _,
            out("r9") _,
            out("lr") _,
            options(nostack),
        );
    }
    forward
}
