//! A stylus on this computer's USB, and the USB of a virtual stylus.
//!
//! The USB host of a virtual stylus is another process at a TCP port, which makes bulk transfers on request. A
//! connection serves one program. Transfers that still wait when it ends are cancelled.

use std::collections::VecDeque;
use std::io;
use std::path::Path;

use model_format::link::{USB_PRODUCT, USB_PRODUCT_ID, USB_VENDOR_ID};
use nusb::descriptors::TransferType;
use nusb::transfer::{Buffer, Bulk, Completion, Direction, In, Out};
use nusb::{DeviceInfo, Endpoint, ErrorKind, Interface};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
pub use virtual_link::usb_messages::{FromBus, MAX_MESSAGE_BYTES, ToBus, encode, take};

use super::error::{LinkError, Result};
use super::holder;
use super::wire::{BulkIn, BulkOut};

/// Class of a vendor-specific interface (USB 2.0 section 9.6.5).
const VENDOR_CLASS: u8 = 0xff;

/// Error code of Linux and Windows for a missing file.
const NO_SUCH_FILE: u32 = 2;

/// Remedy where the operating system denies access to the device.
const PERMISSION_REMEDY: &str = "copy host-tools/70-stylus.rules to /etc/udev/rules.d/, run `sudo udevadm control \
     --reload`, then plug the stylus in again";

/// Opens the stylus with this serial number, or the only one.
pub(super) async fn open(serial: Option<&str>, link: &str) -> Result<(Endpoint<Bulk, Out>, Endpoint<Bulk, In>)> {
    let device = choose(attached(link).await?, serial)?;
    let opened = device.open().await.map_err(|failure| refused(link, &failure))?;
    let interface = device
        .interfaces()
        .find(|interface| interface.class() == VENDOR_CLASS)
        .map_or(0, nusb::InterfaceInfo::interface_number);
    let interface = opened
        .claim_interface(interface)
        .await
        .map_err(|failure| claim_refused(&device, link, &failure))?;
    let address = |direction| {
        bulk_address(&interface, direction).ok_or_else(|| LinkError::Open {
            link: link.to_owned(),
            reason: "it has no bulk endpoints, so it is another device with the same USB id: unplug it".to_owned(),
        })
    };
    let output = interface
        .endpoint::<Bulk, Out>(address(Direction::Out)?)
        .map_err(|failure| refused(link, &failure))?;
    let input = interface
        .endpoint::<Bulk, In>(address(Direction::In)?)
        .map_err(|failure| refused(link, &failure))?;
    Ok((output, input))
}

/// The styluses on USB. A computer without USB has none.
async fn attached(link: &str) -> Result<Vec<DeviceInfo>> {
    let devices = match nusb::list_devices().await {
        Ok(devices) => devices,
        Err(failure) if failure.os_error() == Some(NO_SUCH_FILE) => return Ok(Vec::new()),
        Err(failure) => return Err(refused(link, &failure)),
    };
    let is_stylus = |device: &DeviceInfo| {
        let ids = (device.vendor_id(), device.product_id());
        is_stylus(ids, device.product_string(), device.serial_number())
    };
    Ok(devices.filter(is_stylus).collect())
}

/// Returns true if a device describes itself as a stylus. Its ids are not enough, because all test devices of pid.codes
/// share them. The operating system may not report the texts of a device that the user may not open. Missing texts are
/// not compared.
fn is_stylus(ids: (u16, u16), product: Option<&str>, serial: Option<&str>) -> bool {
    // A stylus's serial number is its chip's 96-bit unique id in hexadecimal.
    let is_id = |serial: &str| serial.len() == 24 && serial.bytes().all(|c| c.is_ascii_hexdigit());
    ids == (USB_VENDOR_ID, USB_PRODUCT_ID)
        && product.is_none_or(|product| product == USB_PRODUCT)
        && serial.is_none_or(is_id)
}

/// Serial numbers of the styluses on USB, where they have one.
pub(super) async fn serial_numbers() -> Result<Vec<Option<String>>> {
    Ok(attached("usb")
        .await?
        .iter()
        .map(DeviceInfo::serial_number)
        .map(|serial| serial.map(str::to_owned))
        .collect())
}

