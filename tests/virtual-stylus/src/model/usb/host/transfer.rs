//! Transfers, as the software of the host asks for them.

/// Longest packet of a bulk or control endpoint at full speed (sections 5.5.3 and 5.8.3).
pub const PACKET_BYTES: usize = 64;

/// Number of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TransferId(pub(super) u64);

/// A transfer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// A control transfer to endpoint 0.
    Control {
        /// The eight bytes of the SETUP packet.
        setup: [u8; 8],
        /// The data stage's data, when it goes to the device.
        data: Vec<u8>,
    },
    /// Data to a bulk endpoint, in packets of [`PACKET_BYTES`]; no data is an empty packet.
    Out {
        /// The endpoint's number.
        endpoint: u8,
        /// The data.
        data: Vec<u8>,
    },
    /// Data from a bulk endpoint, until a packet is not full or all of `bytes` is there.
    In {
        /// The endpoint's number.
        endpoint: u8,
        /// Number of bytes wanted.
        bytes: usize,
    },
}

/// Reason for which a transfer failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TransferError {
    /// The device answered STALL.
    #[error("the device stalled it")]
    Stall,
    /// Three tries of a transaction were broken or not answered.
    #[error("it was not answered, three times")]
    NotAnswered,
    /// The device sent more than was asked for.
    #[error("the device sent more than was asked for")]
    Babble,
    /// The transfer was cancelled.
    #[error("it was called off")]
    Cancelled,
    /// There is no device.
    #[error("there is no device")]
    Gone,
}

/// The end of a transfer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Completion {
    /// Number of the transfer.
    pub id: TransferId,
    /// Instant, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// Data from the device, or the reason of the failure.
    pub result: Result<Vec<u8>, TransferError>,
}
