//! Addresses of devices.

use std::fmt;
use std::net::IpAddr;
use std::path::PathBuf;
use std::str::FromStr;

/// Address of a device, as a user writes it: `usb[:SERIAL]`, `serial:PATH`, `tcp:HOST:PORT` or
/// `usb-virtual:HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkAddress {
    /// A device on USB: the only one, or the one with this serial number.
    Usb {
        /// Serial number of the board.
        serial: Option<String>,
    },
    /// A device at a serial port.
    Serial {
        /// The port's device file or name.
        path: PathBuf,
    },
    /// A device at a TCP port, such as the serial line of a virtual stylus.
    Tcp {
        /// Name or address of the host.
        host: String,
        /// The port.
        port: u16,
    },
    /// A virtual stylus on its virtual USB, whose host is at a TCP port.
    UsbVirtual {
        /// Name or address of the host.
        host: String,
        /// The port.
        port: u16,
    },
}

impl LinkAddress {
    /// Returns whether the device must be an emulator, because it is on a virtual USB or at a port of this computer.
    pub fn is_of_an_emulator(&self) -> bool {
        match self {
            Self::UsbVirtual { .. } => true,
            Self::Tcp { host, .. } => is_of_this_computer(host),
            Self::Usb { .. } | Self::Serial { .. } => false,
        }
    }

    /// Returns whether both addresses name the same port, even if they write its computer differently.
    pub(super) fn is_of_same_port(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Tcp { host, port }, Self::Tcp { host: its, port: p })
            | (Self::UsbVirtual { host, port }, Self::UsbVirtual { host: its, port: p }) => {
                port == p && (host == its || (is_of_this_computer(host) && is_of_this_computer(its)))
            }
            _ => self == other,
        }
    }
}

fn is_of_this_computer(host: &str) -> bool {
    host == "localhost" || host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

impl FromStr for LinkAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, rest) = match text.split_once(':') {
            Some((kind, rest)) => (kind, Some(rest)),
            None => (text, None),
        };
        match (kind, rest) {
            ("usb", None) => Ok(Self::Usb { serial: None }),
            ("usb", Some(serial)) if !serial.is_empty() => Ok(Self::Usb {
                serial: Some(serial.to_owned()),
            }),
            ("serial", Some(path)) if !path.is_empty() => Ok(Self::Serial { path: path.into() }),
            ("tcp", Some(target)) => host_and_port(target)
                .map(|(host, port)| Self::Tcp { host, port })
                .ok_or_else(|| unusable(text)),
            ("usb-virtual", Some(target)) => host_and_port(target)
                .map(|(host, port)| Self::UsbVirtual { host, port })
                .ok_or_else(|| unusable(text)),
            _ => Err(unusable(text)),
        }
    }
}

/// Parses `HOST:PORT`; an IPv6 address stands in brackets.
fn host_and_port(target: &str) -> Option<(String, u16)> {
    // The port follows the last colon, because an IPv6 address has colons of its own.
    let (host, port) = target.rsplit_once(':')?;
    let bare = host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    // Without brackets the last part of an IPv6 address would be taken for the port.
    if host.is_empty() || (bare.is_none() && host.contains(':')) {
        return None;
    }
    let port = port.parse().ok().filter(|&port| port > 0)?;
    Some((bare.unwrap_or(host).to_owned(), port))
}

fn unusable(text: &str) -> String {
    format!(
        "'{text}' is not an address of a stylus: give usb, usb:SERIAL, serial:PATH, tcp:HOST:PORT or \
         usb-virtual:HOST:PORT"
    )
}

impl fmt::Display for LinkAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usb { serial: None } => f.write_str("usb"),
            Self::Usb { serial: Some(serial) } => write!(f, "usb:{serial}"),
            Self::Serial { path } => write!(f, "serial:{}", path.display()),
            Self::Tcp { host, port } => write_tcp(f, "tcp", host, *port),
            Self::UsbVirtual { host, port } => write_tcp(f, "usb-virtual", host, *port),
        }
    }
}

fn write_tcp(f: &mut fmt::Formatter<'_>, kind: &str, host: &str, port: u16) -> fmt::Result {
    if host.contains(':') {
        write!(f, "{kind}:[{host}]:{port}")
    } else {
        write!(f, "{kind}:{host}:{port}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::holds;

    #[test]
    fn devices_of_this_computer_alone_are_an_emulators() {
        let is_of_one = |text: &str| text.parse::<LinkAddress>().unwrap().is_of_an_emulator();
        assert!(
            [
                "tcp:127.0.0.1:5555",
                "tcp:[::1]:5555",
                "tcp:localhost:1",
                "usb-virtual:a:1"
            ]
            .map(is_of_one)
            .iter()
            .all(|is| *is)
        );
        assert!(
            !["tcp:10.0.0.2:5555", "usb", "serial:/dev/x"]
                .map(is_of_one)
                .iter()
                .any(|is| *is)
        );
    }

    #[test]
    fn an_address_is_written_as_it_is_read() {
        for text in [
            "usb",
            "usb:3400210012",
            "serial:/dev/ttyACM0",
            "serial:COM3",
            "tcp:localhost:4000",
            "tcp:127.0.0.1:1",
            "tcp:[::1]:65535",
            "usb-virtual:127.0.0.1:5556",
            "usb-virtual:[::1]:5556",
        ] {
            let address: LinkAddress = text.parse().unwrap();
            assert_eq!(address.to_string(), text);
        }
    }

    #[test]
    fn what_is_no_address_is_refused_with_what_would_be() {
        for text in [
            "",
            "usb:",
            "serial",
            "serial:",
            "tcp:localhost",
            "tcp::4000",
            "tcp:localhost:0",
            "tcp:localhost:70000",
            "tcp:::1:4000",
            "usb-virtual",
            "usb-virtual:localhost",
            "bluetooth:stylus",
        ] {
            holds(&text.parse::<LinkAddress>().unwrap_err(), &["tcp:HOST:PORT"]);
        }
    }
}
