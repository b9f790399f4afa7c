//! Links to attached devices: on USB, behind the serial ports of probes, and those of virtual styluses; and the opening
//! of one by its address.

use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use model_format::link::SERIAL_BAUD;
use postcard_rpc::header::VarSeqKind;
use postcard_rpc::host_client::{HostClient, WireRx, WireTx};
use postcard_rpc::standard_icd::{ERROR_PATH, WireError};
use tokio::net::TcpStream;
use tokio_serial::{SerialPortBuilderExt, SerialPortType, SerialStream, UsbPortInfo};
use virtual_link::announcement;

use super::error::{LinkError, Result};
use super::wire::{BulkIn, BulkOut, CobsRx, CobsTx, Health, Spawn, open_bulk};
use super::{LinkAddress, holder, usb};

/// Timeout of a TCP connection.
const TCP_TIMEOUT: Duration = Duration::from_secs(3);

/// Capacity of the queue of frames to send. It is short, because a frame that waits is late.
const OUTGOING_FRAMES: usize = 4;

/// Remedy where the operating system denies access to a serial port.
const SERIAL_REMEDY: &str = "add yourself to the port's group (often dialout: `sudo usermod -aG dialout $USER`) and \
     log in again";

/// Client of one device.
pub(super) type Client = HostClient<WireError>;

/// Opens a link. The client's two tasks run on the current runtime.
pub(super) async fn open(address: &LinkAddress, health: &Arc<Health>) -> Result<Client> {
    let link = address.to_string();
    match address {
        LinkAddress::Usb { serial } => {
            let (output, input) = usb::open(serial.as_deref(), &link).await?;
            transfers(output, input, &link, health).await
        }
        LinkAddress::UsbVirtual { host, port } => {
            let (output, input) = usb::open_virtual(tcp(host, *port, &link).await?);
            transfers(output, input, &link, health).await
        }
        LinkAddress::Serial { path } => {
            let (reader, writer) = tokio::io::split(serial(path, &link)?);
            stream(reader, writer, &link, health).await
        }
        LinkAddress::Tcp { host, port } => {
            let (reader, writer) = tcp(host, *port, &link).await?.into_split();
            stream(reader, writer, &link, health).await
        }
    }
}

/// Adds to the failure of a link that was just opened which program has the link, and which links are beside it.
///
/// A virtual stylus serves the program that came first, and ends the connection of any other one before an answer.
pub(super) async fn explained(failure: LinkError, address: &LinkAddress) -> LinkError {
    let failure = match (failure, address) {
        (
            LinkError::Lost { link, reason },
            LinkAddress::Tcp { host, port } | LinkAddress::UsbVirtual { host, port },
        ) => {
            let found = tokio::net::lookup_host((host.as_str(), *port)).await;
            let ports: Vec<_> = found.into_iter().flatten().collect();
            match holder::of_ports(&ports) {
                Some(holder) => LinkError::busy(link, Some(holder)),
                None => LinkError::Lost {
                    link,
                    reason: format!("{reason}, before any answer: another program may have it"),
                },
            }
        }
        (failure, _) => failure,
    };
    match failure {
        LinkError::Busy { link, holder, .. } => {
            let others = beside(address).await.iter().map(ToString::to_string).collect();
            LinkError::Busy { link, holder, others }
        }
        failure => failure,
    }
}

/// Returns a client with sequence numbers of two bytes, so that a late answer cannot be mistaken for the answer to a
/// later request.
fn client(sender: impl WireTx, receiver: impl WireRx) -> Client {
    Client::new_with_wire(sender, receiver, Spawn, VarSeqKind::Seq2, ERROR_PATH, OUTGOING_FRAMES)
}

async fn transfers(output: impl BulkOut, input: impl BulkIn, link: &str, health: &Arc<Health>) -> Result<Client> {
    let opened = open_bulk(output, input, health).await;
    let (sender, receiver) = opened.map_err(|failure| LinkError::Lost {
        link: link.to_owned(),
        reason: failure.to_string(),
    })?;
    Ok(client(sender, receiver))
}

async fn stream<R, W>(reader: R, writer: W, link: &str, health: &Arc<Health>) -> Result<Client>
where
    R: tokio::io::AsyncRead + Send + Unpin + 'static,
    W: tokio::io::AsyncWrite + Send + Unpin + 'static,
{
    let sender = CobsTx::open(writer, health.clone())
        .await
        .map_err(|failure| LinkError::Lost {
            link: link.to_owned(),
            reason: failure.to_string(),
        })?;
    Ok(client(sender, CobsRx::new(reader, health.clone())))
}

async fn tcp(host: &str, port: u16, link: &str) -> Result<TcpStream> {
    let failed = |reason: String| LinkError::Open {
        link: link.to_owned(),
        reason,
    };
    let stream = match tokio::time::timeout(TCP_TIMEOUT, TcpStream::connect((host, port))).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(failure)) if failure.kind() == ErrorKind::ConnectionRefused => {
            return Err(failed(
                "nothing listens there: start the virtual stylus, or check the port".to_owned(),
            ));
        }
        Ok(Err(failure)) => return Err(failed(failure.to_string())),
        Err(_) => {
            return Err(failed(format!(
                "no connection within {} s: check host and port",
                TCP_TIMEOUT.as_secs()
            )));
        }
    };
    // Nagle's algorithm is switched off, because it would make a motion wait for further data.
    stream
        .set_nodelay(true)
        .map_err(|failure| failed(failure.to_string()))?;
    Ok(stream)
}

