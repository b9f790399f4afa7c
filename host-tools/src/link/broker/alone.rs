//! The place of a broker on systems without sockets of files, such as Windows: one command at a time has a device, and
//! the others are refused with its name.

use std::fs::File;
use std::sync::Arc;

use postcard_rpc::host_client::{WireRx, WireTx};

use super::place::Place;
use crate::link::LinkAddress;
use crate::link::error::{LinkError, Result};
use crate::link::health::Health;
use crate::link::open::{self, Ends};
use crate::link::route::Sharing;

/// Opens a link of this program's own, which holds the device's lock as long as it is open.
///
/// # Errors
/// A device that cannot be opened, or that another command has; the error names it.
pub(in crate::link) async fn open<E: Ends>(
    address: &LinkAddress,
    sharing: &Sharing,
    health: &Arc<Health>,
    ends: E,
) -> Result<E::Made> {
    let place = Place::of(address).await?;
    let lock = taken(&place)?;
    place.name_clients(&format!(
        "`stylus {}` (process {})",
        sharing.command,
        std::process::id()
    ));
    open::open(address, health, Locked { ends, lock }).await
}

/// Opens no link, because none is shared.
///
/// # Errors
/// Another command has the device.
pub(in crate::link) async fn join<E: Ends>(
    address: &LinkAddress,
    _command: &str,
    _health: &Arc<Health>,
    _ends: E,
) -> Result<Option<E::Made>> {
    free(address).await.map(|()| None)
}

/// Checks that no other command has the device.
///
/// # Errors
/// One has; the error names it.
pub(in crate::link) async fn free(address: &LinkAddress) -> Result<()> {
    match Place::of(address).await {
        Ok(place) => taken(&place).map(drop),
        // The opening tells what is wrong with the address.
        Err(_) => Ok(()),
    }
}

fn taken(place: &Place) -> Result<File> {
    place.lock()?.ok_or_else(|| LinkError::Held {
        link: place.address.to_string(),
        what: format!(
            "{} has it, and on this system commands do not share a stylus: end that one, then try again",
            place.clients()
        ),
    })
}

/// Ends that hold a lock.
struct Locked<E> {
    ends: E,
    lock: File,
}

impl<E: Ends> Ends for Locked<E> {
    type Made = E::Made;

    fn take(self, sender: impl WireTx, receiver: impl WireRx) -> Self::Made {
        let sender = LockedTx {
            sender,
            _lock: self.lock,
        };
        self.ends.take(sender, receiver)
    }
}

/// A sending end that holds the lock.
struct LockedTx<S> {
    sender: S,
    _lock: File,
}

impl<S: WireTx> WireTx for LockedTx<S> {
    type Error = S::Error;

    async fn send(&mut self, frame: Vec<u8>) -> std::result::Result<(), S::Error> {
        self.sender.send(frame).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ends that are kept open as long as they are there.
    struct Kept;

    impl Ends for Kept {
        type Made = Box<dyn std::any::Any>;

        fn take(self, sender: impl WireTx, receiver: impl WireRx) -> Self::Made {
            Box::new((sender, receiver))
        }
    }

    #[tokio::test]
    async fn a_second_command_is_refused_with_the_name_of_the_first_until_that_ends() {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = format!("tcp:{}", listener.local_addr().unwrap());
        let address: LinkAddress = address.parse().unwrap();
        let sharing = Sharing {
            program: "stylus".into(),
            command: "play".to_owned(),
        };
        let health = Arc::new(Health::default());
        let opened = async || open(&address, &sharing, &health, Kept).await;
        let first = opened().await.unwrap();
        let refused = opened().await.err().unwrap();
        let told = refused.to_string();
        assert!(matches!(refused, LinkError::Held { .. }), "{told}");
        assert!(
            told.contains(&format!("`stylus play` (process {})", std::process::id())),
            "{told}"
        );
        assert!(free(&address).await.is_err());
        assert!(join(&address, "python", &health, Kept).await.is_err());
        drop(first);
        assert!(
            join(&address, "python", &health, Kept)
                .await
                .unwrap()
                .is_none()
        );
        opened().await.unwrap();
    }
}
