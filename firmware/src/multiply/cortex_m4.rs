//! The lattice's stages in an order for a Cortex-M4.
//!
//! Cycles are those of ARM DDI 0439D, table 3-1: one per word that is loaded, and one per instruction that loads. Three
//! rotations are nine words, which fit into the registers at once.

use core::arch::asm;

use stylus_kernel::rotation::Rotation;

/// Stages that are loaded together.
const GROUP_STAGES: usize = 3;

/// Groups per turn of the long loop.
const TURN_GROUPS: usize = 12;

/// One stage of the forward signal `r12`, with the rotation and backward signal in these registers. `lr` is the
/// backward signal that it stores.
macro_rules! stage {
    ($cos:literal, $sin:literal, $neg_sin:literal, $backward:literal, $store:literal) => {
        concat!(
            "smull ",
            $sin,
            ", lr, ",
            $sin,
            ", r12\n",
            "smlal ",
            $sin,
            ", lr, ",
            $cos,
            ", ",
            $backward,
            "\n",
            "smull ",
            $sin,
            ", r12, ",
            $cos,
            ", r12\n",
            "smlal ",
            $sin,
            ", r12, ",
            $neg_sin,
            ", ",
            $backward,
            "\n",
            "add lr, lr, lr, lsr #31\n",
            "add r12, r12, r12, lsr #31\n",
            "qadd lr, lr, lr\n",
            "qadd r12, r12, r12\n",
            "str lr, [r11, ",
            $store,
            "]\n",
        )
    };
}

/// Three stages in 29 instructions. `r0` has the backward signal of the first one. The other two signals, and that of
/// the stage after them, are loaded when the first rotation has left its registers.
macro_rules! group {
    () => {
        concat!(
            "ldmdb r10!, {{r1, r2, r3, r4, r5, r6, r7, r8, r9}}\n",
            stage!("r7", "r8", "r9", "r0", "#4"),
            "ldmdb r11!, {{r0, r7, r8}}\n",
            stage!("r4", "r5", "r6", "r8", "#12"),
            stage!("r1", "r2", "r3", "r7", "#8"),
        )
    };
}

/// One stage by itself, with its backward signal in `r0`.
macro_rules! single {
    () => {
        concat!(
            "ldmdb r10!, {{r1, r2, r3}}\n",
            stage!("r1", "r2", "r3", "r0", "#4"),
        )
    };
}

/// One sample through the stages in 9 3/4 instructions per stage. On a Cortex-M4 without wait states these are 13 7/8
/// cycles.
#[inline(always)]
pub fn rotate(rotations: &[Rotation], backward: &mut [i32], mut forward: i32) -> i32 {
    let Some(others) = rotations.len().checked_sub(1) else {
        return forward;
    };
    let backward = &mut backward[..=rotations.len()];
    // The first stage, which comes last, is apart, because a group loads a backward signal for the stage after it.
    let groups = others / GROUP_STAGES;
    let stages = 1 + groups * GROUP_STAGES;
    let turns = 1 + (groups - groups % TURN_GROUPS) * GROUP_STAGES;
    // SAFETY: with n the number of `rotations`, at least one, the code reads rotations n - 1 to 0, three words each
    // (`Rotation` is `repr(C)` of three), reads words n - 1 to 0 of `backward`, and writes words n to 1. It begins at
    // the end of `rotations` and at word n, the last of the slice of n + 1 words, with one load of word n - 1. A stage
    // by itself then reads the word below the one that was read last, and a group the three below it; there are enough,
    // because one stage remains after them. The first loop runs until whole groups and that stage are left, the second
    // until whole turns and the stage, the third until the stage; each runs only if it has something to do. All words
    // are aligned, as LDM requires. It pushes five words and pops them (so `nostack` is not claimed). These hold r6 and
    // r7 among others, which the compiler may reserve and which are restored; no operand is in either. All other
    // registers are named; Q and the flags are declared as changed.
    #[expect(unsafe_code, reason = "the compiler's loop is a quarter longer")]
    unsafe {
        asm!(
            "push {{r6, r7, r8, r9, lr}}",
            "ldr r0, [r11, #-4]!",
            "cmp r10, lr",
            "beq 7f",
            "6:",
            single!(),
            "ldr r0, [r11, #-4]!",
            "ldr lr, [sp, #16]",
            "cmp r10, lr",
            "bne 6b",
            "7:",
            "cmp r10, r8",
            "beq 3f",
            "2:",
            group!(),
            "ldr lr, [sp, #8]",
            "cmp r10, lr",
            "bne 2b",
            "3:",
            "ldr lr, [sp, #12]",
            "cmp r10, lr",
            "beq 5f",
            "4:",
            group!(), group!(), group!(), group!(), group!(), group!(),
            group!(), group!(), group!(), group!(), group!(), group!(),
            "ldr lr, [sp, #12]",
            "cmp r10, lr",
            "bne 4b",
            "5:",
            single!(),
            "pop {{r6, r7, r8, r9, lr}}",
            inout("r10") rotations.as_ptr_range().end => _,
            inout("r11") backward.as_mut_ptr_range().end.sub(1) => _,
            inout("lr") rotations[..stages].as_ptr_range().end => _,
            inout("r8") rotations[..turns].as_ptr_range().end => _,
            inout("r9") rotations[..1].as_ptr_range().end => _,
            inout("r12") forward,
            out("r0") _,
            out("r1") _,
            out("r2") _,
            out("r3") _,
            out("r4") _,
            out("r5") _,
        );
    }
    forward
}

const _: () = assert!(GROUP_STAGES == 3 && TURN_GROUPS == 12);
