//! Ctrl-C and SIGTERM, which must leave the stylus silent and its settings restored.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use crate::error::Result;

/// Exit code after a second interrupt.
const EXIT_INTERRUPTED: i32 = 130;

/// A flag that ends a run.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Raises the flag.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns true once the run is to end.
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Raises the flag on Ctrl-C and, on Unix, SIGTERM from now on. A second signal ends the process at once.
    ///
    /// # Errors
    /// The system refuses a thread or a signal handler.
    pub fn listen(&self) -> Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()?;
        let flag = self.clone();
        let listener = move || {
            runtime.block_on(async {
                loop {
                    wanted().await;
                    if flag.is_raised() {
                        std::process::exit(EXIT_INTERRUPTED);
                    }
                    flag.raise();
                    eprintln!(
                        "interrupted: silencing and restoring the stylus; once more ends at once"
                    );
                }
            });
        };
        thread::Builder::new()
            .name("hil-interrupt".to_owned())
            .spawn(listener)?;
        Ok(())
    }
}

#[cfg(unix)]
async fn wanted() {
    use tokio::signal::unix::{SignalKind, signal};
    // A failure to listen counts as an interrupt, because ending is the safe choice.
    let (Ok(mut interrupt), Ok(mut terminate)) = (
        signal(SignalKind::interrupt()),
        signal(SignalKind::terminate()),
    ) else {
        return;
    };
    tokio::select! {
        _ = interrupt.recv() => {}
        _ = terminate.recv() => {}
    }
}

#[cfg(not(unix))]
async fn wanted() {
    let _ = tokio::signal::ctrl_c().await;
}
