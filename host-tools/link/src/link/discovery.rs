//! The devices that are attached to this computer: on USB, behind the serial port of a probe, or virtual.
//!
//! A serial port is opened only if its USB ids are those of an ST-LINK, which a stylus's board has. Any other port may
//! belong to a machine that takes any byte for a command, so it is listed and never opened.

use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use model_format::link::DeviceInfo;
use tokio_serial::{SerialPortType, UsbPortInfo};
use virtual_link::announcement;

use super::error::{LinkError, Result};
use super::route::Route;
use super::{Device, LinkAddress, Timeouts, usb};

/// Longest time for a device to answer the request for its identity.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);

/// Longest time for all devices together, which are asked simultaneously. It includes the opening of a link. A virtual
/// stylus on a busy computer may be many times slower than real time.
const LONGEST: Duration = Duration::from_secs(10);

/// USB vendor id of the ST-LINK probes: STMicroelectronics.
const ST_LINK_VENDOR_ID: u16 = 0x0483;

/// USB product ids of the ST-LINK probes with a serial port: V2-1, V3 and their variants.
const ST_LINK_PRODUCT_IDS: [u16; 8] = [
    0x374a, 0x374b, 0x374e, 0x374f, 0x3752, 0x3753, 0x3754, 0x3757,
];

/// Kind of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The stylus's own USB port.
    Usb,
    /// The serial port of a probe.
    Serial,
    /// Another serial port, which is not opened.
    OtherSerial,
    /// A virtual stylus.
    Virtual,
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Usb => "USB",
            Self::Serial => "serial",
            Self::OtherSerial => "other serial",
            Self::Virtual => "virtual",
        })
    }
}

/// A link that leads to a device, or may lead to one.
#[derive(Clone, Debug, PartialEq)]
pub struct Attached {
    /// Address of the link.
    pub link: LinkAddress,
    /// Kind of the link.
    pub kind: Kind,
    /// Name that the probe or adapter reports.
    pub probe: Option<String>,
    /// True if the preceding link leads to the same virtual stylus.
    pub is_further: bool,
    /// The device's answer to a request for its identity.
    pub identity: Identity,
}

/// Answer to the request for a device's identity.
#[derive(Clone, Debug, PartialEq)]
pub enum Identity {
    /// The device was not asked.
    NotAsked,
    /// The device is a stylus.
    Known(Box<DeviceInfo>),
    /// No device answers, or its answer cannot be used, for this reason.
    Unknown(String),
}

/// A row of `stylus devices`: the facts of one link.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Row {
    /// Address of the link, as `--link` accepts it.
    pub link: String,
    /// Kind of the link.
    pub kind: Kind,
    /// Name of the probe or adapter, for a serial port.
    pub probe: Option<String>,
    /// Serial number of the board, if it answers.
    pub serial_number: Option<String>,
    /// Version of the board's firmware, if it answers.
    pub firmware: Option<String>,
    /// The answer, or the reason why there is none.
    pub state: String,
}

impl From<&Attached> for Row {
    fn from(attached: &Attached) -> Self {
        let (info, state) = match &attached.identity {
            Identity::Known(info) => (Some(info), "answers".to_owned()),
            Identity::NotAsked => (None, "not opened: no ST-LINK".to_owned()),
            Identity::Unknown(reason) => (None, reason.clone()),
        };
        Self {
            link: attached.link.to_string(),
            kind: attached.kind,
            probe: attached.probe.clone(),
            serial_number: info.map(|info| info.serial.to_string()),
            firmware: info.map(|info| info.firmware_version.to_string()),
            state,
        }
    }
}

/// Lists the links to attached devices, which are asked for their identity over `route`.
///
/// # Errors
/// A computer that does not list its USB devices.
pub fn rows(route: &Route) -> Result<Vec<Row>> {
    let mut found = attached()?;
    ask(found.iter_mut(), LONGEST, &identity_by(route));
    Ok(found.iter().map(Row::from).collect())
}

/// Lists the links to attached devices, without asking the devices.
///
/// # Errors
/// A computer that does not list its USB devices.
fn attached() -> Result<Vec<Attached>> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(LinkError::Host)?;
    let mut found = Vec::new();
    let of = |link, kind, probe| Attached {
        link,
        kind,
        probe,
        is_further: false,
        identity: Identity::NotAsked,
    };
    for serial in runtime.block_on(usb::serial_numbers())? {
        found.push(of(LinkAddress::Usb { serial }, Kind::Usb, None));
    }
    for (path, info) in usb_ports() {
        let kind = if is_st_link(info.vid, info.pid) {
            Kind::Serial
        } else {
            Kind::OtherSerial
        };
        let link = LinkAddress::Serial { path: path.into() };
        found.push(of(link, kind, Some(name(&info))));
    }
    for announced in announcement::announced() {
        let links = announced.links.iter().filter_map(|link| link.parse().ok());
        for (index, link) in links.enumerate() {
            found.push(Attached {
                is_further: index > 0,
                ..of(link, Kind::Virtual, None)
            });
        }
    }
    Ok(found)
}

