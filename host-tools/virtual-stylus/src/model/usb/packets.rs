//! Packets on the wire, with names that host and device share.

/// The data packet's identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pid {
    /// A packet with an even number.
    Data0,
    /// A packet with an odd number.
    Data1,
}

impl Pid {
    /// The identifier of the next packet.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::Data0 => Self::Data1,
            Self::Data1 => Self::Data0,
        }
    }
}

/// Handshake of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handshake {
    /// The packet was accepted.
    Ack,
    /// The device cannot accept or send a packet at present.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
}

/// Answer of a device to an IN token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum InAnswer {
    /// A data packet, which awaits its handshake.
    Data(Pid, Vec<u8>),
    /// The device cannot send a packet at present.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
}
