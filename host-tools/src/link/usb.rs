//! Frames as USB bulk transfers: a frame ends with a packet that is not full, or an empty one.

use std::io;
use std::sync::Arc;

use model_format::link::{MAX_DEVICE_FRAME_BYTES, USB_PRODUCT_ID, USB_VENDOR_ID};
use nusb::descriptors::TransferType;
use nusb::transfer::{Buffer, Bulk, Completion, Direction, In, Out};
use nusb::{DeviceInfo, Endpoint, ErrorKind, Interface};
use postcard_rpc::host_client::{WireRx, WireTx};

use super::error::{LinkError, Result};
use super::wire::Health;

/// Class of an interface that no standard describes (USB 2.0 section 9.6.5).
const VENDOR_CLASS: u8 = 0xff;

/// Transfers that wait for the device at any time, so that none of its frames waits for us.
const WAITING_TRANSFERS: usize = 8;

/// What Linux and Windows call a file that is not there.
const NO_SUCH_FILE: u32 = 2;

/// What to do where the system keeps the device from the user.
const PERMISSION_REMEDY: &str = "copy host-tools/70-stylus.rules to /etc/udev/rules.d/, run `sudo udevadm control --reload`, then plug \
     the stylus in again";

/// Opens the stylus with this serial number, or the only one.
pub(super) async fn open(
    serial: Option<&str>,
    link: &str,
    health: &Arc<Health>,
) -> Result<(UsbTx, UsbRx)> {
    let devices = nusb::list_devices()
        .await
        .map_err(|failure| match failure.os_error() {
            // A system without any USB has no list of devices.
            Some(NO_SUCH_FILE) => LinkError::NoUsbDevice,
            _ => refused(link, &failure),
        })?;
    let styluses = devices.filter(|device| {
        (device.vendor_id(), device.product_id()) == (USB_VENDOR_ID, USB_PRODUCT_ID)
    });
    let device = choose(styluses.collect(), serial)?;
    let opened = device
        .open()
        .await
        .map_err(|failure| refused(link, &failure))?;
    let interface = device
        .interfaces()
        .find(|interface| interface.class() == VENDOR_CLASS)
        .map_or(0, nusb::InterfaceInfo::interface_number);
    let interface = opened
        .claim_interface(interface)
        .await
        .map_err(|failure| refused(link, &failure))?;
    let address = |direction| {
        bulk_address(&interface, direction).ok_or_else(|| LinkError::Open {
            link: link.to_owned(),
            reason: "it has no bulk endpoints: it is another device with the same USB id"
                .to_owned(),
        })
    };
    let output = interface
        .endpoint::<Bulk, Out>(address(Direction::Out)?)
        .map_err(|failure| refused(link, &failure))?;
    let input = interface
        .endpoint::<Bulk, In>(address(Direction::In)?)
        .map_err(|failure| refused(link, &failure))?;
    Ok((
        UsbTx {
            endpoint: output,
            health: health.clone(),
        },
        UsbRx::new(input, health.clone()),
    ))
}

fn choose(mut styluses: Vec<DeviceInfo>, wanted: Option<&str>) -> Result<DeviceInfo> {
    let found = || -> Vec<String> {
        let serials = styluses.iter().map(DeviceInfo::serial_number);
        serials
            .map(|serial| serial.unwrap_or("(without)").to_owned())
            .collect()
    };
    let index = match wanted {
        _ if styluses.is_empty() => return Err(LinkError::NoUsbDevice),
        None if styluses.len() == 1 => 0,
        None => return Err(LinkError::SeveralUsbDevices { found: found() }),
        Some(wanted) => {
            let matches = |device: &DeviceInfo| {
                device
                    .serial_number()
                    .is_some_and(|serial| serial.eq_ignore_ascii_case(wanted))
            };
            let index = styluses.iter().position(matches);
            index.ok_or_else(|| LinkError::NoSuchSerial {
                wanted: wanted.to_owned(),
                found: found(),
            })?
        }
    };
    Ok(styluses.swap_remove(index))
}

fn bulk_address(interface: &Interface, direction: Direction) -> Option<u8> {
    let descriptor = interface.descriptor()?;
    let endpoint = descriptor.endpoints().find(|endpoint| {
        endpoint.transfer_type() == TransferType::Bulk && endpoint.direction() == direction
    });
    endpoint.map(|endpoint| endpoint.address())
}

fn refused(link: &str, failure: &nusb::Error) -> LinkError {
    let link = link.to_owned();
    match failure.kind() {
        ErrorKind::PermissionDenied => LinkError::Permission {
            link,
            remedy: PERMISSION_REMEDY,
        },
        ErrorKind::Busy => LinkError::Busy { link },
        _ => LinkError::Open {
            link,
            reason: failure.to_string(),
        },
    }
}

/// The sending end.
pub(super) struct UsbTx {
    endpoint: Endpoint<Bulk, Out>,
    health: Arc<Health>,
}

impl WireTx for UsbTx {
    type Error = io::Error;

    async fn send(&mut self, frame: Vec<u8>) -> io::Result<()> {
        let is_full = frame.len().is_multiple_of(self.endpoint.max_packet_size());
        self.endpoint.submit(Buffer::from(frame));
        if is_full {
            self.endpoint.submit(Buffer::new(0));
        }
        while self.endpoint.pending() > 0 {
            let Completion { status, .. } = self.endpoint.next_complete().await;
            status.inspect_err(|failure| self.health.end(failure))?;
        }
        Ok(())
    }
}

/// The receiving end.
pub(super) struct UsbRx {
    endpoint: Endpoint<Bulk, In>,
    health: Arc<Health>,
}

impl UsbRx {
    fn new(mut endpoint: Endpoint<Bulk, In>, health: Arc<Health>) -> Self {
        // A transfer takes whole packets.
        let packet = endpoint.max_packet_size();
        let length = MAX_DEVICE_FRAME_BYTES.next_multiple_of(packet);
        for _ in 0..WAITING_TRANSFERS {
            let buffer = endpoint.allocate(length);
            endpoint.submit(buffer);
        }
        Self { endpoint, health }
    }
}

impl WireRx for UsbRx {
    type Error = io::Error;

    async fn receive(&mut self) -> io::Result<Vec<u8>> {
        loop {
            let Completion { buffer, status, .. } = self.endpoint.next_complete().await;
            status.inspect_err(|failure| self.health.end(failure))?;
            let frame = buffer.to_vec();
            let mut next = buffer;
            next.clear();
            self.endpoint.submit(next);
            if !frame.is_empty() {
                return Ok(frame);
            }
        }
    }
}
