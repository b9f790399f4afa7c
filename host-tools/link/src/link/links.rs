//! The links to attached devices: on USB, behind the serial ports of probes, and those of virtual styluses.

use std::path::Path;

use tokio_serial::{SerialPortType, UsbPortInfo};
use virtual_link::announcement;

use super::error::Result;
use super::{LinkAddress, usb};

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
