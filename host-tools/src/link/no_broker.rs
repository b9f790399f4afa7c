//! The place of a broker on systems without sockets of files: every link is direct.

use std::sync::Arc;

use super::LinkAddress;
use super::error::{LinkError, Result};
use super::health::Health;
use super::open::{self, Ends};
use super::route::Sharing;

/// End of a broker, which there is none of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Served {
    /// It has ended.
    Ended,
    /// Another one serves the device.
    Taken,
}

/// Refuses to share a link.
///
/// # Errors
/// Always.
pub fn serve(address: &LinkAddress, _ready: impl FnOnce()) -> Result<Served> {
    Err(LinkError::Open {
        link: address.to_string(),
        reason: "links are not shared on this system: leave the command out".to_owned(),
    })
}

/// Opens a link of this program's own.
///
/// # Errors
/// A link that cannot be opened.
pub(super) async fn open<E: Ends>(
    address: &LinkAddress,
    _sharing: &Sharing,
    health: &Arc<Health>,
    ends: E,
) -> Result<E::Made> {
    open::open(address, health, ends).await
}

/// Finds no link that is shared.
///
/// # Errors
/// Never.
#[expect(
    clippy::unused_async,
    reason = "it is called in the place of one that waits"
)]
pub(super) async fn join<E: Ends>(
    _address: &LinkAddress,
    _command: &str,
    _health: &Arc<Health>,
    _ends: E,
) -> Result<Option<E::Made>> {
    Ok(None)
}

/// Does nothing, because no broker can be in the way.
///
/// # Errors
/// Never.
#[expect(
    clippy::unused_async,
    reason = "it is called in the place of one that waits"
)]
pub(super) async fn leave(_address: &LinkAddress, _sharing: &Sharing) -> Result<()> {
    Ok(())
}
