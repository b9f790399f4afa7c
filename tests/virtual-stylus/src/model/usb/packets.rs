//! Packets on the wire, under the names that both ends use.

/// The data packet's identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pid {
    /// An even packet.
    Data0,
    /// An odd packet.
    Data1,
}

impl Pid {
    /// The one that follows.
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
    /// The packet was taken.
    Ack,
    /// The device cannot take or send a packet now.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
}

/// Answer of a device to an IN token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum InAnswer {
    /// A data packet, which awaits its handshake.
    Data(Pid, Vec<u8>),
    /// The device cannot take or send a packet now.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
}
