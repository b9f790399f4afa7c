//! Thumb instructions, with all that their times depend on.
//!
//! Times are those of Arm's Cortex-M4 Technical Reference Manual (DDI 0439D), tables 3-1 and 3-2 for the processor and
//! table 7-1 for its floating-point unit. An instruction that is missing there or here is an error, because a guess
//! would pass for a measurement.

use capstone::arch::arm::{ArchExtraMode, ArchMode, ArmOperand, ArmOperandType, ArmReg, ArmShift};
use capstone::arch::{BuildsCapstone, BuildsCapstoneExtraMode, DetailsArchInsn};
use capstone::{Capstone, Insn, RegId};

use crate::error::{Error, Result};

/// A set of registers: r0 to r15 are bits 0 to 15, s0 to s31 bits 16 to 47.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Registers(u64);

impl Registers {
    /// The number of the register, if the set is exactly one register of the processor.
    fn number(self) -> Option<usize> {
        (self.0.is_power_of_two() && self.0 < 1 << Self::S0)
            .then(|| self.0.trailing_zeros() as usize)
    }

    const SP: u32 = 13;
    const LR: u32 = 14;
    const PC: u32 = 15;
    const S0: u32 = 16;

    fn of(register: RegId) -> Self {
        let number = u32::from(register.0);
        let one = |bit: u32| Self(1 << bit);
        match number {
            ArmReg::ARM_REG_SP => one(Self::SP),
            ArmReg::ARM_REG_LR => one(Self::LR),
            ArmReg::ARM_REG_PC => one(Self::PC),
            ArmReg::ARM_REG_R0..=ArmReg::ARM_REG_R12 => one(number - ArmReg::ARM_REG_R0),
            ArmReg::ARM_REG_S0..=ArmReg::ARM_REG_S31 => one(Self::S0 + number - ArmReg::ARM_REG_S0),
            // A double register is two single ones.
            ArmReg::ARM_REG_D0..=ArmReg::ARM_REG_D15 => {
                Self(0b11 << (Self::S0 + 2 * (number - ArmReg::ARM_REG_D0)))
            }
            // Flags are no register here.
            _ => Self::default(),
        }
    }

    /// True if a register is in both sets.
    pub fn meets(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    fn add(&mut self, other: Self) {
        self.0 |= other.0;
    }

    fn words(self) -> u32 {
        self.0.count_ones()
    }
}

/// The kind of an instruction's time, apart from the effects of its neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// A constant number of cycles.
    Cycles(u32),
    /// SDIV and UDIV: 2 to 12 cycles, by the values of the operands.
    Divide,
    /// A load of one register, which adjacent loads and stores can overlap.
    Load,
    /// A load of the program counter, without overlap.
    LoadToPc,
    /// A store of one register to a register plus a number.
    StoreImmediate,
    /// A store of one register to the sum of two.
    StoreRegister,
    /// Loads or stores of so many words by one instruction, without overlap.
    Words(u32),
    /// IT, which can be folded onto a narrow instruction before it.
    IfThen,
    /// TBB and TBH.
    TableBranch,
}

/// The address and the size of a load or store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// The number of the base register.
    base: usize,
    /// The number of the added register, and its shift to the left, bits.
    index: Option<(usize, u32)>,
    /// The constant offset, bytes.
    offset: i32,
    /// The size: 1, 2 or 4 bytes.
    bytes: u32,
}

impl Access {
    /// The address, from r0 to r15 at the begin of the instruction.
    pub fn address(&self, registers: &[u32; 16]) -> u32 {
        let index = self
            .index
            .map_or(0, |(number, shift)| registers[number] << shift);
        registers[self.base]
            .wrapping_add(index)
            .wrapping_add_signed(self.offset)
    }

    /// The number of additional accesses at `address`. A halfword at an odd address takes two bytes. A word takes two
    /// halfwords at an even address that is no multiple of four, and byte, halfword and byte at an odd one (section
    /// 3.3.2).
    pub fn extra_accesses(&self, address: u32) -> u32 {
        match (self.bytes, address % self.bytes) {
            (_, 0) => 0,
            (4, 1 | 3) => 2,
            _ => 1,
        }
    }
}

