//! Ctrl-C and SIGTERM, for commands that must leave the stylus in order before they end.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use host_tools::support::error::{Error, Result};

use crate::cli::interrupt;

/// A flag that an interrupt raises.
#[derive(Clone)]
pub struct Interrupt(&'static AtomicBool);

impl Interrupt {
    /// Listens from now on. The first signal only raises the flag; the second one ends the process.
    ///
    /// # Errors
    /// A system that refuses a thread or a signal handler.
    pub fn listen() -> Result<Self> {
        let flag = interrupt::listen().map_err(Error::io("listen for", Path::new("Ctrl-C")))?;
        #[cfg(not(unix))]
        listen_by_the_runtime().map_err(Error::io("listen for", Path::new("Ctrl-C")))?;
        Ok(Self(flag))
    }

    /// Returns true once a signal came.
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Listens for Ctrl-C by the link's runtime, where no other handler is.
#[cfg(not(unix))]
fn listen_by_the_runtime() -> std::io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let listener = move || {
        runtime.block_on(async {
            loop {
                // A failure to listen counts as an interrupt, because ending is the safe choice.
                let _ = tokio::signal::ctrl_c().await;
                interrupt::receive(|| {});
            }
        });
    };
    std::thread::Builder::new()
        .name("stylus-interrupt".to_owned())
        .spawn(listener)
        .map(drop)
}
