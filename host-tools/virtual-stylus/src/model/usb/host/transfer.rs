//! Transfers, both as the host's software requests them and as the bus carries them, transaction by transaction.

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
        /// Data that the data stage carries to the device, if any.
        data: Vec<u8>,
    },
    /// Data to a bulk endpoint, in packets of [`PACKET_BYTES`]. Without data, one empty packet is sent.
    Out {
        /// The endpoint's number.
        endpoint: u8,
        /// The data.
        data: Vec<u8>,
    },
    /// Data from a bulk endpoint. The transfer ends with a packet that is not full, or once all `bytes` have arrived.
    In {
        /// The endpoint's number.
        endpoint: u8,
        /// Number of bytes wanted.
        bytes: usize,
    },
}

/// Reason why a transfer failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TransferError {
    /// The device answered STALL.
    #[error("the device stalled it")]
    Stall,
    /// Three attempts at a transaction were broken or not answered.
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
    /// Instant of the end, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// Data from the device, or the reason for the failure.
    pub result: Result<Vec<u8>, TransferError>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Pipe {
    Control,
    In(u8),
    Out(u8),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    Setup,
    Data,
    Status,
}

#[derive(Clone, Debug)]
pub(super) struct Pending {
    pub(super) id: TransferId,
    pub(super) transfer: Transfer,
    /// Stage of a control transfer. Bulk transfers stay at the first.
    pub(super) stage: Stage,
    /// Number of data bytes that the device has acknowledged.
    pub(super) sent: usize,
    pub(super) received: Vec<u8>,
    pub(super) failures: u32,
}

/// The next transaction of a transfer.
#[derive(Clone, Debug)]
pub(super) enum Packets {
    Setup([u8; 8]),
    Out { endpoint: usize, data: Vec<u8> },
    In { endpoint: usize },
}

impl Pending {
    pub(super) fn packets(&self) -> Packets {
        let rest = |data: &[u8]| {
            let to = data.len().min(self.sent + PACKET_BYTES);
            data[self.sent.min(to)..to].to_vec()
        };
        match (&self.transfer, self.stage) {
            (Transfer::Control { setup, .. }, Stage::Setup) => Packets::Setup(*setup),
            (Transfer::Control { data, .. }, Stage::Data) if !self.is_read() => Packets::Out {
                endpoint: 0,
                data: rest(data),
            },
            // The status stage goes in the opposite direction to the data stage (section 8.5.3).
            (Transfer::Control { .. }, Stage::Status) if self.is_read() && self.asked() > 0 => Packets::Out {
                endpoint: 0,
                data: Vec::new(),
            },
            (Transfer::Control { .. }, _) => Packets::In { endpoint: 0 },
            (Transfer::Out { endpoint, data }, _) => Packets::Out {
                endpoint: usize::from(*endpoint),
                data: rest(data),
            },
            (Transfer::In { endpoint, .. }, _) => Packets::In {
                endpoint: usize::from(*endpoint),
            },
        }
    }

    pub(super) fn is_read(&self) -> bool {
        matches!(&self.transfer, Transfer::Control { setup, .. } if setup[0] & 0x80 != 0)
    }

    /// Number of bytes wanted from the device.
    pub(super) fn asked(&self) -> usize {
        match &self.transfer {
            Transfer::Control { setup, .. } => usize::from(u16::from_le_bytes([setup[6], setup[7]])),
            Transfer::In { bytes, .. } => *bytes,
            Transfer::Out { .. } => 0,
        }
    }

    /// Continues after the device has acknowledged `bytes` of data. Returns true if the transfer is over.
    pub(super) fn took(&mut self, bytes: usize) -> bool {
        self.sent += bytes;
        match (&self.transfer, self.stage) {
            (Transfer::Control { data, .. }, Stage::Data) => {
                if self.sent >= data.len() {
                    self.stage = Stage::Status;
                }
                false
            }
            (Transfer::Control { .. }, _) => true,
            (Transfer::Out { data, .. }, _) => self.sent >= data.len(),
            (Transfer::In { .. }, _) => false,
        }
    }

    /// Continues after `data` from the device. Returns true if the transfer is over.
    pub(super) fn got(&mut self, data: &[u8]) -> Result<bool, TransferError> {
        let is_control = matches!(self.transfer, Transfer::Control { .. });
        if is_control && self.stage == Stage::Status {
            return if data.is_empty() {
                Ok(true)
            } else {
                Err(TransferError::Babble)
            };
        }
        self.received.extend(data);
        if self.received.len() > self.asked() {
            return Err(TransferError::Babble);
        }
        let is_last = data.len() < PACKET_BYTES || self.received.len() == self.asked();
        if is_control && is_last {
            self.stage = Stage::Status;
        }
        Ok(is_last && !is_control)
    }

    /// Continues after the device has accepted the SETUP packet.
    pub(super) fn set_up(&mut self) {
        let data = match &self.transfer {
            Transfer::Control { data, .. } => data.len(),
            _ => 0,
        };
        let has_data = if self.is_read() { self.asked() > 0 } else { data > 0 };
        self.stage = if has_data { Stage::Data } else { Stage::Status };
    }
}
