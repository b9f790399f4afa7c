//! The digest of the fixture on emulated processors, which is that of host, board and browser.

use kernel_vectors::job::Job;
use kernel_vectors::{DIGESTED, digest_library, report};
use tasks::guest::{self, Processor};
use tasks::qemu;
use tasks::toolchain::Toolchain;

#[test]
fn emulated_processors_play_the_digest_with_every_arithmetic() {
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error:#}"));
    let library = digest_library();
    let job = Job::Digest { library: &library };
    for processor in Processor::ALL {
        let image = guest::build(&toolchain, processor);
        let image = image.unwrap_or_else(|error| panic!("{error:#}"));
        let text = qemu::run(processor, &image, Some(&job));
        let text = text.unwrap_or_else(|error| panic!("{error:#}"));
        for arithmetic in report::ARITHMETICS {
            let line = format!("{} {DIGESTED:08x} {arithmetic}", report::DIGEST);
            assert!(
                text.lines().any(|found| found == line),
                "{}: {line} is not in\n{text}",
                processor.name()
            );
        }
    }
}
