//! Failures of a link, refusals of the device and differences of version between both sides, in words for the user.

use std::cmp::Ordering;
use std::fmt;
use std::time::Duration;

use model_format::FORMAT_VERSION;
use model_format::link::{
    ActivateError, BoardName, DeviceInfo, ListError, MotionRefused, PROTOCOL_VERSION, PlayError, ProbeError,
    RecordError, ResponseError, SCHEMA_HASH, SelfTestError, SettingsError, StopError, USB_PRODUCT_ID, USB_VENDOR_ID,
    UpdateError, UploadError,
};
use postcard_rpc::standard_icd::WireError;
use stylus_support::names::listed;

/// A failure of the link, or a refusal of the device. Each message is one line with the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each message says it")]
pub enum LinkError {
    #[error(
        "no stylus on USB (looked for {USB_VENDOR_ID:04x}:{USB_PRODUCT_ID:04x}): plug it in by its own USB port, or \
         name another link with --link"
    )]
    NoUsbDevice,
    #[error(
        "no stylus with serial number {wanted} is on USB: name one that is, {}",
        links(found)
    )]
    NoSuchSerial {
        /// The serial number asked for.
        wanted: String,
        /// The serial numbers on USB.
        found: Vec<String>,
    },
    #[error("{} styluses are on USB: name one with --link, {}", found.len(), links(found))]
    SeveralUsbDevices {
        /// Serial numbers of the styluses.
        found: Vec<String>,
    },
    #[error(
        "{}plug one in by its own USB port or by the debug port of its board, or start a virtual one with `cargo \
         virtual-stylus`; `stylus devices` lists what is attached, and --link names one that is not listed",
        nothing(silent)
    )]
    NoDevice {
        /// Ports of probes behind which no stylus has answered.
        silent: Vec<String>,
    },
    #[error("{} styluses are attached: name one, --link {}", found.len(), found.join(" or --link "))]
    SeveralDevices { found: Vec<String> },
    #[error("{link}: no permission: {remedy}")]
    Permission {
        link: String,
        /// The remedy.
        remedy: &'static str,
    },
    #[error(
        "{link}: in use by {}: close that program, or use the stylus's other link, {}",
        holder.as_deref().unwrap_or("another program"), beside(others)
    )]
    Busy {
        link: String,
        /// The program, in words, if the system reports it.
        holder: Option<String>,
        /// Links that may lead to the same device.
        others: Vec<String>,
    },
    #[error("{link}: cannot be opened: {reason}")]
    Open {
        link: String,
        /// The reason and the remedy.
        reason: String,
    },
    #[error(
        "{link}: no answer to the {request} request within {:.1} s: check that it is a stylus, that its firmware runs, \
         and that no other program uses it{}", after.as_secs_f64(), longer(*timeout)
    )]
    NoAnswer {
        link: String,
        /// Name of the request.
        request: &'static str,
        /// Time that the host waited.
        after: Duration,
        /// The timeout that the user can set: that of requests that do not touch the flash.
        timeout: Duration,
    },
    #[error(
        "{link}: nothing could be sent for {:.1} s: check the cable and end other programs that keep this computer \
         busy, then try again{}", after.as_secs_f64(),
        longer(*after)
    )]
    Stalled {
        link: String,
        /// Time that the host waited.
        after: Duration,
    },
    #[error("{link}: the link was lost: {reason}")]
    Lost { link: String, reason: String },
    #[error("{link}: the device did not accept the {request} request: {error}")]
    Frame {
        link: String,
        /// Name of the request.
        request: &'static str,
        /// The device's error.
        error: WireError,
    },
    #[error("{link}: the answer to the {request} request cannot be decoded: restart the device, then try again")]
    Answer {
        link: String,
        /// Name of the request.
        request: &'static str,
    },
    /// The device speaks another protocol or plays another library format.
    #[error("{link}: {mismatch}")]
    Version {
        link: String,
        /// The difference, with the older side.
        mismatch: Mismatch,
    },
    /// The device reports another state than the requested one.
    #[error("{link}: {what}")]
    NotVerified {
        link: String,
        /// The difference and the remedy.
        what: String,
    },
    /// Too much of a recording was lost.
    #[error("{link}: {what}")]
    Lossy {
        link: String,
        /// The loss and the remedy.
        what: String,
    },
    #[error("the device refuses the upload: {0}")]
    Upload(Box<UploadError>),
    #[error(
        "the update is for a {offered}, and the device is a {board}: give one that was built for it, by `cargo tasks \
         image --board {board}`"
    )]
    OtherBoard {
        /// Board of the update.
        offered: BoardName,
        /// Board of the device.
        board: BoardName,
    },
    #[error("the device refuses the update: {0}")]
    Update(Box<UpdateError>),
    #[error("the device cannot list its content: {0}")]
    List(Box<ListError>),
    #[error("the device refuses the activation: {0}")]
    Activate(Box<ActivateError>),
    #[error("the device refuses to play: {0}")]
    Play(Box<PlayError>),
    #[error(
        "the device refuses to play: the active library has no {what} \"{name}\"; it has {}{hint}",
        listed(name, there)
    )]
    Absent {
        /// The word "texture" or "scene".
        what: &'static str,
        /// The name asked for.
        name: String,
        /// The names that the library has, in the device's order.
        there: Vec<String>,
        /// Text about a texture or scene of the other kind with a similar name; empty if there is none.
        hint: String,
    },
    #[error("the device refuses the probe: {0}")]
    Probe(Box<ProbeError>),
    #[error("the device refuses the response: {0}")]
    Response(#[from] ResponseError),
    #[error("the device refuses to stop: {0}")]
    Stop(#[from] StopError),
    #[error("the device refuses the motion: {0}")]
    Motion(#[from] MotionRefused),
    #[error("the device refuses to record: {0}")]
    Record(#[from] RecordError),
    #[error("the device refuses the setting: {0}")]
    Settings(#[from] SettingsError),
    #[error("the device refuses the self test: {0}")]
    SelfTest(Box<SelfTestError>),
    #[error("this computer cannot open a link: {0}")]
    Host(std::io::Error),
}

/// Result of an operation on a link.
pub type Result<T> = std::result::Result<T, LinkError>;

impl LinkError {
    /// Returns the error for a link that another program has open; its caller adds the other links.
    pub(super) fn busy(link: String, holder: Option<String>) -> Self {
        Self::Busy {
            link,
            holder,
            others: Vec::new(),
        }
    }

    /// Returns true if the same request may succeed when it is repeated, perhaps over a new link.
    pub fn is_passing(&self) -> bool {
        matches!(
            self,
            Self::NoAnswer { .. } | Self::Stalled { .. } | Self::Lost { .. } | Self::Frame { .. } | Self::Answer { .. }
        )
    }
}

/// Boxes refusals that hold text, because an error that is passed on should be small.
macro_rules! boxed {
    ($($variant:ident($refusal:ty)),* $(,)?) => {$(
        impl From<$refusal> for LinkError {
            fn from(refusal: $refusal) -> Self {
                Self::$variant(Box::new(refusal))
            }
        }
    )*};
}

boxed! {
    Upload(UploadError),
    Update(UpdateError),
    List(ListError),
    Activate(ActivateError),
    Play(PlayError),
    Probe(ProbeError),
    SelfTest(SelfTestError),
}

impl From<LinkError> for stylus_support::Error {
    fn from(failure: LinkError) -> Self {
        Self::Request(failure.to_string())
    }
}

fn beside(others: &[String]) -> String {
    if others.is_empty() {
        "its own USB port or its probe's serial port: `stylus devices` lists what --link takes".to_owned()
    } else {
        format!("--link {}", others.join(" or --link "))
    }
}

fn nothing(silent: &[String]) -> String {
    if silent.is_empty() {
        "no stylus is attached: ".to_owned()
    } else {
        format!("no stylus answers at {}: ", silent.join(" or "))
    }
}

/// Longest timeout that is proposed, s. A device that takes longer has another fault.
const LONGEST_PROPOSED_S: f64 = 60.0;

/// Returns the text that proposes a timeout several times as long as `timeout`. It is empty if that is too long.
pub(in crate::link) fn longer(timeout: Duration) -> String {
    /// Ratio of the proposed timeout to the present one. A computer under load, or an emulated device, is rarely
    /// slower.
    const FACTOR: f64 = 5.0;
    let proposed = (timeout.as_secs_f64() * FACTOR).ceil();
    if proposed > LONGEST_PROPOSED_S {
        return String::new();
    }
    format!("; if the device or this computer is slow, wait longer with --timeout {proposed}")
}

fn links(serials: &[String]) -> String {
    let links: Vec<String> = serials.iter().map(|serial| format!("usb:{serial}")).collect();
    links.join(" or ")
}

/// Version of this program. The firmware takes its version from the same workspace.
const HOST_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Remedy if the device is older.
const RENEW_DEVICE: &str = "the device's firmware is the older side: flash it from this version (cargo flash)";
/// Remedy if the host is older.
const RENEW_HOST: &str = "this program is the older side: build it from the firmware's version";

/// A difference between device and host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mismatch {
    /// Another version of the protocol.
    Protocol {
        /// The device's.
        device: u16,
        /// The host's.
        host: u16,
    },
    /// Other messages in the same version of the protocol: one side is a development version.
    Schema {
        /// The firmware's version.
        device: String,
        /// The host's version.
        host: String,
    },
    /// Another library format.
    LibraryFormat {
        /// The device's.
        device: u16,
        /// The host's.
        host: u16,
    },
}

impl Mismatch {
    /// Returns the difference that prevents host and device from communicating, if there is one.
    pub fn of_protocol(info: &DeviceInfo) -> Option<Self> {
        if info.protocol_version != PROTOCOL_VERSION {
            Some(Self::Protocol {
                device: info.protocol_version,
                host: PROTOCOL_VERSION,
            })
        } else if info.schema_hash != SCHEMA_HASH {
            Some(Self::Schema {
                device: info.firmware_version.to_string(),
                host: HOST_VERSION.to_owned(),
            })
        } else {
            None
        }
    }

    /// Returns the difference that prevents the device from playing libraries of this host, if there is one.
    pub fn of_library_format(info: &DeviceInfo) -> Option<Self> {
        (info.library_format_version != FORMAT_VERSION).then_some(Self::LibraryFormat {
            device: info.library_format_version,
            host: FORMAT_VERSION,
        })
    }
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, order) = match self {
            Self::Protocol { device, host } => {
                let what = format!("the device speaks protocol {device}, this program {host}");
                (what, device.cmp(host))
            }
            Self::Schema { device, host } => {
                let what =
                    format!("the messages of the device (firmware {device}) and of this program ({host}) differ");
                (what, numbers(device).cmp(&numbers(host)))
            }
            Self::LibraryFormat { device, host } => {
                let what = format!("the device plays libraries of format {device}, this program writes {host}");
                (what, device.cmp(host))
            }
        };
        let remedy = match order {
            Ordering::Less => RENEW_DEVICE,
            Ordering::Greater => RENEW_HOST,
            Ordering::Equal => "build and flash both from one version of the sources",
        };
        write!(f, "{what}: {remedy}")
    }
}

/// Returns the numbers of a version such as `0.1.12`, up to the first part that is not a number.
fn numbers(version: &str) -> Vec<u32> {
    // A suffix, such as a revision, says nothing about the order.
    version
        .split(['-', '+', ' '])
        .next()
        .unwrap_or_default()
        .split('.')
        .map_while(|part| part.parse().ok())
        .collect()
}
