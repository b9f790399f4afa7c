//! Failures of a link and refusals of the device, in words for the person at the keyboard.

use std::time::Duration;

use model_format::link::{
    ActivateError, ListError, MotionRefused, PlayError, ProbeError, RecordError, ResponseError,
    SelfTestError, SettingsError, StopError, USB_PRODUCT_ID, USB_VENDOR_ID, UploadError,
};
use postcard_rpc::standard_icd::WireError;

use super::Mismatch;
use crate::support::nearest::listed;

/// A failure of the link, or a refusal of the device. Each message is one line with the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// No stylus is on USB.
    #[error(
        "no stylus on USB (looked for {USB_VENDOR_ID:04x}:{USB_PRODUCT_ID:04x}): plug it in by its own USB port, or \
         name another link with --link"
    )]
    NoUsbDevice,
    /// Styluses are on USB, but none with this serial number.
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
    /// Several styluses are on USB, and none was named.
    #[error("{} styluses are on USB: name one with --link, {}", found.len(), links(found))]
    SeveralUsbDevices {
        /// Their serial numbers.
        found: Vec<String>,
    },
    /// No device is attached.
    #[error(
        "{}plug one in by its own USB port or by the debug port of its board, or start a virtual one with `cargo \
         virtual-stylus`; `stylus devices` lists what is attached, and --link names one that is not listed",
        nothing(silent)
    )]
    NoDevice {
        /// Ports of probes behind which none has answered.
        silent: Vec<String>,
    },
    /// Several devices are attached, and none was named.
    #[error("{} styluses are attached: name one, --link {}", found.len(), found.join(" or --link "))]
    SeveralDevices {
        /// Their links.
        found: Vec<String>,
    },
    /// The operating system denies this user access.
    #[error("{link}: no permission: {remedy}")]
    Permission {
        /// The link.
        link: String,
        /// The remedy.
        remedy: &'static str,
    },
    /// Another program uses the link.
    #[error("{link}: in use by another program: close that program, then try again")]
    Busy {
        /// The link.
        link: String,
    },
    /// The link cannot be opened for another reason.
    #[error("{link}: cannot be opened: {reason}")]
    Open {
        /// The link.
        link: String,
        /// The reason and the remedy.
        reason: String,
    },
    /// The device did not answer in time.
    #[error(
        "{link}: no answer to the {request} request within {:.1} s: check that it is a stylus, that its firmware runs, \
         and that no other program uses it{}", after.as_secs_f64(), longer(*timeout)
    )]
    NoAnswer {
        /// The link.
        link: String,
        /// Name of the request.
        request: &'static str,
        /// Time that the host waited.
        after: Duration,
        /// The timeout that the user may give: that of an answer which takes no flash.
        timeout: Duration,
    },
    /// The link accepted no more frames.
    #[error(
        "{link}: nothing could be sent for {:.1} s: check the cable, then try again{}", after.as_secs_f64(),
        longer(*after)
    )]
    Stalled {
        /// The link.
        link: String,
        /// Time that the host waited.
        after: Duration,
    },
    /// The process that shares the link has failed to open it.
    #[error("{0}")]
    Broker(String),
    /// Another program has the motion, or the upload.
    #[error("{link}: {what}")]
    Held {
        /// The link.
        link: String,
        /// The program, its process, and the remedy.
        what: String,
    },
    /// The link broke.
    #[error("{link}: the link was lost: {reason}")]
    Lost {
        /// The link.
        link: String,
        /// The reason.
        reason: String,
    },
    /// The device did not accept a frame.
    #[error("{link}: the device did not accept the {request} request: {error}")]
    Frame {
        /// The link.
        link: String,
        /// Name of the request.
        request: &'static str,
        /// The device's error.
        error: WireError,
    },
    /// The device's answer cannot be decoded.
    #[error(
        "{link}: the answer to the {request} request cannot be decoded: restart the device, then try again"
    )]
    Answer {
        /// The link.
        link: String,
        /// Name of the request.
        request: &'static str,
    },
    /// The device speaks another protocol or plays another library format.
    #[error("{link}: {mismatch}")]
    Version {
        /// The link.
        link: String,
        /// The difference, with the older side.
        mismatch: Mismatch,
    },
    /// The device reports another state than the requested one.
    #[error("{link}: {what}")]
    NotVerified {
        /// The link.
        link: String,
        /// The difference and the remedy.
        what: String,
    },
    /// Too much of a recording was lost.
    #[error("{link}: {what}")]
    Lossy {
        /// The link.
        link: String,
        /// The loss and the remedy.
        what: String,
    },
    /// The device refuses an upload.
    #[error("the device refuses the upload: {0}")]
    Upload(Box<UploadError>),
    /// The device cannot list a texture or scene.
    #[error("the device cannot list its content: {0}")]
    List(Box<ListError>),
    /// The device refuses to activate a library.
    #[error("the device refuses the activation: {0}")]
    Activate(Box<ActivateError>),
    /// The device refuses to play.
    #[error("the device refuses to play: {0}")]
    Play(Box<PlayError>),
    /// The active library has no texture or scene of this name.
    #[error(
        "the device refuses to play: the active library has no {what} \"{name}\"; it has {}",
        listed(name, there)
    )]
    Absent {
        /// A texture or a scene, in words.
        what: &'static str,
        /// The name asked for.
        name: String,
        /// The names that are there, in the device's order.
        there: Vec<String>,
    },
    /// The device refuses a probe.
    #[error("the device refuses the probe: {0}")]
    Probe(Box<ProbeError>),
    /// The device refuses a response.
    #[error("the device refuses the response: {0}")]
    Response(#[from] ResponseError),
    /// The device refuses to stop.
    #[error("the device refuses to stop: {0}")]
    Stop(#[from] StopError),
    /// The device refuses a motion.
    #[error("the device refuses the motion: {0}")]
    Motion(#[from] MotionRefused),
    /// The device refuses to record.
    #[error("the device refuses to record: {0}")]
    Record(#[from] RecordError),
    /// The device refuses a setting.
    #[error("the device refuses the setting: {0}")]
    Settings(#[from] SettingsError),
    /// The device refuses a measurement of the self test.
    #[error("the device refuses the self test: {0}")]
    SelfTest(Box<SelfTestError>),
    /// The host cannot start what a link needs.
    #[error("this computer cannot open a link: {0}")]
    Host(std::io::Error),
}

/// Result of an operation on a link.
pub type Result<T> = std::result::Result<T, LinkError>;

impl LinkError {
    /// Returns true if the same request may succeed when it is repeated, perhaps over a new link.
    pub fn is_passing(&self) -> bool {
        matches!(
            self,
            Self::NoAnswer { .. }
                | Self::Stalled { .. }
                | Self::Lost { .. }
                | Self::Frame { .. }
                | Self::Answer { .. }
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
    List(ListError),
    Activate(ActivateError),
    Play(PlayError),
    Probe(ProbeError),
    SelfTest(SelfTestError),
}

impl From<LinkError> for crate::support::error::Error {
    fn from(failure: LinkError) -> Self {
        Self::Request(failure.to_string())
    }
}

fn nothing(silent: &[String]) -> String {
    if silent.is_empty() {
        "no stylus is attached: ".to_owned()
    } else {
        format!("no stylus answers at {}: ", silent.join(" or "))
    }
}

/// Longest timeout that is proposed, s. A device that takes longer has another trouble.
const LONGEST_PROPOSED_S: f64 = 60.0;

/// Proposal of a timeout that is several times as long as `timeout`, in words.
pub(in crate::link) fn longer(timeout: Duration) -> String {
    /// A computer under load, or an emulated device, is rarely slower than this.
    const FACTOR: f64 = 5.0;
    let proposed = (timeout.as_secs_f64() * FACTOR).ceil();
    if proposed > LONGEST_PROPOSED_S {
        return String::new();
    }
    format!("; if the device or this computer is slow, wait longer with --timeout {proposed}")
}

fn links(serials: &[String]) -> String {
    let links: Vec<String> = serials
        .iter()
        .map(|serial| format!("usb:{serial}"))
        .collect();
    links.join(" or ")
}
