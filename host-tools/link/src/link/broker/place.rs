//! The socket and the lock of a device, in the user's runtime folder.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::net::ToSocketAddrs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use model_format::link::SCHEMA_HASH;
use virtual_link::runtime_folder;

use crate::link::error::{LinkError, Result};
use crate::link::{LinkAddress, usb};
use crate::support::fnv::Fnv;

/// Version of the messages. The socket's name depends on it and on the hash of the link's messages. The lock's name is
/// the same for all versions.
const VERSION: u16 = 2;

/// Prefix of the text in a lock whose holder does not share the device.
const ALONE: &str = "alone: ";

/// Time that a program waits for another one that has the device exclusively. A short command ends within this time.
const PATIENCE: Duration = Duration::from_millis(300);

/// Remedy if no broker can be used.
const REMEDY: &str = "--no-broker opens the device without sharing it";

/// The files of a device's broker, or of the program that has the device exclusively.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// The device's address in a canonical form, however the user has written it; a host stays as it is written.
    pub(super) address: LinkAddress,
    /// The socket.
    pub(super) socket: PathBuf,
    /// The lock file. The broker, or a program that has the device exclusively, holds the lock as long as it runs. The
    /// file names the programs that use the device.
    lock: PathBuf,
}

impl Place {
    /// Returns the files of the broker of `address`.
    ///
    /// # Errors
    /// No such device on USB, or several if none is named; a runtime folder that cannot be made or that others might
    /// write to.
    pub(super) async fn of(address: &LinkAddress) -> Result<Self> {
        let address = canonical(address).await?;
        let folder = runtime_folder::own().map_err(|failure| unusable(&address, &failure))?;
        Ok(Self::within(&folder, address))
    }

    fn within(folder: &Path, address: LinkAddress) -> Self {
        // Names are hashes, because a socket's path has at most 104 bytes on some systems, and the path of a serial
        // port may be longer.
        let hashed = |text: &str| format!("link-{:016x}", Fnv::of(text.as_bytes()));
        let name = with_lowest_ip(address.clone()).to_string();
        let versions = format!("{name} {VERSION} {SCHEMA_HASH:016x}");
        Self {
            socket: folder.join(format!("{}.sock", hashed(&versions))),
            lock: folder.join(format!("{}.lock", hashed(&name))),
            address,
        }
    }

    /// The clients of the broker that holds the lock, in words.
    pub(super) fn clients(&self) -> String {
        let clients = fs::read_to_string(self.names()).unwrap_or_default();
        match clients.trim() {
            "" => "another command".to_owned(),
            clients => clients.to_owned(),
        }
    }

    /// Names the clients in the lock.
    pub(super) fn name_clients(&self, clients: &str) {
        // A failure is ignored, because only a message uses the names.
        let _ = fs::write(self.names(), clients);
    }

    /// Writes into the lock file the name of this program, which has the device exclusively.
    pub(super) fn name_alone(&self, command: &str) {
        let process = std::process::id();
        self.name_clients(&format!("{ALONE}`stylus {command}` (process {process})"));
    }

    /// Returns true while another program has the device exclusively.
    ///
    /// # Errors
    /// The program still has the device some time after `begin`. The error names the program.
    pub(super) fn is_held_alone(&self, begin: Instant) -> Result<bool> {
        let names = fs::read_to_string(self.names()).unwrap_or_default();
        let Some(program) = names.strip_prefix(ALONE) else {
            return Ok(false);
        };
        // A program that has ended leaves its name in the file, but no longer holds the lock.
        if self.lock()?.is_some() {
            return Ok(false);
        }
        if begin.elapsed() < PATIENCE {
            return Ok(true);
        }
        Err(LinkError::Held {
            link: self.address.to_string(),
            what: format!("{program} has it alone: wait for its end, or end it with Ctrl-C"),
        })
    }

    /// Returns the file that names the clients. It is the lock file itself where other programs can read a locked file.
    fn names(&self) -> PathBuf {
        if cfg!(unix) {
            self.lock.clone()
        } else {
            self.lock.with_extension("txt")
        }
    }

