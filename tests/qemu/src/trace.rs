//! The emulator's log of executed blocks, `-d exec,nochain`, with one instruction per block.

use crate::error::{Error, Result};

const EXECUTED: &str = "Trace ";
const TAKEN_BACK: &str = "Stopped execution of TB chain before ";

/// A reader of the log's lines that yields the addresses of the executed instructions.
///
/// The emulator logs an instruction before it begins it, and may then leave without executing it, to handle something
/// else. A following line takes the instruction back. Each address therefore waits for the next line.
#[derive(Debug, Default)]
pub struct Trace {
    last: Option<u32>,
}

impl Trace {
    /// Takes a line, and returns the instruction that the line confirms as executed, if any.
    ///
    /// # Errors
    /// The line is none of a trace.
    pub fn take(&mut self, line: &str) -> Result<Option<u32>> {
        let unknown = || Error::Line(line.to_owned());
        if line.starts_with(EXECUTED) {
            // Trace 0: 0x7f50c0000100 [00800408/00000400/00000110/ff020201] name: base, address, two words of flags.
            let address = bracketed(line)
                .and_then(|fields| fields.split('/').nth(1))
                .ok_or_else(unknown)?;
            let address = u32::from_str_radix(address, 16).map_err(|_| unknown())?;
            Ok(self.last.replace(address))
        } else if line.starts_with(TAKEN_BACK) {
            let address = bracketed(line).ok_or_else(unknown)?;
            let taken_back = u32::from_str_radix(address, 16).map_err(|_| unknown())?;
            match self.last.take() {
                Some(last) if last == taken_back => Ok(None),
                last => Err(Error::TakenBack {
                    taken_back,
                    last: last.unwrap_or_default(),
                }),
            }
        } else {
            Err(unknown())
        }
    }

    /// Returns the last instruction.
    pub fn end(self) -> Option<u32> {
        self.last
    }
}

fn bracketed(line: &str) -> Option<&str> {
    let (_, rest) = line.split_once('[')?;
    Some(rest.split_once(']')?.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn addresses(log: &str) -> Result<Vec<u32>> {
        let mut trace = Trace::default();
        let mut addresses = Vec::new();
        for line in log.lines() {
            addresses.extend(trace.take(line)?);
        }
        addresses.extend(trace.end());
        Ok(addresses)
    }

    const LOG: &str = "\
Trace 0: 0x7f50c0000100 [00800408/00000400/00000110/ff020201] Reset
Trace 0: 0x7f50c0000240 [00800408/00013df8/00000110/ff020201] __pre_init
Stopped execution of TB chain before 0x7f50c0000240 [00013df8] __pre_init
Trace 0: 0x7f50c0000240 [00800408/00013df8/00000110/ff020201] __pre_init
Trace 0: 0x7f50c0000440 [00800408/00013dfa/00000110/ff020201]
";

    #[test]
    fn what_the_emulator_took_back_was_not_executed() {
        assert_eq!(addresses(LOG).unwrap(), [0x400, 0x13df8, 0x13dfa]);
    }

    #[test]
    fn taking_back_anything_but_the_last_instruction_is_refused() {
        let log = LOG.replace("before 0x7f50c0000240 [00013df8]", "before 0x1 [00000400]");
        assert!(matches!(
            addresses(&log),
            Err(Error::TakenBack {
                taken_back: 0x400,
                last: 0x13df8
            })
        ));
    }

    #[test]
    fn a_line_of_anything_else_is_refused() {
        for line in [
            "qemu-system-arm: fault",
            "Trace 0: 0x1 [zz]",
            "Trace 0: 0x1 [0/zz/0/0]",
            "",
        ] {
            assert!(Trace::default().take(line).is_err(), "{line}");
        }
    }
}
