//! Ctrl-C and SIGTERM, for commands that must leave the stylus in order before they end.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use host_tools::support::error::{Error, Result};

/// Exit code after a second interrupt.
const EXIT_INTERRUPTED: i32 = 2;

/// A flag that an interrupt raises.
#[derive(Clone)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on. The first signal only raises the flag; the second one ends the process.
    ///
    /// # Errors
    /// A system that refuses a thread or a signal handler.
    pub fn listen() -> Result<Self> {
        let failed = || Error::io("listen for", Path::new("Ctrl-C"));
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(failed())?;
        let flag = Arc::new(AtomicBool::new(false));
        let raised = flag.clone();
        let mut wanted = {
            let _within = runtime.enter();
            Wanted::new().map_err(failed())?
        };
        let listener = move || {
            runtime.block_on(async {
                loop {
                    wanted.next().await;
                    // After a second interrupt the user does not want to wait for the command's clean-up.
                    if raised.swap(true, Ordering::Relaxed) {
                        std::process::exit(EXIT_INTERRUPTED);
                    }
                }
            });
        };
        thread::Builder::new()
            .name("stylus-interrupt".to_owned())
            .spawn(listener)
            .map_err(failed())?;
        Ok(Self(flag))
    }

    /// Returns true once a signal came.
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[cfg(unix)]
struct Wanted {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Wanted {
    fn new() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
        })
    }

    async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}

#[cfg(not(unix))]
struct Wanted;

#[cfg(not(unix))]
impl Wanted {
    fn new() -> std::io::Result<Self> {
        Ok(Self)
    }

    async fn next(&mut self) {
        // A failure to listen counts as an interrupt, because ending is the safe choice.
        let _ = tokio::signal::ctrl_c().await;
    }
}