/// Asks the devices for their identities with `identity`, all simultaneously and for at most `longest`. Leaves out
/// ports that cannot be a stylus's.
fn ask<'a>(
    found: impl Iterator<Item = &'a mut Attached>,
    longest: Duration,
    identity: &(impl Fn(&LinkAddress) -> Identity + Clone + Send + 'static),
) {
    let mut asked: Vec<&mut Attached> = found
        .filter(|attached| attached.kind != Kind::OtherSerial)
        .collect();
    let (sender, answers) = mpsc::channel();
    for (index, attached) in asked.iter_mut().enumerate() {
        let late = format!(
            "no answer within {} s: it or this computer is busy; try again",
            longest.as_secs()
        );
        // This stands unless an answer arrives in time.
        attached.identity = Identity::Unknown(late);
        let (sender, identity) = (sender.clone(), identity.clone());
        let link = attached.link.clone();
        // A late answer has no receiver, and is dropped.
        thread::spawn(move || drop(sender.send((index, identity(&link)))));
    }
    drop(sender);
    let begin = Instant::now();
    while let Ok((index, identity)) = answers.recv_timeout(longest.saturating_sub(begin.elapsed()))
    {
        asked[index].identity = identity;
    }
}

/// Returns a function that asks the device at a link for its identity, over `route`.
fn identity_by(route: &Route) -> impl Fn(&LinkAddress) -> Identity + Clone + Send + 'static {
    let route = route.clone();
    move |link| {
        let timeouts = Timeouts::scaled_to(ANSWER_TIMEOUT);
        match Device::connect_by(link, timeouts, route.clone()) {
            Ok(device) => Identity::Known(Box::new(device.info().clone())),
            Err(failure) => Identity::Unknown(failure.to_string()),
        }
    }
}

/// Finds the device to use if the user names none. Returns a note with it, unless it is on its own USB port and no
/// other link might be meant.
///
/// Devices behind probes are asked only if no stylus is on USB, because one board may be attached by both ports.
///
/// # Errors
/// No device, or several.
pub fn only(route: &Route) -> Result<(LinkAddress, Option<String>)> {
    let mut found = attached()?;
    if !found.iter().any(|attached| attached.kind == Kind::Usb) {
        let probes = found.iter_mut().filter(|found| found.kind == Kind::Serial);
        ask(probes, LONGEST, &identity_by(route));
    }
    choose(&found)
}

fn choose(found: &[Attached]) -> Result<(LinkAddress, Option<String>)> {
    let mut styluses: Vec<&Attached> = Vec::new();
    for attached in found {
        // A probe may be that of any board, so it counts only if a stylus answers behind it.
        let is_one = match attached.kind {
            Kind::Usb => true,
            Kind::Serial => matches!(attached.identity, Identity::Known(_)),
            Kind::OtherSerial => false,
            Kind::Virtual => !attached.is_further,
        };
        if is_one {
            styluses.push(attached);
        }
    }
    let links = |found: &[&Attached]| found.iter().map(|one| one.link.to_string()).collect();
    match styluses[..] {
        [] => {
            let silent = found
                .iter()
                .filter(|one| matches!(one.identity, Identity::Unknown(_)));
            Err(LinkError::NoDevice {
                silent: silent.map(|one| one.link.to_string()).collect(),
            })
        }
        [one] => {
            let others = found.iter().filter(|other| {
                other.link != one.link
                    && !other.is_further
                    && other.kind != Kind::OtherSerial
                    && matches!(other.identity, Identity::NotAsked)
            });
            let others: Vec<&Attached> = others.collect();
            let note = match (one.kind, others.is_empty()) {
                (Kind::Usb, true) => None,
                (_, true) => Some(format!("{}: the only stylus found", one.link)),
                (_, false) => {
                    let others: Vec<String> = links(&others);
                    Some(format!(
                        "{} is used, and not {}; --link names another one",
                        one.link,
                        others.join(" or ")
                    ))
                }
            };
            Ok((one.link.clone(), note))
        }
        _ => Err(LinkError::SeveralDevices {
            found: links(&styluses),
        }),
    }
}

/// The serial ports behind USB, with their names.
fn usb_ports() -> Vec<(String, UsbPortInfo)> {
    // The crate for serial ports panics without this folder.
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let ports = tokio_serial::available_ports().unwrap_or_default();
    let mut ports: Vec<(String, UsbPortInfo)> = ports
        .into_iter()
        .filter_map(|port| match port.port_type {
            SerialPortType::UsbPort(info) => Some((port.port_name, info)),
            _ => None,
        })
        .collect();
    ports.sort_by(|one, other| one.0.cmp(&other.0));
    ports
}

