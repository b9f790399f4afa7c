//! The check that no code or data in flash is reachable from the handlers of tick, update and supply, or from the waits
//! for flash bank 1.
//!
//! The image keeps its relocations (`--emit-relocs`), i.e. every address that the linker filled in. Starting at the
//! handlers of the tick, the update and a falling supply, and at the two routines that wait while the bank with the
//! code is busy, the check follows each of them. A call must lead to ITCM, and data must be in DTCM. There are two
//! exceptions:
//!
//! - a panic, because it ends in mid-scale and a reset: calls of it, with the addresses of its message and of its
//!   source location;
//! - constants that only the update reads, such as a table of core's square root. The update computes only while
//!   something is played. The code's bank of the flash is busy only while settings are written, and that is refused
//!   during playing.

use std::collections::{BTreeMap, BTreeSet};

use object::read::elf::ElfFile32;
use object::{Endianness, Object, ObjectSection, ObjectSymbol, RelocationFlags, RelocationTarget, SymbolKind, elf};

use anyhow::{Context, Result, bail};

/// The handler in which the tick begins.
const TICK: &str = "TIM6_DAC";

/// The handler in which the update begins.
const UPDATE: &str = "SWPMI1";

/// The handler of a falling supply, which a busy bank must not delay.
const SUPPLY: &str = "PVD_AVD";

/// The routines that erase and program the bank that contains the code. Fetches of code from this bank stall meanwhile.
const OF_CODE_BANK: [&str; 2] = ["erase_without_code", "program_without_code"];

/// Calls that never return. Only parts of their names are given, because the compiler mangles names in two ways.
const PANICS: [&str; 5] = [
    "9panicking",
    "16slice_index_fail",
    "13expect_failed",
    "13unwrap_failed",
    "17rust_begin_unwind",
];

/// Largest distance in the code between loading the address of a panic's message and the call of the panic, bytes. It
/// covers some loads of constants.
const PANIC_ARGUMENTS_BYTES: u64 = 40;

/// A reference in the code in ITCM.
#[derive(Clone, Debug)]
struct Reference {
    /// Address of the instruction.
    at: u64,
    is_call: bool,
    /// Name and address of the symbol that is referred to.
    name: String,
    address: u64,
}

/// A function in ITCM.
#[derive(Clone, Debug)]
struct Function {
    name: String,
    end: u64,
}

/// Checks the image with these bytes.
pub fn check(image: &[u8]) -> Result<()> {
    let file = ElfFile32::<Endianness>::parse(image)?;
    check_roots(&functions(&file), &references(&file)?)
}

/// Checks everything that can be reached from the roots.
fn check_roots(functions: &BTreeMap<u64, Function>, references: &[Reference]) -> Result<()> {
    for root in [TICK, SUPPLY].into_iter().chain(OF_CODE_BANK) {
        check_from(root, functions, references, |_| false)?;
    }
    check_from(UPDATE, functions, references, |reference| !reference.is_call)
}

/// Checks everything that can be reached from `root`. References for which `excepted` returns true may lead to flash.
fn check_from(
    root: &str,
    functions: &BTreeMap<u64, Function>,
    references: &[Reference],
    excepted: impl Fn(&Reference) -> bool,
) -> Result<()> {
    let found = functions.iter().find(|(_, function)| function.name == root);
    let (&start, _) = found.with_context(|| format!("{root} is not in ITCM"))?;
    let (mut waiting, mut seen) = (vec![start], BTreeSet::from([start]));
    while let Some(start) = waiting.pop() {
        let function = &functions[&start];
        for (index, reference) in references.iter().enumerate() {
            if !(start..function.end).contains(&reference.at) {
                continue;
            }
            // What is neither code in ITCM nor in flash is data in RAM or a peripheral, which no flash delays.
            if let Some(called) = function_at(functions, reference.address) {
                if seen.insert(called) {
                    waiting.push(called);
                }
            } else if is_flash(reference.address)
                && !excepted(reference)
                && !is_of_a_panic(&references[index..], function.end)
            {
                bail!(
                    "{} refers to {} at {:#010x}, which is in flash: all that the tick reaches must be in ITCM or \
                     DTCM; name it in firmware/image/tick.x",
                    function.name,
                    reference.name,
                    reference.address
                );
            }
        }
    }
    Ok(())
}

/// Returns the functions in ITCM by their first address.
fn functions(file: &ElfFile32<'_>) -> BTreeMap<u64, Function> {
    let mut functions: BTreeMap<u64, Function> = file
        .symbols()
        .filter(|symbol| {
            // Symbols that begin with `$` mark stretches of code and data (Arm's ELF), not functions.
            symbol.kind() == SymbolKind::Text && !symbol.name().unwrap_or("$").starts_with('$')
        })
        // Bit 0 of a function's address marks Thumb code.
        .map(|symbol| (symbol.address() & !1, symbol))
        .filter(|&(address, _)| is_itcm(address))
        .map(|(address, symbol)| {
            let name = symbol.name().unwrap_or_default().to_owned();
            (
                address,
                Function {
                    name,
                    end: address + symbol.size(),
                },
            )
        })
        .collect();
    // A function in assembly may have no length. It ends where the next one begins.
    let starts: Vec<u64> = functions.keys().copied().collect();
    for (index, start) in starts.iter().enumerate() {
        if let Some(function) = functions.get_mut(start)
            && function.end == *start
        {
            function.end = starts.get(index + 1).copied().unwrap_or(ITCM_BYTES);
        }
    }
    functions
}

