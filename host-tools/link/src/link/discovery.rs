//! The devices that are attached to this computer: on USB, behind the serial port of a probe, or virtual.
//!
//! A serial port is opened only if its USB ids are those of an ST-LINK, which a stylus's board has. Any other port may
//! belong to a machine that takes any byte for a command, so it is listed and never opened.

use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use model_format::link::DeviceInfo;
use tokio_serial::UsbPortInfo;

use super::error::{LinkError, Result};
use super::{Device, LinkAddress, Timeouts, links};

/// Longest time for a device to answer the request for its identity.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);

/// Longest time for all devices together, which are asked simultaneously. It includes the opening of a link. A virtual
/// stylus on a busy computer may be many times slower than real time.
const LONGEST: Duration = Duration::from_secs(10);

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
    /// Another program has the link, as this refusal says.
    InUse(String),
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
            Identity::InUse(reason) | Identity::Unknown(reason) => (None, reason.clone()),
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

/// Lists the links to attached devices, which are asked for their identity.
pub fn rows() -> Result<Vec<Row>> {
    let mut found = attached()?;
    ask(found.iter_mut(), LONGEST, &identity);
    Ok(found.iter().map(Row::from).collect())
}

/// Lists the links to attached devices, without asking the devices.
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
    for link in runtime.block_on(links::on_usb())? {
        found.push(of(link, Kind::Usb, None));
    }
    for (path, info) in links::serial_ports() {
        let kind = if links::is_st_link(&info) {
            Kind::Serial
        } else {
            Kind::OtherSerial
        };
        let link = LinkAddress::Serial { path: path.into() };
        found.push(of(link, kind, Some(name(&info))));
    }
    for links in links::of_virtual_ones() {
        for (index, link) in links.into_iter().enumerate() {
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
    let mut asked: Vec<&mut Attached> = found.filter(|attached| attached.kind != Kind::OtherSerial).collect();
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
    while let Ok((index, identity)) = answers.recv_timeout(longest.saturating_sub(begin.elapsed())) {
        asked[index].identity = identity;
    }
}

/// Asks the device at a link for its identity.
fn identity(link: &LinkAddress) -> Identity {
    match Device::connect(link, Timeouts::scaled_to(ANSWER_TIMEOUT)) {
        Ok(device) => Identity::Known(Box::new(device.info().clone())),
        Err(failure @ LinkError::Busy { .. }) => Identity::InUse(failure.to_string()),
        Err(failure) => Identity::Unknown(failure.to_string()),
    }
}

/// Finds the device to use if the user names none. Returns a note with it, unless it is on its own USB port and no
/// other link might be meant.
///
/// Devices behind probes are asked only if no stylus is on USB, because one board may be attached by both ports.
pub fn only() -> Result<(LinkAddress, Option<String>)> {
    let mut found = attached()?;
    if !found.iter().any(|attached| attached.kind == Kind::Usb) {
        let probes = found.iter_mut().filter(|found| found.kind == Kind::Serial);
        ask(probes, LONGEST, &identity);
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
    if styluses.is_empty() {
        // A program that has a probe's port may well have a stylus there. Opening the port names that program.
        let in_use = found.iter().filter(|one| matches!(one.identity, Identity::InUse(_)));
        styluses.extend(in_use);
    }
    let links = |found: &[&Attached]| found.iter().map(|one| one.link.to_string()).collect();
    match styluses[..] {
        [] => {
            let silent = found.iter().filter(|one| matches!(one.identity, Identity::Unknown(_)));
            Err(LinkError::NoDevice {
                silent: silent.map(|one| one.link.to_string()).collect(),
            })
        }
        [one] => {
            let others: Vec<&Attached> = found
                .iter()
                .filter(|other| {
                    other.link != one.link
                        && !other.is_further
                        && other.kind != Kind::OtherSerial
                        && matches!(other.identity, Identity::NotAsked)
                })
                .collect();
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

/// Returns the name that a probe or adapter reports, with its serial number.
fn name(info: &UsbPortInfo) -> String {
    let product = info
        .product
        .clone()
        .unwrap_or_else(|| format!("{:04x}:{:04x}", info.vid, info.pid));
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
        let in_use = Identity::InUse("in use by `stylus play` (process 7)".to_owned());
        let in_use = one("serial:/dev/ttyACM1", Kind::Serial, in_use);
        let (link, _) = choose(&[in_use.clone(), answers.clone()]).unwrap();
        assert_eq!(link, answers.link);
        let silent = Identity::Unknown("no answer".to_owned());
        let silent = one("serial:/dev/ttyACM0", Kind::Serial, silent);
        let (link, _) = choose(&[in_use.clone(), silent.clone()]).unwrap();
        assert_eq!(link, in_use.link);
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
        let silent = |n: usize| one(&format!("tcp:127.0.0.1:{n}"), Kind::Virtual, Identity::NotAsked);
        let mut found: Vec<Attached> = (1..9).map(silent).collect();
        found.push(one("serial:/dev/ttyACM0", Kind::Serial, Identity::NotAsked));
        found.push(one("serial:/dev/ttyUSB0", Kind::OtherSerial, Identity::NotAsked));
        // The device that answers is asked last. On a busy computer its answer may be too late, but not always.
        let mut answers = || {
            ask(found.iter_mut(), Duration::from_secs(1), &identity);
            found[8].identity == known()
        };
        assert!((0..100).any(|_| answers()));
        assert_eq!(found[9].identity, Identity::NotAsked);
        for late in &found[..8] {
            holds(&Row::from(late).state, &["no answer within 1 s", "try again"]);
        }
        drop(end);
    }
}
