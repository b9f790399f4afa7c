//! What can go wrong on a link, and what the device refuses, in words for the person at the keyboard.

use std::time::Duration;

use model_format::link::{
    ActivateError, ListError, MotionRefused, PlayError, RecordError, SettingsError, StopError,
    USB_PRODUCT_ID, USB_VENDOR_ID, UploadError,
};
use postcard_rpc::standard_icd::WireError;

use super::Mismatch;

/// A failure of the link, or a refusal of the device. Each is one line with the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// No stylus is on USB.
    #[error(
        "no stylus on USB (looked for {USB_VENDOR_ID:04x}:{USB_PRODUCT_ID:04x}): plug it in by its own USB port, or name \
         another link with --link"
    )]
    NoUsbDevice,
    /// There are some on USB, but not this one.
    #[error("no stylus with serial number {wanted} on USB; there is {}", found.join(", "))]
    NoSuchSerial {
        /// What was asked for.
        wanted: String,
        /// Those that are there.
        found: Vec<String>,
    },
    /// There are several, and none was named.
    #[error("{} styluses on USB: name one with --link, {}", found.len(), links(found))]
    SeveralUsbDevices {
        /// Their serial numbers.
        found: Vec<String>,
    },
    /// It is there, but this user may not use it.
    #[error("{link}: no permission: {remedy}")]
    Permission {
        /// The link.
        link: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// Another program has it.
    #[error("{link}: in use by another program: close that, then try again")]
    Busy {
        /// The link.
        link: String,
    },
    /// It cannot be opened for another reason.
    #[error("{link}: cannot be opened: {reason}")]
    Open {
        /// The link.
        link: String,
        /// Why not, and what to do about it.
        reason: String,
    },
    /// The device said nothing in time.
    #[error(
        "{link}: no answer to {request} within {:.1} s: is it a stylus, is its firmware running, is another program talking \
         to it?", after.as_secs_f64()
    )]
    NoAnswer {
        /// The link.
        link: String,
        /// What was asked.
        request: &'static str,
        /// How long the host waited.
        after: Duration,
    },
    /// The link broke.
    #[error("{link}: the link was lost: {reason}")]
    Lost {
        /// The link.
        link: String,
        /// Why.
        reason: String,
    },
    /// The device did not understand a frame.
    #[error("{link}: the device did not take {request}: {error}")]
    Frame {
        /// The link.
        link: String,
        /// What was asked.
        request: &'static str,
        /// What it says.
        error: WireError,
    },
    /// The host did not understand the device's answer.
    #[error("{link}: the answer to {request} makes no sense: restart the device, then try again")]
    Answer {
        /// The link.
        link: String,
        /// What was asked.
        request: &'static str,
    },
    /// The device speaks another protocol or plays another format.
    #[error("{link}: {mismatch}")]
    Version {
        /// The link.
        link: String,
        /// What differs and which side is the older one.
        mismatch: Mismatch,
    },
    /// What the device says now is not what it was told.
    #[error("{link}: {what}")]
    NotVerified {
        /// The link.
        link: String,
        /// What differs.
        what: String,
    },
    /// Too much of a recording was lost.
    #[error("{link}: {what}")]
    Lossy {
        /// The link.
        link: String,
        /// How much, and what to do about it.
        what: String,
    },
    /// The device refuses an upload.
    #[error("the device refuses the upload: {0}")]
    Upload(Box<UploadError>),
    /// The device cannot list a texture.
    #[error("the device cannot list: {0}")]
    List(Box<ListError>),
    /// The device does not activate a library.
    #[error("the device does not activate: {0}")]
    Activate(Box<ActivateError>),
    /// The device does not play.
    #[error("the device does not play: {0}")]
    Play(Box<PlayError>),
    /// The device does not stop.
    #[error("the device does not stop: {0}")]
    Stop(#[from] StopError),
    /// The device does not follow a motion.
    #[error("the device does not follow the motion: {0}")]
    Motion(#[from] MotionRefused),
    /// The device does not record.
    #[error("the device does not record: {0}")]
    Record(#[from] RecordError),
    /// The device does not take a setting.
    #[error("the device refuses the setting: {0}")]
    Settings(#[from] SettingsError),
    /// The host itself has no means for a link.
    #[error("no link can be opened here: {0}")]
    Host(std::io::Error),
}

/// What a link returns.
pub type Result<T> = std::result::Result<T, LinkError>;

impl LinkError {
    /// Whether the same request may succeed when it is made again, perhaps over a new link.
    pub fn is_passing(&self) -> bool {
        matches!(
            self,
            Self::NoAnswer { .. } | Self::Lost { .. } | Self::Frame { .. } | Self::Answer { .. }
        )
    }
}

/// Refusals with words in them are large, and an error that is passed on should not be.
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
}

impl From<LinkError> for crate::support::error::Error {
    fn from(failure: LinkError) -> Self {
        Self::Request(failure.to_string())
    }
}

fn links(serials: &[String]) -> String {
    let links: Vec<String> = serials
        .iter()
        .map(|serial| format!("usb:{serial}"))
        .collect();
    links.join(" or ")
}
