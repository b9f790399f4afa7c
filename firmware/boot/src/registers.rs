//! Registers of a flash bank: erasing and programming step by step (RM0433 section 4.3). The callers wait for the end
//! of an operation.
#![expect(unsafe_code, reason = "a store to flash programs it")]

use stm32_metapac::FLASH;
use stm32_metapac::flash::Bank as Registers;
use stm32_metapac::flash::regs::Sr;

use crate::map::{self, BANK_BYTES, SECTOR_BYTES, WORD_BYTES};

/// A bank, with its registers.
#[derive(Clone, Copy)]
pub struct Bank {
    /// Number of the bank, from 0.
    pub index: usize,
    /// Address of the bank.
    pub address: u32,
}

/// The bank with the code.
pub const BANK_1: Bank = Bank {
    index: 0,
    address: map::FLASH,
};

/// The bank with the slots.
pub const BANK_2: Bank = Bank {
    index: 1,
    address: map::FLASH + BANK_BYTES as u32,
};

impl Bank {
    #[inline(always)]
    fn registers(self) -> Registers {
        FLASH.bank(self.index)
    }

    /// Returns true while an operation is under way or waits.
    #[inline(always)]
    pub fn is_busy(self) -> bool {
        self.registers().sr().read().qw()
    }

    /// Clears old faults and unlocks the bank (RM0433 sections 4.3.9 and 4.3.10).
    pub fn unlock(self) {
        let registers = self.registers();
        clear(registers);
        if registers.cr().read().lock() {
            registers.keyr().write_value(0x4567_0123);
            registers.keyr().write_value(0xCDEF_89AB);
        }
    }

    /// Begins to erase the sector at `offset`.
    #[inline(always)]
    pub fn begin_erase(self, offset: u32) {
        self.registers().cr().modify(|w| {
            w.set_pg(false);
            w.set_ser(true);
            w.set_snb((offset as usize / SECTOR_BYTES) as u8);
        });
        // By a write of its own, after the sector's number is set (RM0433 section 4.3.10).
        self.registers().cr().modify(|w| w.set_start(true));
    }

    /// Writes `word` at `offset`, which is erased. The bank programs the word when all of it has arrived. For bank 1
    /// the image inlines this into ITCM.
    #[inline(always)]
    pub fn begin_program(self, offset: u32, word: &[u32; WORD_BYTES / 4]) {
        self.registers().cr().modify(|w| {
            w.set_ser(false);
            w.set_pg(true);
        });
        // PG must be set before the first store arrives, because a store without it is a fault (PGSERR).
        cortex_m::asm::dsb();
        let start = (self.address + offset) as *mut u32;
        for (index, &part) in word.iter().enumerate() {
            // SAFETY: the callers have checked that the word is in their range. Nothing holds a reference to it,
            // because references are shared borrows and programming borrows the flash exclusively.
            unsafe { start.add(index).write_volatile(part) };
        }
        cortex_m::asm::dsb();
    }

    /// Locks the bank and returns the status with which the operation has ended.
    pub fn end(self) -> Result<Sr, Sr> {
        let registers = self.registers();
        let status = registers.sr().read();
        clear(registers);
        registers.cr().modify(|w| {
            w.set_pg(false);
            w.set_ser(false);
            w.set_lock(true);
        });
        if is_fault(status) {
            return Err(status);
        }
        Ok(status)
    }
}

/// Clears the end-of-operation flag and every fault.
fn clear(registers: Registers) {
    registers.ccr().write(|w| {
        w.set_clr_eop(true);
        w.set_clr_wrperr(true);
        w.set_clr_pgserr(true);
        w.set_clr_strberr(true);
        w.set_clr_incerr(true);
        w.set_clr_operr(true);
        w.set_clr_rdperr(true);
        w.set_clr_rdserr(true);
        w.set_clr_sneccerr(true);
        w.set_clr_dbeccerr(true);
    });
}

/// Returns true if `status` shows a fault. Refused reads (RDPERR and RDSERR) do not count as faults: users of revision
/// V see them at 400 MHz with two wait states although nothing is protected. If an operation was refused as well, the
/// image's error contains them.
fn is_fault(status: Sr) -> bool {
    status.wrperr() | status.pgserr() | status.strberr() | status.incerr() | status.operr()
}

/// Splits `bytes` into flash words, as they are programmed.
pub fn words(bytes: &[u8]) -> impl Iterator<Item = [u32; WORD_BYTES / 4]> {
    bytes.as_chunks::<WORD_BYTES>().0.iter().map(|word| {
        let mut parts = word.as_chunks::<4>().0.iter();
        core::array::from_fn(|_| parts.next().map_or(0, |part| u32::from_le_bytes(*part)))
    })
}