/// Returns all references in the code in ITCM, ordered by the address of the instruction.
fn references(file: &ElfFile32<'_>) -> Result<Vec<Reference>> {
    let section = file.section_by_name(".itcm");
    let section = section.context("there is no section .itcm")?;
    let mut references = Vec::new();
    for (at, relocation) in section.relocations() {
        let RelocationFlags::Elf { r_type } = relocation.flags() else {
            continue;
        };
        let RelocationTarget::Symbol(index) = relocation.target() else {
            continue;
        };
        let symbol = file.symbol_by_index(index)?;
        let is_call = matches!(
            r_type,
            elf::R_ARM_THM_PC22 | elf::R_ARM_THM_JUMP24 | elf::R_ARM_THM_JUMP19
        );
        references.push(Reference {
            at,
            is_call,
            name: symbol.name().unwrap_or_default().to_owned(),
            address: symbol.address() & !1,
        });
    }
    if references.is_empty() {
        bail!("the image has no relocations; link it with --emit-relocs");
    }
    references.sort_by_key(|reference| reference.at);
    Ok(references)
}

/// Returns true if the first of `references` is a call of a panic, or the address of a panic's argument.
fn is_of_a_panic(references: &[Reference], function_end: u64) -> bool {
    let Some(first) = references.first() else {
        return false;
    };
    // The address of an argument is loaded before the call, so the next call decides.
    let call = references.iter().find(|reference| reference.is_call);
    call.is_some_and(|call| {
        call.at < function_end
            && call.at - first.at <= PANIC_ARGUMENTS_BYTES
            && PANICS.iter().any(|panic| call.name.contains(panic))
    })
}

/// Returns the first address of the function in ITCM that contains `address`.
fn function_at(functions: &BTreeMap<u64, Function>, address: u64) -> Option<u64> {
    let (&start, function) = functions.range(..=address).next_back()?;
    (address < function.end).then_some(start)
}

const ITCM_BYTES: u64 = 64 * 1024;

/// Returns true if `address` is in ITCM. Addresses below 8 do not count, because sections that are not loaded have
/// address 0, and there is no function at null.
fn is_itcm(address: u64) -> bool {
    (8..ITCM_BYTES).contains(&address)
}

fn is_flash(address: u64) -> bool {
    (0x0800_0000..0x0820_0000).contains(&address)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLASH: u64 = 0x0800_1000;
    const PANIC: &str = "_ZN4core9panicking18panic_bounds_check17h0E";

    fn reference(at: u64, is_call: bool, name: &str, address: u64) -> Reference {
        let name = name.to_owned();
        Reference {
            at,
            is_call,
            name,
            address,
        }
    }

    /// A tick at 1024 to 1124, which calls a function at 2000 to 2100.
    fn program(more: Vec<Reference>) -> Result<()> {
        let function = |name: &str, end| Function {
            name: name.to_owned(),
            end,
        };
        let functions = BTreeMap::from([(1024, function(TICK, 1124)), (2000, function("called", 2100))]);
        let mut references = vec![reference(1030, true, "called", 2000)];
        references.extend(more);
        references.sort_by_key(|reference| reference.at);
        check_from(TICK, &functions, &references, |_| false)
    }

    #[test]
    fn a_call_or_an_address_that_leads_to_flash_is_found_also_in_what_the_tick_calls() {
        assert!(program(vec![]).is_ok());
        assert!(program(vec![reference(1040, false, "data", 0x2000_9000)]).is_ok());
        for at in [1040, 2040] {
            for is_call in [false, true] {
                let error = program(vec![reference(at, is_call, "somewhere", FLASH)])
                    .expect_err("it is in flash")
                    .to_string();
                assert!(error.contains("somewhere"), "{error}");
            }
        }
        // A function that the tick does not call may refer to anything in flash.
        assert!(program(vec![reference(3000, true, "somewhere", FLASH)]).is_ok());
    }

    #[test]
    fn a_panic_and_the_address_of_its_message_may_be_in_flash_and_nothing_farther_from_it() {
        let panic = reference(1100, true, PANIC, FLASH);
        let message = |at| reference(at, false, "message", FLASH);
        assert!(program(vec![panic.clone(), message(1090)]).is_ok());
        assert!(program(vec![panic.clone(), message(1050)]).is_err());
        assert!(program(vec![panic, message(1104)]).is_err());
    }

    #[test]
    fn each_root_has_to_be_in_itcm_and_may_not_lead_to_flash() {
        let roots = [TICK, UPDATE, SUPPLY, OF_CODE_BANK[0], OF_CODE_BANK[1]];
        let functions: BTreeMap<u64, Function> = (1..)
            .zip(roots)
            .map(|(number, name)| {
                let end = number * 1000 + 100;
                let name = name.to_owned();
                (number * 1000, Function { name, end })
            })
            .collect();
        assert!(check_roots(&functions, &[]).is_ok());
        for (&start, function) in &functions {
            let leads = [reference(start + 10, true, "somewhere", FLASH)];
            let error = check_roots(&functions, &leads).expect_err("it is in flash");
            assert!(error.to_string().contains(&function.name), "{error}");
            let mut others = functions.clone();
            others.remove(&start);
            let error = check_roots(&others, &[]).expect_err("it is not in ITCM");
            assert!(error.to_string().contains(&function.name), "{error}");
        }
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert!(check(b"no image").is_err());
    }
}