fn choose(mut styluses: Vec<DeviceInfo>, wanted: Option<&str>) -> Result<DeviceInfo> {
    let found = || -> Vec<String> {
        styluses
            .iter()
            .map(DeviceInfo::serial_number)
            .map(|serial| serial.unwrap_or("(no serial number)").to_owned())
            .collect()
    };
    let index = match wanted {
        // A wanted number on an empty bus is a missing stylus, not a wrong number.
        _ if styluses.is_empty() => return Err(LinkError::NoUsbDevice),
        None if styluses.len() == 1 => 0,
        None => return Err(LinkError::SeveralUsbDevices { found: found() }),
        Some(wanted) => {
            let matches = |device: &DeviceInfo| {
                device
                    .serial_number()
                    .is_some_and(|serial| serial.eq_ignore_ascii_case(wanted))
            };
            styluses
                .iter()
                .position(matches)
                .ok_or_else(|| LinkError::NoSuchSerial {
                    wanted: wanted.to_owned(),
                    found: found(),
                })?
        }
    };
    Ok(styluses.swap_remove(index))
}

fn bulk_address(interface: &Interface, direction: Direction) -> Option<u8> {
    let descriptor = interface.descriptor()?;
    let endpoint = descriptor
        .endpoints()
        .find(|endpoint| endpoint.transfer_type() == TransferType::Bulk && endpoint.direction() == direction);
    endpoint.map(|endpoint| endpoint.address())
}

fn refused(link: &str, failure: &nusb::Error) -> LinkError {
    let link = link.to_owned();
    match failure.kind() {
        // Windows denies access to a device that another program has open.
        ErrorKind::PermissionDenied if cfg!(windows) => LinkError::busy(link, None),
        ErrorKind::PermissionDenied => LinkError::Permission {
            link,
            remedy: PERMISSION_REMEDY,
        },
        ErrorKind::Busy => LinkError::busy(link, None),
        _ => LinkError::Open {
            link,
            reason: failure.to_string(),
        },
    }
}

/// Returns the error for an interface that cannot be claimed; if another program has it, with that program.
fn claim_refused(device: &DeviceInfo, link: &str, failure: &nusb::Error) -> LinkError {
    match failure.kind() {
        ErrorKind::Busy => {
            // Linux alone has these files; elsewhere the path does not exist.
            let (bus, number) = (device.bus_id(), device.device_address());
            let file = format!("/dev/bus/usb/{bus}/{number:03}");
            LinkError::busy(link.to_owned(), holder::of_file(Path::new(&file)))
        }
        _ => refused(link, failure),
    }
}

impl BulkOut for Endpoint<Bulk, Out> {
    fn packet_bytes(&self) -> usize {
        self.max_packet_size()
    }

    fn submit(&mut self, data: Vec<u8>) {
        Endpoint::submit(self, Buffer::from(data));
    }

    fn pending(&self) -> usize {
        Endpoint::pending(self)
    }

    async fn next(&mut self) -> io::Result<()> {
        let Completion { status, .. } = self.next_complete().await;
        Ok(status?)
    }

    async fn clear_halt(&mut self) -> io::Result<()> {
        Ok(Endpoint::clear_halt(self).await?)
    }
}

impl BulkIn for Endpoint<Bulk, In> {
    fn packet_bytes(&self) -> usize {
        self.max_packet_size()
    }

    fn submit(&mut self, bytes: usize) {
        let buffer = self.allocate(bytes);
        Endpoint::submit(self, buffer);
    }

    async fn next(&mut self) -> io::Result<Vec<u8>> {
        let Completion { buffer, status, .. } = self.next_complete().await;
        status?;
        Ok(buffer.to_vec())
    }

    async fn clear_halt(&mut self) -> io::Result<()> {
        Ok(Endpoint::clear_halt(self).await?)
    }
}

/// Longest packet of a bulk endpoint at full speed (USB 2.0 section 5.8.3).
const PACKET_BYTES: usize = 64;