    /// Locks the lock file, or returns `None` if another program has the lock. The system frees the lock after a crash.
    /// A held lock therefore shows that a program still runs, which the socket does not show.
    ///
    /// # Errors
    /// A file that cannot be made or locked.
    pub(super) fn lock(&self) -> Result<Option<File>> {
        let failed = |failure: io::Error| unusable(&self.address, &failure);
        let mut options = OpenOptions::new();
        options.create(true).truncate(false).write(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let file = options.open(&self.lock).map_err(failed)?;
        // The file is never removed: two programs could then hold the locks of two files of the same name.
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(failure)) => Err(failed(failure)),
        }
    }
}

/// Returns the error for a broker that cannot be used.
pub(super) fn unusable(address: &LinkAddress, reason: &impl ToString) -> LinkError {
    LinkError::Open {
        link: address.to_string(),
        reason: format!("it cannot be shared: {}: {REMEDY}", reason.to_string()),
    }
}

/// Returns `address` with the lowest of its host's IP addresses, so that `localhost` and 127.0.0.1 have the same files.
///
/// The link is not opened there, because a device may listen at another one of them.
fn with_lowest_ip(mut address: LinkAddress) -> LinkAddress {
    if let LinkAddress::Tcp { host, port } | LinkAddress::UsbVirtual { host, port } = &mut address
        // A host that cannot be resolved stays as it is. Opening the link will report why.
        && let Ok(found) = (host.as_str(), *port).to_socket_addrs()
        && let Some(lowest) = found.map(|found| found.ip()).min()
    {
        *host = lowest.to_string();
    }
    address
}

/// Returns the canonical form of the address of a device on USB or at a serial port, which all ways of writing it have
/// in common.
async fn canonical(address: &LinkAddress) -> Result<LinkAddress> {
    Ok(match address {
        LinkAddress::Usb { serial } => LinkAddress::Usb {
            serial: usb::serial_number(serial.as_deref(), &address.to_string())
                .await?
                // The operating system may hide the number of a device that this user may not open.
                .or_else(|| serial.clone()),
        },
        LinkAddress::Serial { path } => LinkAddress::Serial {
            path: path.canonicalize().unwrap_or_else(|_| path.clone()),
        },
        LinkAddress::Tcp { .. } | LinkAddress::UsbVirtual { .. } => address.clone(),
    })
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_device_has_one_place_however_it_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("port");
        std::fs::write(&port, "").unwrap();
        let name = folder.path().join("by-id");
        std::os::unix::fs::symlink(&port, &name).unwrap();
        let serial = |path: &Path| LinkAddress::Serial { path: path.into() };
        let place = async |address: LinkAddress| {
            Place::within(folder.path(), canonical(&address).await.unwrap())
        };
        assert_eq!(place(serial(&port)).await, place(serial(&name)).await);
        let other = folder.path().join("other");
        assert_ne!(place(serial(&port)).await, place(serial(&other)).await);
        let parsed = |text: &str| text.parse::<LinkAddress>().unwrap();
        let one = place(parsed("tcp:127.0.0.1:4000")).await;
        assert_ne!(one, place(parsed("usb-virtual:127.0.0.1:4000")).await);
        assert_ne!(one, place(parsed("tcp:127.0.0.1:4001")).await);
        // A name whose first address is another one leads to the same files, and is opened by name.
        let named = place(parsed("tcp:localhost:4000")).await;
        assert_eq!((&named.socket, &named.lock), (&one.socket, &one.lock));
        assert_eq!(named.address, parsed("tcp:localhost:4000"));
    }

    #[test]
    fn a_lock_is_held_once_and_is_free_after_its_holder() {
        let folder = tempfile::tempdir().unwrap();
        let address: LinkAddress = "tcp:127.0.0.1:4000".parse().unwrap();
        let place = Place::within(folder.path(), address);
        let held = place.lock().unwrap();
        assert!(held.is_some());
        assert!(place.lock().unwrap().is_none());
        drop(held);
        assert!(place.lock().unwrap().is_some());
    }
}