/// A decoded instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// The address.
    pub address: u32,
    /// The size: 2 or 4 bytes.
    pub size: u32,
    /// The disassembled text.
    pub text: String,
    /// The kind of its time.
    pub timing: Timing,
    /// The registers that make its memory address.
    pub address_registers: Registers,
    /// The access, if it is of one register of the processor at an address that need not be aligned.
    pub access: Option<Access>,
    /// The registers that it loads from memory.
    pub loaded: Registers,
    /// The registers that it computes.
    pub computed: Registers,
    /// The registers that it reads other than for an address.
    pub read: Registers,
    /// True for floating-point arithmetic, whose result is late for the next instruction.
    pub is_late: bool,
    /// True if it puts the address of the next instruction into the link register.
    pub is_call: bool,
}

impl Instruction {
    /// The address after it in memory.
    pub fn end(&self) -> u32 {
        self.address + self.size
    }

    /// True for a load of a constant from beside the code.
    pub fn is_literal(&self) -> bool {
        self.timing == Timing::Load && self.address_registers == Registers(1 << Registers::PC)
    }

    /// True if its time depends on the values of its operands.
    pub fn depends_on_data(&self) -> bool {
        self.timing == Timing::Divide
    }
}

/// A decoder of instructions.
pub struct Decoder(Capstone);

impl Decoder {
    /// A decoder for Thumb code of the M profile.
    ///
    /// # Errors
    /// The disassembler does not start.
    pub fn new() -> Result<Self> {
        let disassembler = Capstone::new()
            .arm()
            .mode(ArchMode::Thumb)
            .extra_mode([ArchExtraMode::MClass, ArchExtraMode::V8].into_iter())
            .detail(true)
            .build()?;
        Ok(Self(disassembler))
    }

    /// Decodes the first instruction of `code`, which lies at `address`.
    ///
    /// # Errors
    /// The bytes are no instruction, or its time is not known.
    pub fn decode(&self, code: &[u8], address: u32) -> Result<Instruction> {
        let found = self.0.disasm_count(code, u64::from(address), 1)?;
        let Some(found) = found.first() else {
            return Err(Error::Unknown {
                address,
                text: format!("{code:02x?}"),
            });
        };
        let detail = self.0.insn_detail(found)?;
        let detail = detail.arch_detail();
        let operands: Vec<ArmOperand> = detail
            .arm()
            .map_or_else(Vec::new, |arm| arm.operands().collect());
        let text = text(found);
        let name = self.0.insn_name(found.id()).unwrap_or_default();
        let kind =
            Kind::of(&name, found.mnemonic().unwrap_or_default(), &operands).ok_or_else(|| {
                Error::Unknown {
                    address,
                    text: text.clone(),
                }
            })?;
        Ok(instruction(kind, &name, &operands, found, text))
    }
}

/// The operation of an instruction, as far as its time depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Computes in a constant number of cycles.
    Compute(u32),
    /// Floating-point arithmetic in a constant number of cycles.
    Float(u32),
    Divide,
    /// Loads one register in at most two cycles.
    Load,
    /// Stores one register.
    Store,
    /// Loads one floating-point register.
    FloatLoad,
    /// Stores one floating-point register.
    FloatStore,
    /// Loads the first two operands, or stores them.
    LoadPair,
    StorePair,
    /// Loads or stores a list of registers after a base, or at the stack pointer.
    LoadList,
    StoreList,
    Pop,
    Push,
    IfThen,
    Branch,
    Call,
    TableBranch,
}

