//! The place of a broker on systems without sockets of files: every link is direct.
#![expect(
    clippy::unused_async,
    reason = "these are called in the place of functions that wait"
)]

use std::sync::Arc;

use super::LinkAddress;
use super::error::Result;
use super::health::Health;
use super::open::{self, Ends};
use super::route::Sharing;

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
pub(super) async fn join<E: Ends>(
    _address: &LinkAddress,
    _command: &str,
    _health: &Arc<Health>,
    _ends: E,
) -> Result<Option<E::Made>> {
    Ok(None)
}

/// Does nothing, because no broker can be in the way.
pub(super) async fn free(_address: &LinkAddress) -> Result<()> {
    Ok(())
}
