//! Ctrl-C and a request to end, for commands that have something to put right before they go.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use host_tools::support::error::{Error, Result};

/// What a process that is ended in the middle ends with.
const EXIT_IMPATIENT: i32 = 2;

/// Whether the user wants to end.
#[derive(Clone)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on; the signals do not end the process any more.
    ///
    /// # Errors
    /// That the system lets nobody listen.
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
                    // Whoever says it twice does not want to wait for what is put right.
                    if raised.swap(true, Ordering::Relaxed) {
                        std::process::exit(EXIT_IMPATIENT);
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

    /// Whether the user has said so.
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
        // That listening fails later is not to be told from a wish to end, and the end is the safe side.
        let _ = tokio::signal::ctrl_c().await;
    }
}