impl Kind {
    fn of(name: &str, mnemonic: &str, operands: &[ArmOperand]) -> Option<Self> {
        // The Cortex-M4's unit has no double precision.
        if mnemonic.contains(".f64") {
            return None;
        }
        Some(match name {
            // Table 3-1, and table 3-2 for the DSP instructions: all of these take one cycle.
            "adc" | "add" | "addw" | "adr" | "and" | "asr" | "bfc" | "bfi" | "bic" | "clz"
            | "cmn" | "cmp" | "eor" | "lsl" | "lsr" | "mla" | "mls" | "mov" | "movt" | "movw"
            | "mul" | "mvn" | "orn" | "orr" | "pkhbt" | "pkhtb" | "qadd" | "qadd16" | "qdadd"
            | "qdsub" | "qsub" | "qsub16" | "rbit" | "rev" | "rev16" | "revsh" | "ror" | "rrx"
            | "rsb" | "sadd16" | "sbc" | "sbfx" | "sel" | "smlabb" | "smlabt" | "smlatb"
            | "smlatt" | "smlad" | "smladx" | "smlal" | "smlalbb" | "smlalbt" | "smlaltb"
            | "smlaltt" | "smlald" | "smlaldx" | "smlawb" | "smlawt" | "smlsd" | "smlsdx"
            | "smlsld" | "smlsldx" | "smmla" | "smmlar" | "smmls" | "smmlsr" | "smmul"
            | "smmulr" | "smuad" | "smuadx" | "smulbb" | "smulbt" | "smultb" | "smultt"
            | "smull" | "smulwb" | "smulwt" | "smusd" | "smusdx" | "ssat" | "ssat16" | "ssub16"
            | "sub" | "subw" | "sxtab" | "sxtah" | "sxtb" | "sxtb16" | "sxth" | "teq" | "tst"
            | "uadd8" | "ubfx" | "umaal" | "umlal" | "umull" | "usat" | "usat16" | "usub8"
            | "uxtab" | "uxtah" | "uxtb" | "uxtb16" | "uxth"
            // Table 7-1. The disassembler calls VMRS of the flags `fmstat` and VMOV of a number `fconsts`.
            | "fconsts" | "fmstat" | "vmrs" | "vmsr" => Self::Compute(1),
            // Hints other than NOP may wait.
            "hint" if mnemonic == "nop" => Self::Compute(1),
            "sdiv" | "udiv" => Self::Divide,
            "ldr" | "ldrb" | "ldrh" | "ldrsb" | "ldrsh" => Self::Load,
            "str" | "strb" | "strh" => Self::Store,
            "ldrd" => Self::LoadPair,
            "strd" => Self::StorePair,
            "ldm" | "ldmdb" | "vldmia" | "vldmdb" => Self::LoadList,
            "stm" | "stmdb" | "vstmia" | "vstmdb" => Self::StoreList,
            "pop" | "vpop" => Self::Pop,
            "push" | "vpush" => Self::Push,
            "it" => Self::IfThen,
            "b" | "bx" | "cbz" | "cbnz" => Self::Branch,
            "bl" | "blx" => Self::Call,
            "tbb" | "tbh" => Self::TableBranch,
            // Table 7-1.
            "vabs" | "vadd" | "vcmp" | "vcmpe" | "vcvt" | "vcvtb" | "vcvtr" | "vcvtt" | "vmul"
            | "vneg" | "vnmul" | "vsub" => Self::Float(1),
            "vfma" | "vfms" | "vfnma" | "vfnms" | "vmla" | "vmls" | "vnmla" | "vnmls" => {
                Self::Float(3)
            }
            "vdiv" | "vsqrt" => Self::Float(14),
            // Two registers of the processor take one more cycle.
            "vmov" => Self::Compute(if operands.len() > 2 { 2 } else { 1 }),
            "vldr" => Self::FloatLoad,
            "vstr" => Self::FloatStore,
            _ => return None,
        })
    }
}

/// The number of first operands that are results, because the disassembler does not mark them in all instructions.
fn results(kind: Kind, name: &str) -> usize {
    match (kind, name) {
        (
            _,
            "cmn" | "cmp" | "teq" | "tst" | "vcmp" | "vcmpe" | "fmstat" | "vmrs" | "vmsr" | "hint",
        ) => 0,
        (
            Kind::Compute(_),
            "smlal" | "smlald" | "smlaldx" | "smlsld" | "smlsldx" | "smlalbb" | "smlalbt"
            | "smlaltb" | "smlaltt" | "smull" | "umaal" | "umlal" | "umull",
        ) => 2,
        (Kind::Compute(_) | Kind::Float(_) | Kind::Divide, _) => 1,
        _ => 0,
    }
}

/// True if the results are operands too.
fn accumulates(kind: Kind, name: &str) -> bool {
    kind == Kind::Float(3)
        || matches!(name, "bfi" | "movt" | "umaal" | "umlal")
        || name.starts_with("smlal")
        || name.starts_with("smlsld")
}