/// The endpoint to the device.
pub(super) struct VirtualOut {
    to_bus: UnboundedSender<ToBus>,
    ended: UnboundedReceiver<std::result::Result<(), String>>,
    cleared: UnboundedReceiver<std::result::Result<(), String>>,
    pending: usize,
}

/// The endpoint from the device.
pub(super) struct VirtualIn {
    to_bus: UnboundedSender<ToBus>,
    ended: UnboundedReceiver<std::result::Result<Vec<u8>, String>>,
    cleared: UnboundedReceiver<std::result::Result<(), String>>,
}

/// Returns the endpoints of the device whose USB host is at the other end of `stream`. Two tasks on the current runtime
/// carry the messages.
pub(super) fn open_virtual(stream: TcpStream) -> (VirtualOut, VirtualIn) {
    let (mut reader, mut writer) = stream.into_split();
    let (to_bus, mut outgoing) = unbounded_channel::<ToBus>();
    let (out_ended, out_ends) = unbounded_channel();
    let (in_ended, in_ends) = unbounded_channel();
    let (out_cleared, out_clears) = unbounded_channel();
    let (in_cleared, in_clears) = unbounded_channel();
    tokio::spawn(async move {
        while let Some(message) = outgoing.recv().await {
            if writer.write_all(&encode(&message)).await.is_err() {
                return;
            }
        }
    });
    // The end of the connection drops the senders, which ends every wait for an answer.
    tokio::spawn(async move {
        let (mut bytes, mut buffer) = (VecDeque::new(), [0; 4096]);
        loop {
            match reader.read(&mut buffer).await {
                Ok(count) if count > 0 => bytes.extend(&buffer[..count]),
                _ => return,
            }
            // A read may hold several messages, and the begin of another.
            while let Ok(Some(message)) = take(&mut bytes) {
                // An endpoint that was dropped needs no answer.
                let _ = match message {
                    FromBus::Out(ended) => out_ended.send(ended).is_ok(),
                    FromBus::In(ended) => in_ended.send(ended).is_ok(),
                    FromBus::ClearedOut(cleared) => out_cleared.send(cleared).is_ok(),
                    FromBus::ClearedIn(cleared) => in_cleared.send(cleared).is_ok(),
                };
            }
        }
    });
    let output = VirtualOut {
        to_bus: to_bus.clone(),
        ended: out_ends,
        cleared: out_clears,
        pending: 0,
    };
    let input = VirtualIn {
        to_bus,
        ended: in_ends,
        cleared: in_clears,
    };
    (output, input)
}

async fn outcome<T: Send>(ends: &mut UnboundedReceiver<std::result::Result<T, String>>) -> io::Result<T> {
    match ends.recv().await {
        Some(ended) => ended.map_err(io::Error::other),
        None => Err(io::Error::new(
            io::ErrorKind::UnexpectedEof,
            "the virtual stylus closed the connection",
        )),
    }
}

impl BulkOut for VirtualOut {
    fn packet_bytes(&self) -> usize {
        PACKET_BYTES
    }

    fn submit(&mut self, data: Vec<u8>) {
        self.pending += 1;
        // `next` reports a connection that has ended.
        let _ = self.to_bus.send(ToBus::Out(data));
    }

    fn pending(&self) -> usize {
        self.pending
    }

    async fn next(&mut self) -> io::Result<()> {
        self.pending -= 1;
        outcome(&mut self.ended).await
    }

    async fn clear_halt(&mut self) -> io::Result<()> {
        let _ = self.to_bus.send(ToBus::ClearOut);
        outcome(&mut self.cleared).await
    }
}

impl BulkIn for VirtualIn {
    fn packet_bytes(&self) -> usize {
        PACKET_BYTES
    }

    fn submit(&mut self, bytes: usize) {
        let _ = self.to_bus.send(ToBus::In(bytes as u32));
    }

    async fn next(&mut self) -> io::Result<Vec<u8>> {
        outcome(&mut self.ended).await
    }

    async fn clear_halt(&mut self) -> io::Result<()> {
        let _ = self.to_bus.send(ToBus::ClearIn);
        outcome(&mut self.cleared).await
    }
}
