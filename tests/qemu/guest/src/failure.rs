//! Failures: each ends the emulator with a message.
#![expect(
    unsafe_code,
    reason = "cortex-m-rt wants the handler of hard faults declared unsafe; nothing in it is"
)]

use core::fmt::Write;
use core::panic::PanicInfo;

use cortex_m_rt::{ExceptionFrame, exception};
use cortex_m_semihosting::{debug, hio};

fn fail(message: core::fmt::Arguments<'_>) -> ! {
    if let Ok(mut stream) = hio::hstdout() {
        // A failure of the output cannot be reported anywhere else.
        let _ = writeln!(stream, "{message}");
    }
    loop {
        debug::exit(debug::EXIT_FAILURE);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    fail(format_args!("{info}"))
}

// SAFETY: the handler only prints the frame that the processor saved, and ends the emulator.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    fail(format_args!("HardFault at {:#010x}: {frame:#?}", frame.pc()))
}