fn serial(path: &Path, link: &str) -> Result<SerialStream> {
    let link = link.to_owned();
    tokio_serial::new(path.to_string_lossy(), SERIAL_BAUD)
        .open_native_async()
        .map_err(|failure| match failure.kind() {
            // Windows denies access to a port that another program has open.
            tokio_serial::ErrorKind::Io(ErrorKind::PermissionDenied) if cfg!(windows) => LinkError::busy(link, None),
            tokio_serial::ErrorKind::Io(ErrorKind::PermissionDenied) => LinkError::Permission {
                link,
                remedy: SERIAL_REMEDY,
            },
            tokio_serial::ErrorKind::Io(ErrorKind::NotFound) => LinkError::Open {
                link,
                reason: "there is no such port: plug the board's debug port in, and look up which port appears"
                    .to_owned(),
            },
            // The crate reports `NoDevice` for a port that another program has open exclusively or has locked. Root may
            // open an exclusive port, but not lock it a second time.
            tokio_serial::ErrorKind::NoDevice if path.exists() => LinkError::busy(link, holder::of_file(path)),
            _ => LinkError::Open {
                link,
                reason: format!("{failure}: is it a serial port?"),
            },
        })
}

/// USB vendor id of the ST-LINK probes: STMicroelectronics.
const ST_LINK_VENDOR_ID: u16 = 0x0483;

/// USB product ids of the ST-LINK probes with a serial port: V2-1, V3 and their variants.
const ST_LINK_PRODUCT_IDS: [u16; 8] = [0x374a, 0x374b, 0x374e, 0x374f, 0x3752, 0x3753, 0x3754, 0x3757];

/// Returns the links on USB.
pub(super) async fn on_usb() -> Result<Vec<LinkAddress>> {
    Ok(usb::serial_numbers()
        .await?
        .into_iter()
        .map(|serial| LinkAddress::Usb { serial })
        .collect())
}

/// Returns the serial ports behind USB, with their names.
pub(super) fn serial_ports() -> Vec<(String, UsbPortInfo)> {
    // The crate for serial ports panics without this folder.
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let mut ports: Vec<(String, UsbPortInfo)> = tokio_serial::available_ports()
        .unwrap_or_default()
        .into_iter()
        .filter_map(|port| match port.port_type {
            SerialPortType::UsbPort(info) => Some((port.port_name, info)),
            _ => None,
        })
        .collect();
    ports.sort_by(|one, other| one.0.cmp(&other.0));
    ports
}

/// Returns true if a serial port is that of an ST-LINK, which a stylus's board has.
pub(super) fn is_st_link(port: &UsbPortInfo) -> bool {
    port.vid == ST_LINK_VENDOR_ID && ST_LINK_PRODUCT_IDS.contains(&port.pid)
}

/// Returns the links of each virtual stylus that runs.
pub(super) fn of_virtual_ones() -> Vec<Vec<LinkAddress>> {
    let announced = announcement::announced().into_iter();
    let parsed = |links: Vec<String>| links.iter().filter_map(|link| link.parse().ok()).collect();
    announced.map(|one| parsed(one.links)).collect()
}

/// Returns the links that may lead to the same device as `link`: those of the same virtual stylus, or the other ports
/// of boards.
pub(super) async fn beside(link: &LinkAddress) -> Vec<LinkAddress> {
    match link {
        LinkAddress::Usb { .. } => {
            let probes = serial_ports().into_iter().filter(|(_, info)| is_st_link(info));
            let link = |path: String| LinkAddress::Serial { path: path.into() };
            probes.map(|(path, _)| link(path)).collect()
        }
        // A computer that does not list its USB devices has none to name.
        LinkAddress::Serial { .. } => on_usb().await.unwrap_or_default(),
        LinkAddress::Tcp { .. } | LinkAddress::UsbVirtual { .. } => {
            let mut ones = of_virtual_ones().into_iter();
            ones.find(|links| links.iter().any(|one| one.is_of_same_port(link)))
                .into_iter()
                .flatten()
                .filter(|one| !one.is_of_same_port(link))
                .collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_board_that_the_udev_rule_names_has_a_probe() {
        let rules = include_str!("../../../70-stylus.rules");
        assert!(rules.contains("ATTRS{idVendor}==\"0483\", ATTRS{idProduct}==\"374e\""));
        let port = |vid, pid| UsbPortInfo {
            vid,
            pid,
            serial_number: None,
            manufacturer: None,
            product: None,
        };
        assert!(is_st_link(&port(0x0483, 0x374e)));
        assert!(!is_st_link(&port(0x0403, 0x6001)) && !is_st_link(&port(0x0483, 0x5740)));
    }
}
