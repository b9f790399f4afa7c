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

/// Version of the messages, which stands in the socket's name with the version of the device's protocol. The lock is
/// the same for all versions.
const VERSION: u16 = 2;

/// Begin of the words in a lock whose holder does not share the device.
const ALONE: &str = "alone: ";

/// Time that a program waits for the end of another that has the device alone: that of a short command.
const PATIENCE: Duration = Duration::from_millis(300);

/// Remedy where no broker can be had.
const REMEDY: &str = "--no-broker opens the device without sharing it";

/// The place of a device's broker, or of the program that has the device alone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// The device's address, the same whichever way the user has written it.
    pub(super) address: LinkAddress,
    /// The socket.
    pub(super) socket: PathBuf,
    /// The lock, which the broker, or a program that has the device alone, holds as long as it lives, and which names
    /// the programs.
    lock: PathBuf,
}

impl Place {
    /// The place of the broker of `address`.
    ///
    /// # Errors
    /// No such device on USB, or a runtime folder that others might write to.
    pub(super) async fn of(address: &LinkAddress) -> Result<Self> {
        let address = canonical(address).await?;
        let folder = runtime_folder::own().map_err(|failure| unusable(&address, &failure))?;
        Ok(Self::within(&folder, address))
    }

    fn within(folder: &Path, address: LinkAddress) -> Self {
        // Hashes, because a socket's path has at most 104 bytes on some systems, and a serial port's may be longer.
        let hashed = |text: &str| format!("link-{:016x}", Fnv::of(text.as_bytes()));
        let name = address.to_string();
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
        // It serves a message alone.
        let _ = fs::write(self.names(), clients);
    }

    /// Names in the lock the program that has the device alone.
    pub(super) fn name_alone(&self, command: &str) {
        let process = std::process::id();
        self.name_clients(&format!("{ALONE}`stylus {command}` (process {process})"));
    }

    /// Returns true while another program has the device alone.
    ///
    /// # Errors
    /// It still has the device some time after `begin`; the error names it.
    pub(super) fn is_held_alone(&self, begin: Instant) -> Result<bool> {
        let names = fs::read_to_string(self.names()).unwrap_or_default();
        let Some(program) = names.strip_prefix(ALONE) else {
            return Ok(false);
        };
        // A program that has ended leaves its name, and no lock.
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

    /// The file that names the clients: the lock, where a lock does not keep others from reading it.
    fn names(&self) -> PathBuf {
        if cfg!(unix) {
            self.lock.clone()
        } else {
            self.lock.with_extension("txt")
        }
    }

    /// Locks the lock file, or returns `None` if another program has the lock. A crash frees the lock, so that it tells
    /// of a program that lives, which the socket does not.
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
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(failure)) => Err(failed(failure)),
        }
    }
}

/// An error for a broker that cannot be had.
pub(super) fn unusable(address: &LinkAddress, reason: &impl ToString) -> LinkError {
    LinkError::Open {
        link: address.to_string(),
        reason: format!("it cannot be shared: {}: {REMEDY}", reason.to_string()),
    }
}

/// The address of a device that all ways of writing it have in common.
async fn canonical(address: &LinkAddress) -> Result<LinkAddress> {
    // What cannot be resolved is left to the opening, which says why.
    let resolved = |host: &str, port: u16| {
        let found = (host, port).to_socket_addrs().ok()?.next()?;
        Some(found.ip().to_string())
    };
    Ok(match address {
        LinkAddress::Usb { serial } => LinkAddress::Usb {
            serial: usb::serial_number(serial.as_deref(), &address.to_string())
                .await?
                .or_else(|| serial.clone()),
        },
        LinkAddress::Serial { path } => LinkAddress::Serial {
            path: path.canonicalize().unwrap_or_else(|_| path.clone()),
        },
        LinkAddress::Tcp { host, port } => LinkAddress::Tcp {
            host: resolved(host, *port).unwrap_or_else(|| host.clone()),
            port: *port,
        },
        LinkAddress::UsbVirtual { host, port } => LinkAddress::UsbVirtual {
            host: resolved(host, *port).unwrap_or_else(|| host.clone()),
            port: *port,
        },
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
