//! Ctrl-C and SIGTERM: no command leaves a temporary behind, and those that drive a stylus bring it in order first.

use std::sync::atomic::{AtomicBool, Ordering};

/// True once a command listens: the first signal then only raises the flag.
static IS_HEARD: AtomicBool = AtomicBool::new(false);

/// True once a signal came to a command that listens.
static IS_RAISED: AtomicBool = AtomicBool::new(false);

/// True once signals are handled.
#[cfg(unix)]
static IS_HANDLED: AtomicBool = AtomicBool::new(false);

/// Exit code after a second interrupt of a command that listens.
const EXIT_INTERRUPTED: i32 = 2;

/// Begins to handle signals, for the whole process.
///
/// Without a command that listens, a signal removes the temporaries and ends the process as it would have without this.
/// A file that grows beyond the limit of the process is a failure to write, and no signal. Where the system gives no
/// thread or no handler, signals do what they do by themselves.
#[cfg(unix)]
pub fn handle() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals;

    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM, SIGXFSZ]) else {
        return;
    };
    // After nohup a terminal that closes is no reason to end.
    if !is_ignored(SIGHUP) {
        let _ = signals.add_signal(SIGHUP);
    }
    let listener = move || {
        for signal in signals.forever() {
            if signal != SIGXFSZ {
                receive(|| {
                    let _ = signal_hook::low_level::emulate_default_handler(signal);
                });
            }
        }
    };
    let thread = std::thread::Builder::new().name("stylus-interrupt".to_owned());
    IS_HANDLED.store(thread.spawn(listener).is_ok(), Ordering::SeqCst);
}

/// Begins to handle Ctrl-C, for the whole process. Other systems have the handler of the link's runtime alone, so that
/// only commands that drive a stylus handle it.
#[cfg(not(unix))]
pub fn handle() {}

/// Takes note of a signal; `end` ends the process by it.
pub fn receive(end: impl FnOnce()) {
    let is_heard = IS_HEARD.load(Ordering::SeqCst);
    if is_heard && !IS_RAISED.swap(true, Ordering::SeqCst) {
        return;
    }
    let _removed = host_tools::support::temporaries::remove_all();
    if !is_heard {
        end();
    }
    // After a second interrupt the user does not want to wait for the command's clean-up.
    std::process::exit(EXIT_INTERRUPTED);
}

/// Returns true if the process was started with this signal ignored, as far as the system tells.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else {
        return false;
    };
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Returns a flag. From now on the first signal only raises it; the second one ends the process.
///
/// # Errors
/// A system that refused a thread or a signal handler.
#[cfg(feature = "device")]
pub fn listen() -> std::io::Result<&'static AtomicBool> {
    IS_HEARD.store(true, Ordering::SeqCst);
    #[cfg(unix)]
    if !IS_HANDLED.load(Ordering::SeqCst) {
        return Err(std::io::Error::other("signals are not handled"));
    }
    Ok(&IS_RAISED)
}