fn instruction(
    kind: Kind,
    name: &str,
    operands: &[ArmOperand],
    found: &Insn<'_>,
    text: String,
) -> Instruction {
    let register = |operand: &ArmOperand| match operand.op_type {
        ArmOperandType::Reg(register) => Some(Registers::of(register)),
        _ => None,
    };
    let union = |operands: &[ArmOperand]| {
        let mut all = Registers::default();
        operands
            .iter()
            .filter_map(register)
            .for_each(|one| all.add(one));
        all
    };
    let (mut address_registers, mut has_index) = (Registers::default(), false);
    for operand in operands {
        if let ArmOperandType::Mem(memory) = operand.op_type {
            address_registers.add(Registers::of(memory.base()));
            let index = Registers::of(memory.index());
            has_index |= index != Registers::default();
            address_registers.add(index);
        }
    }
    let stack = Registers(1 << Registers::SP);
    let first = union(operands.get(..1).unwrap_or_default());
    let after_first = union(operands.get(1..).unwrap_or_default());
    let mut loaded = Registers::default();
    let timing = match kind {
        Kind::Compute(cycles) | Kind::Float(cycles) => Timing::Cycles(cycles),
        Kind::Divide => Timing::Divide,
        Kind::Load => {
            loaded = first;
            if loaded.meets(Registers(1 << Registers::PC)) {
                Timing::LoadToPc
            } else {
                Timing::Load
            }
        }
        Kind::Store if has_index => Timing::StoreRegister,
        Kind::Store => Timing::StoreImmediate,
        // Table 7-1: 2 cycles for a single register, 3 for a double one.
        Kind::FloatLoad => {
            loaded = first;
            Timing::Words(first.words())
        }
        Kind::FloatStore => Timing::Words(first.words()),
        Kind::LoadPair => {
            loaded = union(operands.get(..2).unwrap_or_default());
            Timing::Words(2)
        }
        Kind::StorePair => Timing::Words(2),
        Kind::LoadList => {
            (address_registers, loaded) = (first, after_first);
            Timing::Words(loaded.words())
        }
        Kind::StoreList => {
            address_registers = first;
            Timing::Words(after_first.words())
        }
        Kind::Pop => {
            (address_registers, loaded) = (stack, union(operands));
            Timing::Words(loaded.words())
        }
        Kind::Push => {
            address_registers = stack;
            Timing::Words(union(operands).words())
        }
        Kind::IfThen => Timing::IfThen,
        Kind::Branch | Kind::Call => Timing::Cycles(1),
        Kind::TableBranch => Timing::TableBranch,
    };
    let results = results(kind, name);
    let computed = union(operands.get(..results).unwrap_or_default());
    // An accumulating instruction reads its result's register too.
    let unread = if accumulates(kind, name) { 0 } else { results };
    let mut read = Registers::default();
    for register in operands.iter().skip(unread).filter_map(register) {
        if !register.meets(loaded) {
            read.add(register);
        }
    }
    Instruction {
        address: found.address() as u32,
        size: found.len() as u32,
        access: access(kind, name, operands, &text),
        text,
        timing,
        address_registers,
        loaded,
        computed,
        read,
        is_late: matches!(kind, Kind::Float(_)),
        is_call: kind == Kind::Call,
    }
}

/// The access of a load or store of one register. Constants beside the code are left out, because they are aligned.
fn access(kind: Kind, name: &str, operands: &[ArmOperand], text: &str) -> Option<Access> {
    if !matches!(kind, Kind::Load | Kind::Store) {
        return None;
    }
    let (operand, memory) = operands.iter().find_map(|operand| match operand.op_type {
        ArmOperandType::Mem(memory) => Some((operand, memory)),
        _ => None,
    })?;
    let base = Registers::of(memory.base()).number()?;
    if base == Registers::PC as usize {
        return None;
    }
    let shift = match operand.shift {
        ArmShift::Lsl(bits) => bits,
        _ => 0,
    };
    // A post-index offset is no part of the address.
    let is_post_indexed = text.contains("],");
    Some(Access {
        base,
        index: Registers::of(memory.index())
            .number()
            .map(|number| (number, shift)),
        offset: if is_post_indexed { 0 } else { memory.disp() },
        bytes: match name {
            "ldrb" | "ldrsb" | "strb" => 1,
            "ldrh" | "ldrsh" | "strh" => 2,
            _ => 4,
        },
    })
}

