//! Counts of calls: from a function's first instruction to the one that returns, including the functions that it calls.

use std::collections::{BTreeSet, HashMap};

use crate::cortex_m4::{Cycles, cycles};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::thumb::{Decoder, Instruction};
use crate::trace::Moment;

/// One call of a counted function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Call {
    /// The function, by its index among the counted ones.
    pub function: usize,
    /// Instructions executed.
    pub instructions: u32,
    /// Cycles of the instructions on a Cortex-M4.
    pub cycles: Cycles,
    /// The number of instructions whose time depends on the values of their operands.
    pub data_dependent: u32,
}

/// A counter of the calls of some functions in a trace.
pub struct Counter<'a> {
    image: &'a Image,
    functions: &'a [u32],
    decoder: Decoder,
    decoded: HashMap<u32, Instruction>,
    before: Option<u32>,
    now: Option<u32>,
    open: Option<Open>,
    calls: Vec<Call>,
    /// The executed addresses of each function's calls.
    executed: Vec<BTreeSet<u32>>,
    /// The executed addresses of each call, in order.
    paths: Vec<Vec<u32>>,
}

struct Open {
    call: Call,
    /// The executed addresses.
    path: Vec<u32>,
    /// The address at which the caller continues.
    return_address: u32,
}

impl<'a> Counter<'a> {
    /// A counter of the functions at these addresses of `image`.
    ///
    /// # Errors
    /// The disassembler does not start.
    pub fn new(image: &'a Image, functions: &'a [u32]) -> Result<Self> {
        Ok(Self {
            image,
            functions,
            decoder: Decoder::new()?,
            decoded: HashMap::new(),
            before: None,
            now: None,
            open: None,
            calls: Vec::new(),
            executed: vec![BTreeSet::new(); functions.len()],
            paths: Vec::new(),
        })
    }

    /// Takes the next executed instruction.
    ///
    /// # Errors
    /// The time of an instruction within a counted function is not known, or a counted function was entered without a
    /// call.
    pub fn take(&mut self, next: u32) -> Result<()> {
        if let Some(now) = self.now {
            if let Some(mut open) = self.open.take() {
                self.decode(now)?;
                let this = &self.decoded[&now];
                let before = self.before.and_then(|before| self.decoded.get(&before));
                open.call.instructions += 1;
                self.executed[open.call.function].insert(now);
                open.path.push(now);
                open.call.cycles += cycles(before, this, next);
                open.call.data_dependent += u32::from(this.depends_on_data());
                if next == open.return_address {
                    self.calls.push(open.call);
                    self.paths.push(open.path);
                } else {
                    self.open = Some(open);
                }
            }
            if self.open.is_none()
                && let Some(function) = self.functions.iter().position(|&entry| entry == next)
            {
                self.decode(now)?;
                let caller = &self.decoded[&now];
                if !caller.is_call {
                    return Err(Error::NoCall(next));
                }
                self.open = Some(Open {
                    call: Call {
                        function,
                        instructions: 0,
                        cycles: Cycles::default(),
                        data_dependent: 0,
                    },
                    path: Vec::new(),
                    return_address: caller.end(),
                });
            }
        }
        self.before = self.now.replace(next);
        Ok(())
    }

    /// The addresses that calls of function `function` executed so far.
    pub fn executed(&self, function: usize) -> &BTreeSet<u32> {
        &self.executed[function]
    }

    /// The instructions of the calls of function `function` so far, in the order in which each call executed them.
    pub fn paths(&self, function: usize) -> impl Iterator<Item = Vec<&Instruction>> {
        let calls = self.calls.iter().zip(&self.paths);
        calls
            .filter(move |(call, _)| call.function == function)
            .map(|(_, path)| path.iter().map(|address| &self.decoded[address]).collect())
    }

    /// Returns all calls, in order.
    ///
    /// # Errors
    /// The trace ends within a call.
    pub fn end(self) -> Result<Vec<Call>> {
        match self.open {
            None => Ok(self.calls),
            Some(open) => Err(Error::Cut(self.functions[open.call.function])),
        }
    }

    fn decode(&mut self, address: u32) -> Result<()> {
        if !self.decoded.contains_key(&address) {
            let instruction = self.decoder.decode(self.image.code(address)?, address)?;
            self.decoded.insert(address, instruction);
        }
        Ok(())
    }
}

/// A counter of the additional cycles of unaligned accesses, for each call of one function.
///
/// It needs a trace with registers. The trace may leave out code that is not part of such calls.
pub struct Alignment<'a> {
    image: &'a Image,
    function: u32,
    decoder: Decoder,
    decoded: HashMap<u32, Instruction>,
    calls: Vec<u32>,
}

