//! Routes to a device: over a link of one's own, or over one that programs share.

use std::sync::Arc;

use super::broker::{Hold, Sharing};
use super::error::Result;
use super::health::Health;
use super::open::{AsClient, Client};
use super::{LinkAddress, broker, open};

/// A route to a device. A text names the command that opens the link, for others that want to know.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Route {
    /// Over a link of one's own.
    #[default]
    Direct,
    /// As [`Route::Direct`], after the end of a broker that nobody uses. The programs of this user that share links, or
    /// want one alone, are refused until the end of this one.
    Alone(String),
    /// Over a link that another program of this user shares, if one does, and else as [`Route::Direct`]: for programs
    /// that are no broker themselves.
    Joined(String),
    /// Over a link that other programs of this user share.
    Shared(Sharing),
}

impl Route {
    /// Locks the device for this program alone, if this route wants that. On systems without sockets of files, such as
    /// Windows, no link is shared, so that all routes but [`Route::Direct`] want it.
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
