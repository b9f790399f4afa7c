//! Routes to a device: over a link of one's own, or over one that programs share.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;

use super::error::Result;
use super::health::Health;
use super::open::{AsClient, Client};
use super::{LinkAddress, broker, open};

/// A route to a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Route {
    /// Over a link of one's own, which no other program can open meanwhile.
    #[default]
    Direct,
    /// As [`Route::Direct`], after the end of a broker that nobody uses.
    Alone,
    /// Over a link that another program of this user shares, if one does, and else as [`Route::Direct`]: for programs
    /// that are no broker themselves. The text names what opens the link, for others that want to know.
    Joined(String),
    /// Over a link that other programs of this user share. On systems without sockets of files, such as Windows, over
    /// one of its own, which is refused while another program has one.
    Shared(Sharing),
}

impl Route {
    /// Opens a link. Its two tasks run on the current runtime.
    pub(super) async fn open(&self, address: &LinkAddress, health: &Arc<Health>) -> Result<Client> {
        match self {
            Self::Direct => {}
            Self::Alone => broker::free(address).await?,
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

/// Line that a broker prints once clients may come.
pub const BROKER_READY: &str = "ready";

/// Line that a broker prints if another one serves the device.
pub const BROKER_TAKEN: &str = "taken";

/// Name of the command that is a broker.
pub const BROKER_COMMAND: &str = "share-link";

/// A program that shares the links that it opens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sharing {
    /// The `stylus` program, which is started as a broker where there is none.
    pub program: PathBuf,
    /// The command that opens the link, for others that want to know who does.
    pub command: String,
}

impl Sharing {
    /// The arguments with which the program is a broker of `address`.
    pub fn arguments(&self, address: &LinkAddress) -> [OsString; 3] {
        [
            BROKER_COMMAND.into(),
            "--link".into(),
            address.to_string().into(),
        ]
    }
}
