//! Cycles of a Cortex-M4, by Arm's Technical Reference Manual (DDI 0439D): tables 3-1, 3-2 and 7-1, and section 3.3.2
//! on adjacent loads and stores.
//!
//! The *best* case takes every saving that the manual allows: loads overlap where they can, IT is folded onto the
//! narrow instruction before it, and a branch refills the pipeline in one cycle. The *worst* case takes no saving, and
//! three cycles for every taken branch. Both leave out wait states, contention for the bus, interrupts, and the shorter
//! time (one cycle) of an instruction that is skipped within an IT block. They also leave out the cost of wide
//! instructions that are not aligned, of which the manual says only that it is part of P. A division takes 2 to 12
//! cycles by its operands: 2 at best, 12 at worst. Unaligned data is counted apart, because its cost depends on the
//! addresses: [`crate::count::Alignment`].

use std::ops::AddAssign;

use crate::thumb::{Instruction, Timing};

/// Cycles in the best and the worst case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cycles {
    /// The best case: with all overlaps.
    pub best: u32,
    /// The worst case: without overlaps.
    pub worst: u32,
}

impl AddAssign for Cycles {
    fn add_assign(&mut self, other: Self) {
        self.best += other.best;
        self.worst += other.worst;
    }
}

/// P, the cycles of a pipeline refill: 1 to 3, "depending on the alignment and width of the target instruction, and
/// whether the processor manages to speculate the address early".
const REFILL: Cycles = Cycles { best: 1, worst: 3 };

/// The refill after a load of the program counter or a table branch: "three cycles for the pipeline reload".
const FULL_REFILL: Cycles = Cycles { best: 3, worst: 3 };

/// The cycles of `this` after `before`. `next` is the address of the instruction that was executed after it.
pub fn cycles(before: Option<&Instruction>, this: &Instruction, next: u32) -> Cycles {
    let both = |cycles| Cycles {
        best: cycles,
        worst: cycles,
    };
    let overlapped = u32::from(before.is_some_and(|before| overlaps(before, this)));
    let mut cycles = match this.timing {
        Timing::Cycles(cycles) => both(cycles),
        Timing::Divide => Cycles { best: 2, worst: 12 },
        // "One cycle is removed from the cost of the next instruction."
        Timing::Load | Timing::StoreRegister => Cycles {
            best: 2 - overlapped,
            worst: 2,
        },
        Timing::LoadToPc => both(2),
        // "STR Rx,[Ry,#imm] is always one cycle."
        Timing::StoreImmediate => both(1),
        Timing::Words(words) => both(1 + words),
        // "Folded onto a preceding 16-bit Thumb instruction."
        Timing::IfThen => Cycles {
            best: u32::from(before.is_none_or(|before| before.size > 2)),
            worst: 1,
        },
        // "At least two cycles for the load, one cycle for the add."
        Timing::TableBranch => both(3),
    };
    if next != this.end() {
        cycles += match this.timing {
            Timing::LoadToPc | Timing::TableBranch => FULL_REFILL,
            _ => REFILL,
        };
    }
    if let Some(before) = before {
        // "Any load or store that generates an address dependent on the result of a preceding data processing operation
        // stalls the pipeline for an additional cycle."
        if before.computed.meets(this.address_registers) {
            cycles += both(1);
        }
        // Section 7.2.3: floating-point arithmetic takes "one cycle longer if their result is consumed by the following
        // instruction".
        if before.is_late && before.computed.meets(this.read) {
            cycles += both(1);
        }
    }
    // "LDR Rx,[PC,#imm] might add a cycle because of contention with the fetch unit."
    if this.is_literal() {
        cycles.worst += 1;
    }
    cycles
}

