//! Thumb instructions: their length, their text, and what a count needs to know of them.

use capstone::Capstone;
use capstone::arch::arm::{ArchExtraMode, ArchMode};
use capstone::arch::{BuildsCapstone, BuildsCapstoneExtraMode};

use crate::error::{Error, Result};

/// A decoded instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// The address after it in memory.
    pub end: u32,
    /// The disassembled text.
    pub text: String,
    /// True if it puts the address of the next instruction into the link register.
    pub is_call: bool,
    /// True if its time depends on the values of its operands.
    pub depends_on_data: bool,
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
            .build()?;
        Ok(Self(disassembler))
    }

    /// Decodes the first instruction of `code`, which lies at `address`.
    ///
    /// # Errors
    /// The bytes are no instruction.
    pub fn decode(&self, code: &[u8], address: u32) -> Result<Instruction> {
        let found = self.0.disasm_count(code, u64::from(address), 1)?;
        let found = found.first().ok_or(Error::NoCode(address))?;
        let (name, operands) = (found.mnemonic(), found.op_str());
        let (name, operands) = (name.unwrap_or_default(), operands.unwrap_or_default());
        Ok(Instruction {
            end: address + found.len() as u32,
            text: format!("{name} {operands}").trim_end().to_owned(),
            is_call: matches!(name, "bl" | "blx"),
            depends_on_data: name.starts_with("sdiv") || name.starts_with("udiv"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calls_and_divisions_are_told_from_all_else() {
        let decoder = Decoder::new().unwrap();
        for (code, text, is_call, depends_on_data) in [
            (&[0x00, 0xf0, 0x05, 0xf8][..], "bl #0x40e", true, false),
            (&[0x90, 0x47], "blx r2", true, false),
            (&[0xb0, 0xfb, 0xf1, 0xf0], "udiv r0, r0, r1", false, true),
            (&[0x70, 0x47, 0xff], "bx lr", false, false),
        ] {
            let found = decoder.decode(code, 0x400).unwrap();
            let end = 0x400 + (code.len() as u32 & !1);
            let expected = Instruction {
                end,
                text: text.to_owned(),
                is_call,
                depends_on_data,
            };
            assert_eq!(found, expected);
        }
        assert!(decoder.decode(&[0xff], 0x400).is_err());
    }
}
