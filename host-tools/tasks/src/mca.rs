//! Cycles of a Cortex-M4 or M7 by llvm-mca, a *model*: LLVM's own tables of the processor's units and latencies.
//!
//! It is given the instructions that a call executed on QEMU, in their order, so that loops and branches are known. It
//! issues them in order, up to two per cycle on a Cortex-M7, as their registers and the units are free. It leaves out
//! the memories, the prediction of branches, and what the processor does with pairs of instructions beyond its tables.
//! It counts an instruction that loads or stores several words as one of one word, which is too little; here each word
//! is an instruction of its own, which may be too much. A conditional instruction is taken as one that is always
//! executed, and the IT before it as one that does nothing.

use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::rc::Rc;

use qemu_tests::thumb::Instruction;

use anyhow::{Context, Result, bail};

use crate::guest::Processor;
use crate::process;

fn program() -> Result<PathBuf> {
    process::find("llvm-mca", "on Debian as root, `apt-get install llvm`")
}

/// The version of LLVM.
///
/// # Errors
/// llvm-mca is missing or prints no version.
pub fn version() -> Result<String> {
    process::version(&program()?)
}

/// Cycles of `path`, the instructions that a call executed, in order, on `processor`.
///
/// # Errors
/// llvm-mca is missing, or refuses an instruction.
pub fn cycles(processor: Processor, path: &[Rc<Instruction>]) -> Result<u32> {
    let mut text = String::from(".syntax unified\n.thumb\n");
    for instruction in path {
        for line in lines(&instruction.text) {
            text.push_str(&line);
            text.push('\n');
        }
    }
    let mut child = Command::new(program()?)
        .arg("-mtriple=thumbv7em-none-eabihf")
        .arg(format!("-mcpu={}", processor.name()))
        .args(["-iterations=1", "-instruction-info=false"])
        .args(["-resource-pressure=false"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    // It reads all of its input before it writes.
    let mut input = child.stdin.take().context("llvm-mca reads nothing")?;
    input.write_all(text.as_bytes())?;
    drop(input);
    let output = child.wait_with_output()?;
    let told = String::from_utf8_lossy(&output.stdout);
    let refused = String::from_utf8_lossy(&output.stderr);
    if let Some(at) = refused.find("error:") {
        let told: Vec<&str> = refused[at..].lines().take(2).map(str::trim).collect();
        bail!("llvm-mca: {}", told.join(": "));
    }
    told.lines()
        .find_map(|line| line.strip_prefix("Total Cycles:")?.trim().parse().ok())
        .context("llvm-mca tells no cycles")
}

/// The instruction with disassembled text `text` as the assembler reads it, each word of a list by itself.
fn lines(text: &str) -> Vec<String> {
    let (mnemonic, operands) = text.split_once(' ').unwrap_or((text, ""));
    let bare = mnemonic.trim_end_matches(".w").trim_end_matches(".n");
    if bare.starts_with("it") {
        return vec!["nop".to_owned()];
    }
    if bare == "vcmp.f32"
        && let Some(register) = operands.strip_suffix(", #0")
    {
        // The tables have no comparison with zero.
        return vec![format!("{bare} {register}, {register}")];
    }
    if is_branch(bare) {
        // Any address near does: the next instruction is known.
        let register = operands.rsplit_once(", ").map(|(register, _)| register);
        let register = register.map_or(String::new(), |register| format!("{register}, "));
        return vec![format!("{bare} {register}#8")];
    }
    let Some((base, list)) = operands.split_once('{').or(Some((operands, ""))) else {
        return vec![text.to_owned()];
    };
    let base = base.trim_end_matches([' ', ',']);
    let words: Vec<&str> = list
        .trim_end_matches('}')
        .split(", ")
        .filter(|word| !word.is_empty())
        .collect();
    let (name, base, moves, down) = match bare {
        "push" => ("str", "sp", true, true),
        "pop" => ("ldr", "sp", true, false),
        "ldm" | "ldmdb" => ("ldr", base, base.ends_with('!'), bare == "ldmdb"),
        "stm" | "stmdb" => ("str", base, base.ends_with('!'), bare == "stmdb"),
        "ldrd" | "strd" => return pair(bare, operands),
        _ => return vec![text.to_owned()],
    };
    let (base, count) = (base.trim_end_matches('!'), words.len());
    let first = if down { -4 * count as i32 } else { 0 };
    let offsets = (first..).step_by(4);
    let mut lines: Vec<(&str, String)> = words
        .iter()
        .zip(offsets)
        .map(|(&word, offset)| (word, format!("{name} {word}, [{base}, #{offset}]")))
        .collect();
    // A base that is loaded is loaded last.
    lines.sort_by_key(|(word, _)| *word == base);
    let mut lines: Vec<String> = lines.into_iter().map(|(_, line)| line).collect();
    if moves {
        // The new address is no instruction: the last access makes it.
        let last = lines.pop().unwrap_or_default();
        let (word, _) = last.split_once(", [").unwrap_or((&last, ""));
        let whole = 4 * count as i32;
        lines.push(if down {
            format!("{word}, [{base}, #{}]!", -whole)
        } else {
            format!("{word}, [{base}], #{whole}")
        });
    }
    lines
}

/// Both words of a pair, the second one with the address that the instruction leaves.
fn pair(name: &str, operands: &str) -> Vec<String> {
    let name = &name[..3];
    let mut parts = operands.splitn(3, ", ");
    let mut part = || parts.next().unwrap_or_default();
    let (first, second, address) = (part(), part(), part());
    let (base, _) = address
        .trim_start_matches('[')
        .split_once([',', ']'])
        .unwrap_or((address, ""));
    // The first is not to destroy the address of the second.
    let (first, second) = if first == base {
        (second, first)
    } else {
        (first, second)
    };
    vec![
        format!("{name} {first}, [{base}]"),
        format!("{name} {second}, {address}"),
    ]
}

/// True for a branch to an address that the instruction names.
fn is_branch(mnemonic: &str) -> bool {
    const CONDITIONS: [&str; 14] = [
        "eq", "ne", "hs", "lo", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le",
    ];
    let condition = mnemonic.strip_prefix('b').unwrap_or("none");
    matches!(mnemonic, "b" | "bl" | "cbz" | "cbnz")
        || CONDITIONS.contains(&condition)
        || matches!(condition, "cs" | "cc")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_word_of_a_list_is_an_access_and_the_last_one_moves_the_address() {
        assert_eq!(
            lines("ldmdb sl!, {r0, r1, r2}"),
            [
                "ldr r0, [sl, #-12]",
                "ldr r1, [sl, #-8]",
                "ldr r2, [sl, #-12]!"
            ]
        );
        assert_eq!(
            lines("pop.w {r4, pc}"),
            ["ldr r4, [sp, #0]", "ldr pc, [sp], #8"]
        );
        assert_eq!(
            lines("ldm.w r4, {r4, r5}"),
            ["ldr r5, [r4, #4]", "ldr r4, [r4, #0]"]
        );
        assert_eq!(
            lines("ldrd r4, r3, [fp, #-8]!"),
            ["ldr r4, [fp]", "ldr r3, [fp, #-8]!"]
        );
        assert_eq!(
            lines("strd r0, r1, [r2], #8"),
            ["str r0, [r2]", "str r1, [r2], #8"]
        );
    }

    #[test]
    fn a_branch_goes_anywhere_and_all_else_stays_as_it_is() {
        assert_eq!(lines("bne.w #0x18fba"), ["bne #8"]);
        assert_eq!(lines("cbz r0, #0x18df0"), ["cbz r0, #8"]);
        assert_eq!(lines("itt mi"), ["nop"]);
        for text in ["bic r0, r1, #1", "bx lr", "smlal r2, r5, r0, r8"] {
            assert_eq!(lines(text), [text]);
        }
    }
}
