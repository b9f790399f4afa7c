//! What goes over the wire, as both ends name it.

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

/// What a device answers with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handshake {
    /// Taken.
    Ack,
    /// Not now.
    Nak,
    /// Not like this.
    Stall,
}

/// What a device answers an IN token with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum InAnswer {
    /// A data packet, which awaits its handshake.
    Data(Pid, Vec<u8>),
    /// Not now.
    Nak,
    /// Not like this.
    Stall,
}