fn is_st_link(vendor: u16, product: u16) -> bool {
    vendor == ST_LINK_VENDOR_ID && ST_LINK_PRODUCT_IDS.contains(&product)
}

/// Returns the name that a probe or adapter reports, with its serial number.
fn name(info: &UsbPortInfo) -> String {
    let product = info.product.clone();
    let product = product.unwrap_or_else(|| format!("{:04x}:{:04x}", info.vid, info.pid));
    match &info.serial_number {
        Some(serial) => format!("{product} {serial}"),
        None => product,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::holds;

    fn one(link: &str, kind: Kind, identity: Identity) -> Attached {
        Attached {
            link: link.parse().unwrap(),
            kind,
            probe: None,
            is_further: false,
            identity,
        }
    }

    fn known() -> Identity {
        Identity::Known(Box::new(DeviceInfo {
            product: "stylus".try_into().unwrap(),
            serial: "01".try_into().unwrap(),
            firmware_version: "1".try_into().unwrap(),
            build: "".try_into().unwrap(),
            protocol_version: 1,
            library_format_version: 1,
            schema_hash: 1,
        }))
    }

    #[test]
    fn the_only_device_is_chosen_with_a_note_unless_it_is_the_only_kind() {
        let usb = one("usb:01", Kind::Usb, Identity::NotAsked);
        let probe = one("serial:/dev/ttyACM0", Kind::Serial, Identity::NotAsked);
        let answers = one("serial:/dev/ttyACM0", Kind::Serial, known());
        let adapter = one("serial:/dev/ttyUSB0", Kind::OtherSerial, Identity::NotAsked);
        let virtual_one = one("tcp:127.0.0.1:1", Kind::Virtual, Identity::NotAsked);
        let further = Attached {
            is_further: true,
            ..one("usb-virtual:127.0.0.1:2", Kind::Virtual, Identity::NotAsked)
        };
        let (link, note) = choose(&[usb.clone(), adapter.clone()]).unwrap();
        assert_eq!((link, note), (usb.link.clone(), None));
        let (link, note) = choose(&[usb.clone(), probe]).unwrap();
        assert_eq!(link, usb.link);
        assert!(note.unwrap().contains("not serial:/dev/ttyACM0"));
        let (link, note) = choose(&[answers.clone(), adapter.clone()]).unwrap();
        assert_eq!(link, answers.link);
        assert!(note.is_some());
        let (link, _) = choose(&[virtual_one.clone(), further.clone()]).unwrap();
        assert_eq!(link, virtual_one.link);
        let several = choose(&[usb, virtual_one, further, adapter.clone()]).unwrap_err();
        assert_eq!(
            several.to_string(),
            "2 styluses are attached: name one, --link usb:01 or --link tcp:127.0.0.1:1"
        );
        holds(&choose(&[adapter]).unwrap_err(), &["plug"]);
        let silent = Identity::Unknown("no answer".to_owned());
        let silent = one("serial:/dev/ttyACM0", Kind::Serial, silent);
        let message = choose(&[silent]).unwrap_err();
        holds(&message, &["no stylus answers at serial:/dev/ttyACM0"]);
    }

    #[test]
    fn devices_that_never_answer_do_not_keep_the_others_waiting() {
        let (end, ended) = mpsc::channel::<()>();
        let ended = std::sync::Arc::new(std::sync::Mutex::new(ended));
        let identity = move |link: &LinkAddress| {
            if link.to_string().ends_with("ACM0") {
                return known();
            }
            // Blocks until the test ends.
            let _ = ended.lock().map(|ended| ended.recv());
            known()
        };
        let silent = |n: usize| {
            one(
                &format!("tcp:127.0.0.1:{n}"),
                Kind::Virtual,
                Identity::NotAsked,
            )
        };
        let mut found: Vec<Attached> = (1..9).map(silent).collect();
        found.push(one("serial:/dev/ttyACM0", Kind::Serial, Identity::NotAsked));
        found.push(one(
            "serial:/dev/ttyUSB0",
            Kind::OtherSerial,
            Identity::NotAsked,
        ));
        // The device that answers is asked last. On a busy computer its answer may be too late, but not always.
        let mut answers = || {
            ask(found.iter_mut(), Duration::from_secs(1), &identity);
            found[8].identity == known()
        };
        assert!((0..100).any(|_| answers()));
        assert_eq!(found[9].identity, Identity::NotAsked);
        for late in &found[..8] {
            holds(
                &Row::from(late).state,
                &["no answer within 1 s", "try again"],
            );
        }
        drop(end);
    }

    #[test]
    fn the_board_that_the_udev_rule_names_has_a_probe() {
        let rules = include_str!("../../../70-stylus.rules");
        assert!(rules.contains("ATTRS{idVendor}==\"0483\", ATTRS{idProduct}==\"374e\""));
        assert!(is_st_link(0x0483, 0x374e));
        assert!(!is_st_link(0x0403, 0x6001) && !is_st_link(0x0483, 0x5740));
    }
}
