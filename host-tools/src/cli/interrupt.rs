//! Ctrl-C, SIGTERM and SIGHUP. No command leaves a temporary file behind, and a command that drives a stylus first
//! restores its state.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
#[cfg(unix)]
use std::sync::mpsc;

use stylus_support::{Error, Result};

/// True once a command listens. The first signal then only raises the flag.
static IS_HEARD: AtomicBool = AtomicBool::new(false);

/// True once a signal came while a command listened.
static IS_RAISED: AtomicBool = AtomicBool::new(false);

/// True once signals are handled.
#[cfg(unix)]
static IS_HANDLED: AtomicBool = AtomicBool::new(false);

/// Exit code after a second interrupt of a command that listens.
const EXIT_INTERRUPTED: i32 = 2;

/// Starts the handling of signals, for the whole process.
///
/// If no command listens, a signal removes the temporary files and ends the process like without a handler. A file that
/// grows beyond the limit of the process causes a write error instead of a signal. If the system refuses a handler,
/// signals have their default effects.
#[cfg(unix)]
pub fn handle() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals;

    let (ready, is_ready) = mpsc::channel();
    // The thread itself adds the handlers, because without a thread they would swallow the signals.
    let listener = move || {
        let Ok(mut signals) = Signals::new([SIGINT, SIGTERM, SIGXFSZ]) else {
            return;
        };
        // After nohup, a terminal that closes must not end the process.
        if !is_ignored(SIGHUP) {
            let _ = signals.add_signal(SIGHUP);
        }
        let _ = ready.send(());
        for signal in signals.forever() {
            // SIGXFSZ would end the process. Once it is handled, the write that was too long returns an error instead.
            if signal != SIGXFSZ {
                receive(|| {
                    // The process ends by the signal itself, so that a shell sees code 130 after Ctrl-C and stops a
                    // script.
                    let _ = signal_hook::low_level::emulate_default_handler(signal);
                });
            }
        }
    };
    let thread = std::thread::Builder::new().name("stylus-interrupt".to_owned());
    drop(thread.spawn(listener));
    // Without handlers `ready` is gone.
    IS_HANDLED.store(is_ready.recv().is_ok(), Ordering::SeqCst);
}

/// Does nothing. Other systems have only the handler of the link's runtime, so only commands that drive a stylus handle
/// Ctrl-C.
#[cfg(not(unix))]
pub fn handle() {}

/// Handles a signal. If a command listens, the first signal only raises the flag. Every other signal removes the
/// temporary files and ends the process; if no command listens, `end` does so.
fn receive(end: impl FnOnce()) {
    let is_heard = IS_HEARD.load(Ordering::SeqCst);
    if is_heard && !IS_RAISED.swap(true, Ordering::SeqCst) {
        return;
    }
    // Kept until the process ends, because it locks the list: no other thread creates a temporary meanwhile.
    let _removed = stylus_support::temporaries::remove_all();
    if !is_heard {
        end();
    }
    // After a second interrupt the user does not want to wait for the command's clean-up.
    std::process::exit(EXIT_INTERRUPTED);
}

/// Returns true if the process was started with this signal ignored, as far as the system reports it.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    // The system's call for this needs unsafe code, which this package forbids.
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else {
        return false;
    };
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    // Signals are counted from 1, bits from 0.
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Proof that a command listens for interrupts.
#[derive(Clone, Copy)]
pub struct Interrupt(());

impl Interrupt {
    /// Starts to listen. The first signal only raises a flag; the second one ends the process.
    pub fn listen() -> Result<Self> {
        IS_HEARD.store(true, Ordering::SeqCst);
        #[cfg(unix)]
        let is_handled = IS_HANDLED.load(Ordering::SeqCst).then_some(());
        #[cfg(unix)]
        let handled = is_handled.ok_or_else(|| io::Error::other("signals are not handled"));
        #[cfg(not(unix))]
        let handled = listen_by_the_runtime();
        handled.map_err(Error::io("listen for", Path::new("Ctrl-C")))?;
        Ok(Self(()))
    }

    /// Returns true once a signal came.
    #[expect(clippy::unused_self, reason = "who asks has listened before")]
    pub fn is_raised(self) -> bool {
        IS_RAISED.load(Ordering::Relaxed)
    }
}

/// Listens for Ctrl-C through the link's runtime, on systems without another handler.
#[cfg(not(unix))]
fn listen_by_the_runtime() -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let listener = move || {
        runtime.block_on(async {
            loop {
                // A failure to listen counts as an interrupt, because ending is the safe choice.
                let _ = tokio::signal::ctrl_c().await;
                receive(|| {});
            }
        });
    };
    std::thread::Builder::new()
        .name("stylus-interrupt".to_owned())
        .spawn(listener)
        .map(drop)
}
