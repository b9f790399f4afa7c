//! Routes to a device: over a link of this program's own, or over a link that programs share.

use std::sync::Arc;

use super::broker::{Hold, Sharing};
use super::error::Result;
use super::health::Health;
use super::open::{AsClient, Client};
use super::{LinkAddress, broker, open};

/// A route to a device. A text is the command that opens the link, which other programs name in their messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Route {
    /// Over a link of this program's own.
    #[default]
    Direct,
    /// Like [`Route::Direct`], after the end of a broker without clients. As long as the device is open, other programs
    /// of this user that share links or want the device exclusively are refused.
    Alone(String),
    /// Over a link that another program of this user shares, if there is one, and otherwise like [`Route::Direct`].
    /// This is for programs that cannot run as a broker.
    Joined(String),
    /// Over a link that other programs of this user share.
    Shared(Sharing),
}

impl Route {
    /// Locks the device for this program only, if this route requires it. On systems without Unix sockets, such as
    /// Windows, no link is shared, so all routes except [`Route::Direct`] require it.
    pub(super) async fn hold(&self, address: &LinkAddress) -> Result<Option<Hold>> {
        let command = match self {
            Self::Alone(command) => command,
            Self::Joined(command) | Self::Shared(Sharing { command, .. }) if !cfg!(unix) => command,
            Self::Direct | Self::Joined(_) | Self::Shared(_) => return Ok(None),
        };
        broker::hold(address, command).await
    }

    /// Opens a link, after [`Route::hold`]. Its two tasks run on the current runtime.
    pub(super) async fn open(&self, address: &LinkAddress, health: &Arc<Health>) -> Result<Client> {
        #[cfg(unix)]
        match self {
            Self::Direct | Self::Alone(_) => {}
            Self::Joined(command) => {
                let joined = broker::join(address, command, health, AsClient).await?;
                if let Some(joined) = joined {
                    return Ok(joined);
                }
            }
            Self::Shared(sharing) => {
                return broker::open(address, sharing, health, AsClient).await;
            }
        }
        open::open(address, health, AsClient).await
    }
}
