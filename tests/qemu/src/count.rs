//! Counts of calls: from a function's first instruction to the one that returns, including the functions that it calls.

use std::collections::HashMap;
use std::rc::Rc;

use crate::error::{Error, Result};
use crate::image::Image;
use crate::thumb::{Decoder, Instruction};

/// One call of a counted function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Call {
    /// The function, by its index among the counted ones.
    pub function: usize,
    /// The executed instructions, in order.
    pub path: Vec<Rc<Instruction>>,
}

impl Call {
    /// Number of executed instructions.
    pub fn instructions(&self) -> u32 {
        self.path.len() as u32
    }
}

/// A counter of the calls of some functions in a trace.
pub struct Counter<'a> {
    image: &'a Image,
    functions: &'a [u32],
    decoder: Decoder,
    decoded: HashMap<u32, Rc<Instruction>>,
    now: Option<u32>,
    /// The call that has begun, and the address at which its caller continues.
    open: Option<(Call, u32)>,
    calls: Vec<Call>,
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
            now: None,
            open: None,
            calls: Vec::new(),
        })
    }

    /// Takes the next executed instruction.
    ///
    /// # Errors
    /// An executed address has no code, or a counted function was entered without a call.
    pub fn take(&mut self, next: u32) -> Result<()> {
        let Some(now) = self.now.replace(next) else {
            return Ok(());
        };
        if let Some((mut call, return_address)) = self.open.take() {
            call.path.push(self.decoded(now)?);
            if next == return_address {
                self.calls.push(call);
            } else {
                self.open = Some((call, return_address));
            }
        }
        let entered = self.functions.iter().position(|&entry| entry == next);
        if let (None, Some(function)) = (&self.open, entered) {
            let caller = self.decoded(now)?;
            if !caller.is_call {
                return Err(Error::NoCall(next));
            }
            let path = Vec::new();
            self.open = Some((Call { function, path }, caller.end));
        }
        Ok(())
    }

    /// Returns all calls, in order.
    ///
    /// # Errors
    /// The trace ends within a call.
    pub fn end(self) -> Result<Vec<Call>> {
        match self.open {
            None => Ok(self.calls),
            Some((call, _)) => Err(Error::Cut(self.functions[call.function])),
        }
    }

    fn decoded(&mut self, address: u32) -> Result<Rc<Instruction>> {
        if let Some(known) = self.decoded.get(&address) {
            return Ok(known.clone());
        }
        let instruction = Rc::new(self.decoder.decode(self.image.code(address)?, address)?);
        self.decoded.insert(address, instruction.clone());
        Ok(instruction)
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

    fn count(trace: &[u32]) -> Result<Vec<u32>> {
        let image = image();
        let mut counter = Counter::new(&image, &[0x410])?;
        for &address in trace {
            counter.take(address)?;
        }
        Ok(counter.end()?.iter().map(Call::instructions).collect())
    }

    #[test]
    fn a_call_is_counted_from_its_first_instruction_to_its_return_with_all_that_it_calls() {
        assert_eq!(count(&CALL).unwrap(), [6]);
        assert_eq!(count(&[CALL, CALL].concat()).unwrap(), [6, 6]);
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
}