impl<'a> Alignment<'a> {
    /// A counter of the calls of the function at this address of `image`.
    ///
    /// # Errors
    /// The disassembler does not start.
    pub fn new(image: &'a Image, function: u32) -> Result<Self> {
        Ok(Self {
            image,
            function,
            decoder: Decoder::new()?,
            decoded: HashMap::new(),
            calls: Vec::new(),
        })
    }

    /// Takes the next executed instruction.
    ///
    /// # Errors
    /// The time of the instruction is not known.
    pub fn take(&mut self, moment: &Moment) -> Result<()> {
        if moment.address == self.function {
            self.calls.push(0);
        }
        let Some(cycles) = self.calls.last_mut() else {
            return Ok(());
        };
        if !self.decoded.contains_key(&moment.address) {
            let code = self.image.code(moment.address)?;
            let instruction = self.decoder.decode(code, moment.address)?;
            self.decoded.insert(moment.address, instruction);
        }
        if let Some(access) = self.decoded[&moment.address].access {
            *cycles += access.extra_accesses(access.address(&moment.registers));
        }
        Ok(())
    }

    /// Returns the additional cycles of each call, from one entry to the next.
    pub fn end(self) -> Vec<u32> {
        self.calls
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The caller at 0x400: nop; bl 0x410; nop. The function at 0x410: push {r4, lr}; bl 0x420; pop {r4, pc}. The
    /// function that it calls, at 0x420: ldr r0, [r1]; ldr r1, [r2]; bx lr.
    fn image() -> Image {
        let mut code = vec![0u8; 0x40];
        let mut put = |at: usize, bytes: &[u8]| code[at..at + bytes.len()].copy_from_slice(bytes);
        put(0x00, &[0x00, 0xbf, 0x00, 0xf0, 0x05, 0xf8, 0x00, 0xbf]);
        put(0x10, &[0x10, 0xb5, 0x00, 0xf0, 0x05, 0xf8, 0x10, 0xbd]);
        put(0x20, &[0x08, 0x68, 0x11, 0x68, 0x70, 0x47]);
        Image::of_code(0x400, code)
    }

    const CALL: [u32; 10] = [
        0x400, 0x402, 0x410, 0x412, 0x420, 0x422, 0x424, 0x416, 0x406, 0x408,
    ];

    fn count(trace: &[u32]) -> Result<Vec<Call>> {
        let image = image();
        let mut counter = Counter::new(&image, &[0x410])?;
        for &address in trace {
            counter.take(address)?;
        }
        counter.end()
    }

    #[test]
    fn a_call_is_counted_from_its_first_instruction_to_its_return_with_all_that_it_calls() {
        // push 3; bl 1 + P; two loads 3 or 4; bx 1 + P; pop {r4, pc} 3 + P.
        let one = Call {
            function: 0,
            instructions: 6,
            cycles: Cycles {
                best: 3 + 2 + 3 + 2 + 4,
                worst: 3 + 4 + 4 + 4 + 6,
            },
            data_dependent: 0,
        };
        assert_eq!(count(&CALL).unwrap(), [one]);
        assert_eq!(count(&[CALL, CALL].concat()).unwrap(), [one, one]);
        assert_eq!(count(&CALL[..2]).unwrap(), []);
    }

    #[test]
    fn a_call_cut_off_and_a_function_entered_otherwise_are_refused() {
        for end in 3..9 {
            assert!(
                matches!(count(&CALL[..end]), Err(Error::Cut(0x410))),
                "cut after {end}"
            );
        }
        assert!(matches!(
            count(&[0x400, 0x410, 0x412]),
            Err(Error::NoCall(0x410))
        ));
    }

    #[test]
    fn what_has_no_code_is_refused_within_a_call() {
        assert!(matches!(
            count(&[0x400, 0x402, 0x410, 0x9000, 0x9002]),
            Err(Error::NoCode(0x9000))
        ));
    }

    #[test]
    fn accesses_that_are_not_aligned_are_counted_for_the_call_that_makes_them() {
        let image = image();
        let mut alignment = Alignment::new(&image, 0x410).unwrap();
        // The two loads at 0x420 are from r1 and r2.
        for (r1, r2) in [(0x2000_0000, 0x2000_0004), (0x2000_0002, 0x2000_0003)] {
            let mut registers = [0; 16];
            (registers[1], registers[2]) = (r1, r2);
            for address in &CALL[2..8] {
                let moment = Moment {
                    address: *address,
                    registers,
                };
                alignment.take(&moment).unwrap();
            }
        }
        assert_eq!(alignment.end(), [0, 3]);
    }
}
