//! Instructions of the proof of a library's direct forms, step by step.

use core::hint::black_box;

use kernel_vectors::report;
use model_format::Library;
use stylus_kernel::proof::Proof;

use crate::counter::Counter;
use crate::output::Output;

/// Proves `library`, and prints the number of steps, the longest, and all of it.
pub fn measure(library: &[u8], counter: &Counter, output: &mut Output) {
    let library = Library::decode(library).expect("the host wrote a library");
    let mut proof = Proof::new(library);
    let (mut steps, mut longest, mut all) = (0u32, 0, 0u64);
    loop {
        let mut stepped = Ok(false);
        let cost = counter.instructions(&mut || stepped = black_box(&mut proof).step());
        steps += 1;
        longest = cost.max(longest);
        all += u64::from(cost);
        if !stepped.expect("the host has proved it") {
            break;
        }
    }
    output.line(format_args!(
        "{} {steps} {longest} {all}",
        report::PROOF_COST
    ));
}
