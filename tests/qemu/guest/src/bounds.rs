//! Counts instructions: for decoding libraries, for the longest step of decoding, and for plans.

use core::hint::black_box;

use kernel_vectors::{Libraries, report};
use model_format::{Decoder, Library, Texture};
use stylus_kernel::scene::Plan;

use crate::counter::Counter;
use crate::output::Output;

/// Decodes each of `libraries`. Plans each of its scenes and its first and last texture, all found by name. Prints the
/// costs.
pub fn measure(libraries: &[u8], counter: &Counter, output: &mut Output) {
    for bytes in Libraries(libraries) {
        let (mut all, mut longest, mut steps) = (0u64, 0, 0u32);
        let mut decoder = Decoder::new(bytes);
        let library = loop {
            let mut stepped = Ok(None);
            let cost = counter.instructions(&mut || stepped = black_box(&mut decoder).step());
            all += u64::from(cost);
            longest = cost.max(longest);
            steps += 1;
            if let Some(library) = stepped.expect("the host wrote libraries") {
                break library;
            }
        };
        let plan = plans(&library, counter);
        output.line(format_args!(
            "{} {} {all} {steps} {longest} {plan}",
            report::LIBRARY_COST,
            bytes.len()
        ));
    }
}

/// Largest number of instructions of a plan, from looking up the name that a host requests to the check of the plan's
/// cost.
fn plans(library: &Library<'_>, counter: &Counter) -> u32 {
    let mut most = 0;
    for scene in library.scenes() {
        let cost = counter.instructions(&mut || {
            let found = black_box(library).scene(&scene.name);
            let plan = found.map(|scene| Plan::new(&scene, library)).and_then(Result::ok).expect("it is valid");
            black_box(plan.worst_case().instructions());
            black_box(&plan);
        });
        most = cost.max(most);
    }
    for name in [library.textures().next(), library.textures().last()].iter().flatten().map(Texture::name) {
        let cost = counter.instructions(&mut || {
            let texture = black_box(library).texture(name).expect("it is there");
            let plan = Plan::of_texture(texture);
            black_box(plan.worst_case().instructions());
            black_box(&plan);
        });
        most = cost.max(most);
    }
    most
}
