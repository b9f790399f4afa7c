//! Two samples of a lattice in one pass, for every Cortex-M with the DSP instructions.

use core::arch::asm;

use stylus_kernel::arithmetic::rotated;
use stylus_kernel::rotation::Rotation;

/// Stages per turn of the loop, whose backward signals are loaded two at a time.
const TURN_STAGES: usize = 4;

/// One stage of a sample with forward signal `$forward`; `$up` is the backward signal that it passes on.
macro_rules! stage {
    ($cos:literal, $sin:literal, $neg_sin:literal, $forward:literal, $backward:literal, $up:literal) => {
        concat!(
            "smull r6, ",
            $up,
            ", ",
            $sin,
            ", ",
            $forward,
            "\n",
            "smlal r6, ",
            $up,
            ", ",
            $cos,
            ", ",
            $backward,
            "\n",
            "smull r6, ",
            $forward,
            ", ",
            $cos,
            ", ",
            $forward,
            "\n",
            "smlal r6, ",
            $forward,
            ", ",
            $neg_sin,
            ", ",
            $backward,
            "\n",
            "add ",
            $up,
            ", ",
            $up,
            ", ",
            $up,
            ", lsr #31\n",
            "add ",
            $forward,
            ", ",
            $forward,
            ", ",
            $forward,
            ", lsr #31\n",
            "qadd ",
            $up,
            ", ",
            $up,
            ", ",
            $up,
            "\n",
            "qadd ",
            $forward,
            ", ",
            $forward,
            ", ",
            $forward,
            "\n",
        )
    };
}

/// Two stages of two samples: the first sample's forward signal is `r8`, the second's, a stage behind, `r9`. The
/// rotations of the stage above are in `r3` to `r5`, as those of the lower stage are at the end. The backward signal of
/// the first sample goes to the second in `r7` and not through memory.
macro_rules! two_stages_of_two {
    () => {
        concat!(
            "ldrd r12, lr, [r11, #-8]!\n",
            "ldmdb r10!, {{r0, r1, r2}}\n",
            stage!("r0", "r1", "r2", "r8", "lr", "r7"),
            stage!("r3", "r4", "r5", "r9", "r7", "lr"),
            "str lr, [r11, #12]\n",
            "ldmdb r10!, {{r3, r4, r5}}\n",
            stage!("r3", "r4", "r5", "r8", "r12", "r7"),
            stage!("r0", "r1", "r2", "r9", "r7", "r12"),
            "str r12, [r11, #8]\n",
        )
    };
}

/// Both samples in 9 3/4 instructions per stage and sample. On a Cortex-M4 without wait states these are
/// 11 5/8 cycles.
#[inline]
pub fn rotate_two(
    rotations: &[Rotation],
    backward: &mut [i32],
    [mut first, mut second]: [i32; 2],
) -> [i32; 2] {
    let Some((&last, others)) = rotations.split_last() else {
        return [first, second];
    };
    // The last stage of the first sample, and the stages beyond whole turns.
    let mut up;
    (first, up) = rotated(last, first, backward[others.len()]);
    backward[rotations.len()] = up;
    let stages = others.len() - others.len() % TURN_STAGES;
    for stage in (stages..others.len()).rev() {
        (first, up) = rotated(rotations[stage], first, backward[stage]);
        (second, up) = rotated(rotations[stage + 1], second, up);
        backward[stage + 2] = up;
    }
    if stages > 0 {
        let ends = rotations[..stages].as_ptr_range();
        let signals = backward[..stages + 2].as_mut_ptr_range();
        // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads rotation n, which exists because
        // `rotations` holds one more than `others`, and then n - 1 to 0, three words each (`Rotation` is `repr(C)`
        // of three). It reads words n - 1 to 0 of `backward` and writes words n + 1 to 2, all of the slice of n + 2
        // words, whose end minus two is word n. All words are aligned, as LDRD and LDM require. It pushes three
        // words and pops them (so `nostack` is not claimed). These hold r6 and r7 among others, which the compiler
        // may reserve and which are restored; no operand is in either. All other registers are named; Q and the
        // flags are declared as changed.
        #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
        unsafe {
            asm!(
                "push {{r6, r7, lr}}",
                "ldm r10, {{r3, r4, r5}}",
                "2:",
                two_stages_of_two!(),
                two_stages_of_two!(),
                "ldr r7, [sp, #8]",
                "cmp r10, r7",
                "bne 2b",
                "pop {{r6, r7, lr}}",
                inout("r8") first,
                inout("r9") second,
                inout("r10") ends.end => _,
                inout("r11") signals.end.sub(2) => _,
                inout("lr") ends.start => _,
                out("r0") _,
                out("r1") _,
                out("r2") _,
                out("r3") _,
                out("r4") _,
                out("r5") _,
                out("r12") _,
            );
        }
    }
    (second, up) = rotated(rotations[0], second, first);
    backward[1] = up;
    [first, second]
}