fn text(found: &Insn<'_>) -> String {
    let (mnemonic, operands) = (found.mnemonic(), found.op_str());
    let text = format!(
        "{} {}",
        mnemonic.unwrap_or_default(),
        operands.unwrap_or_default()
    );
    text.trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(code: &[u8]) -> Instruction {
        Decoder::new().unwrap().decode(code, 0x100).unwrap()
    }

    #[test]
    fn an_instruction_that_the_manual_does_not_time_is_an_error_that_names_it() {
        let decoder = Decoder::new().unwrap();
        // vadd.f64 d0, d0, d1; svc #1; and a permanently undefined instruction.
        for (code, name) in [
            (&[0x30, 0xee, 0x01, 0x0b][..], "vadd.f64"),
            (&[0x01, 0xdf], "svc"),
            (&[0x00, 0xde], "udf"),
        ] {
            let error = decoder.decode(code, 0x2a0).unwrap_err().to_string();
            assert!(
                error.contains(name) && error.contains("0x000002a0"),
                "{error}"
            );
        }
        assert!(matches!(
            decoder.decode(&[0xff, 0xff], 0),
            Err(Error::Unknown { .. })
        ));
    }

    #[test]
    fn registers_of_addresses_loads_and_results_are_told_apart() {
        // ldr r0, [r1, r5]
        let load = decode(&[0x48, 0x59]);
        assert_eq!(load.text, "ldr r0, [r1, r5]");
        assert_eq!(
            (load.timing, load.address_registers.0, load.loaded.0),
            (Timing::Load, 0b10_0010, 1)
        );
        // smlal r0, r1, r2, r3 reads all and writes two.
        let multiply = decode(&[0xc2, 0xfb, 0x03, 0x01]);
        assert_eq!((multiply.computed.0, multiply.read.0), (0b11, 0b1111));
        // ldm r0, {r1, r2, r3}
        let list = decode(&[0x90, 0xe8, 0x0e, 0x00]);
        assert_eq!(
            (list.timing, list.address_registers.0, list.loaded.0),
            (Timing::Words(3), 1, 0b1110)
        );
        // pop {r4, pc} and push {r4, lr}
        for (code, loads) in [([0x10, 0xbd], 1 << 4 | 1 << 15), ([0x10, 0xb5], 0)] {
            let stack = decode(&code);
            assert_eq!(
                (stack.timing, stack.address_registers.0, stack.loaded.0),
                (Timing::Words(2), 1 << 13, loads)
            );
        }
        // vpush {d8, d9} is four words.
        assert_eq!(decode(&[0x2d, 0xed, 0x04, 0x8b]).timing, Timing::Words(4));
        // cmp r0, r1 computes no register.
        let compare = decode(&[0x88, 0x42]);
        assert_eq!((compare.computed.0, compare.read.0), (0, 0b11));
        assert!(decode(&[0x02, 0x48]).is_literal());
    }

    #[test]
    fn an_address_is_the_sum_of_what_the_instruction_names() {
        let registers: [u32; 16] = core::array::from_fn(|number| 0x100 * number as u32 + 1);
        let address = |code: &[u8]| decode(code).access.map(|access| access.address(&registers));
        // str r0, [r3, #20]; ldr r0, [r1, r5]; ldr r0, [r1, r5, lsl #2]
        assert_eq!(address(&[0x58, 0x61]), Some(0x301 + 20));
        assert_eq!(address(&[0x48, 0x59]), Some(0x101 + 0x501));
        assert_eq!(address(&[0x51, 0xf8, 0x25, 0x00]), Some(0x101 + 4 * 0x501));
        // ldr r0, [r1], #4; ldr r0, [r1, #4]!; ldr r0, [r1, #-4]
        assert_eq!(address(&[0x51, 0xf8, 0x04, 0x0b]), Some(0x101));
        assert_eq!(address(&[0x51, 0xf8, 0x04, 0x0f]), Some(0x105));
        assert_eq!(address(&[0x51, 0xf8, 0x04, 0x0c]), Some(0xfd));
        // ldr r0, [pc, #8]; ldm r0, {r1, r2, r3}
        assert_eq!(address(&[0x02, 0x48]), None);
        assert_eq!(address(&[0x90, 0xe8, 0x0e, 0x00]), None);
    }

    #[test]
    fn what_is_not_aligned_takes_the_accesses_that_the_manual_says() {
        let extra = |code: &[u8]| {
            let access = decode(code).access.expect("it accesses memory");
            [0, 1, 2, 3].map(|address| access.extra_accesses(address))
        };
        // ldr r0, [r1]; ldrh r0, [r1]; ldrb r0, [r1]
        assert_eq!(extra(&[0x08, 0x68]), [0, 2, 1, 2]);
        assert_eq!(extra(&[0x08, 0x88]), [0, 1, 0, 1]);
        assert_eq!(extra(&[0x08, 0x78]), [0, 0, 0, 0]);
    }
}