/// The condition for an overlap of two accesses: "If the next instruction is an LDR or STR, and the destination of the
/// first LDR is not used to compute the address for the next instruction."
fn overlaps(before: &Instruction, this: &Instruction) -> bool {
    before.timing == Timing::Load && !before.loaded.meets(this.address_registers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::thumb::Decoder;

    /// Cycles of successive instructions, as (best, worst).
    fn take(code: &[&[u8]]) -> (u32, u32) {
        let decoder = Decoder::new().unwrap();
        let (mut sum, mut before, mut address) = (Cycles::default(), None, 0x100);
        for bytes in code {
            let this = decoder.decode(bytes, address).unwrap();
            address = this.end();
            sum += cycles(before.as_ref(), &this, address);
            before = Some(this);
        }
        (sum.best, sum.worst)
    }

    /// Cycles of one instruction that branches, as (best, worst).
    fn branch(code: &[u8]) -> (u32, u32) {
        let this = Decoder::new().unwrap().decode(code, 0x100).unwrap();
        let taken = cycles(None, &this, 0x80);
        (taken.best, taken.worst)
    }

    const LDR_R0_R1: &[u8] = &[0x08, 0x68];
    const LDR_R1_R2: &[u8] = &[0x11, 0x68];
    const LDR_R0_R1_R2: &[u8] = &[0x88, 0x58];
    const STR_R0_R3_20: &[u8] = &[0x58, 0x61];
    const STR_R1_R3_R2: &[u8] = &[0x99, 0x50];
    const LDR_R0_R1_R5: &[u8] = &[0x48, 0x59];
    const LDR_R2_R3_4: &[u8] = &[0x5a, 0x68];
    const ADD_R1_R2_R3: &[u8] = &[0x02, 0xeb, 0x03, 0x01];

    #[test]
    fn the_manuals_examples_of_loads_and_stores_take_what_it_says() {
        // Each "normally" takes so many cycles: the best case, because nothing stalls.
        assert_eq!(take(&[LDR_R0_R1, LDR_R1_R2]).0, 3);
        assert_eq!(take(&[LDR_R0_R1_R2, STR_R0_R3_20]).0, 3);
        assert_eq!(take(&[LDR_R0_R1_R2, STR_R1_R3_R2]).0, 3);
        assert_eq!(take(&[LDR_R0_R1_R5, LDR_R1_R2, LDR_R2_R3_4]).0, 4);
        // "A three element LDM takes 2+1+1"; "an eight element store takes nine cycles".
        assert_eq!(take(&[&[0x90, 0xe8, 0x0e, 0x00]]), (4, 4));
        assert_eq!(take(&[&[0x88, 0xe8, 0xff, 0x00]]), (9, 9));
        // LDRD: "this operation requires three cycles when not stalled".
        assert_eq!(take(&[&[0xd2, 0xe9, 0x00, 0x01]]), (3, 3));
        // "STR Rx,[Ry,#imm] is always one cycle."
        assert_eq!(take(&[&[0xc1, 0xf8, 0x04, 0x00]]), (1, 1));
    }

    #[test]
    fn the_manuals_blocking_loads_take_at_least_what_it_says() {
        // LDR PC: "at least five cycles"; TBB: "at least six cycles".
        assert_eq!(branch(&[0xd0, 0xf8, 0x00, 0xf0]), (5, 5));
        assert_eq!(branch(&[0xdf, 0xe8, 0x00, 0xf0]), (6, 6));
    }

    #[test]
    fn without_overlap_every_load_takes_what_the_table_says() {
        assert_eq!(take(&[LDR_R0_R1, LDR_R1_R2]).1, 4);
        assert_eq!(take(&[LDR_R0_R1_R2, STR_R1_R3_R2]).1, 4);
        assert_eq!(take(&[LDR_R0_R1_R5, LDR_R1_R2, LDR_R2_R3_4]).1, 6);
    }

    #[test]
    fn an_address_that_was_only_just_loaded_or_computed_costs_a_cycle() {
        // ldr r1, [r2]; ldr r0, [r1]: no overlap.
        assert_eq!(take(&[LDR_R1_R2, LDR_R0_R1]), (4, 4));
        // add r1, r2, r3; ldr r0, [r1]: no forwarding path.
        assert_eq!(take(&[ADD_R1_R2_R3, LDR_R0_R1]), (4, 4));
        // With an instruction between them there is no stall.
        assert_eq!(take(&[ADD_R1_R2_R3, &[0x00, 0xbf], LDR_R0_R1]), (4, 4));
    }

    #[test]
    fn nothing_overlaps_a_store_or_a_pair() {
        assert_eq!(take(&[STR_R0_R3_20, LDR_R1_R2]).0, 3);
        assert_eq!(take(&[LDR_R0_R1, &[0xd2, 0xe9, 0x00, 0x01]]).0, 5);
        assert_eq!(take(&[&[0xd2, 0xe9, 0x00, 0x01], LDR_R0_R1_R5]).0, 5);
    }

    #[test]
    fn branches_take_one_cycle_and_a_refill_if_taken() {
        const BNE: &[u8] = &[0xfe, 0xd1];
        assert_eq!(take(&[BNE]), (1, 1));
        assert_eq!(branch(BNE), (2, 4));
        // bx lr; pop {r4, pc} is 1 + N + P.
        assert_eq!(branch(&[0x70, 0x47]), (2, 4));
        assert_eq!(branch(&[0x10, 0xbd]), (4, 6));
    }

    /// A loop of `subs r0, #4; bhi` takes four cycles per turn, by the timer of an STM32F103, whose Cortex-M3 has the
    /// same pipeline and the same times of both instructions (blaatschaap.be, "Wait a microsecond", 2023).
    #[test]
    fn a_loop_that_was_measured_lies_between_best_and_worst() {
        const MEASURED: u32 = 4;
        let (best, worst) = branch(&[0xfd, 0xd8]);
        let (subtraction, _) = take(&[&[0x04, 0x38]]);
        assert_eq!(
            (best + subtraction, worst + subtraction),
            (MEASURED - 1, MEASURED + 1)
        );
    }

    #[test]
    fn multiplications_take_one_cycle_and_divisions_depend_on_the_data() {
        // smlal r0, r1, r2, r3; mul r0, r1, r0; sdiv r0, r1, r2
        assert_eq!(take(&[&[0xc2, 0xfb, 0x03, 0x01]]), (1, 1));
        assert_eq!(take(&[&[0x01, 0xfb, 0x00, 0xf0]]), (1, 1));
        assert_eq!(take(&[&[0x91, 0xfb, 0xf2, 0xf0]]), (2, 12));
    }

    #[test]
    fn the_floating_point_unit_takes_what_table_7_1_says() {
        const VADD_S0_S0_S1: &[u8] = &[0x30, 0xee, 0x20, 0x0a];
        const VFMA_S0_S1_S2: &[u8] = &[0xa0, 0xee, 0x81, 0x0a];
        const VDIV_S0_S1_S2: &[u8] = &[0x80, 0xee, 0x81, 0x0a];
        assert_eq!(take(&[VADD_S0_S0_S1]), (1, 1));
        assert_eq!(take(&[VFMA_S0_S1_S2]), (3, 3));
        assert_eq!(take(&[VDIV_S0_S1_S2]), (14, 14));
        // A result is one cycle late for the next instruction: vadd s0, s0, s1 twice, and vmov r0, s0 after it.
        assert_eq!(take(&[VADD_S0_S0_S1, VADD_S0_S0_S1]), (3, 3));
        assert_eq!(take(&[VADD_S0_S0_S1, &[0x10, 0xee, 0x10, 0x0a]]), (3, 3));
        // vldr s0, [r0]; vldr d0, [r0]; vmov r0, r1, d0; vpush {d8, d9}
        assert_eq!(take(&[&[0x90, 0xed, 0x00, 0x0a]]), (2, 2));
        assert_eq!(take(&[&[0x90, 0xed, 0x00, 0x0b]]), (3, 3));
        assert_eq!(take(&[&[0x51, 0xec, 0x10, 0x0b]]), (2, 2));
        assert_eq!(take(&[&[0x2d, 0xed, 0x04, 0x8b]]), (5, 5));
    }

    #[test]
    fn a_narrow_instruction_takes_if_then_along_and_a_literal_may_wait() {
        const IT_NE: &[u8] = &[0x18, 0xbf];
        assert_eq!(take(&[&[0x88, 0x42], IT_NE]), (1, 2));
        assert_eq!(take(&[ADD_R1_R2_R3, IT_NE]), (2, 2));
        assert_eq!(take(&[&[0x02, 0x48]]), (2, 3));
    }
}
