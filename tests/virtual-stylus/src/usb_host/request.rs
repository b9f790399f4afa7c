//! Control requests.

/// A control request (USB 2.0 table 9-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Direction, kind and recipient.
    pub kind: u8,
    /// Number of the request.
    pub request: u8,
    /// Its first number.
    pub value: u16,
    /// Its second number.
    pub index: u16,
    /// Bytes of the data stage.
    pub length: u16,
}

impl Request {
    /// The SETUP packet's data.
    pub fn bytes(self) -> [u8; 8] {
        let [value_0, value_1] = self.value.to_le_bytes();
        let [index_0, index_1] = self.index.to_le_bytes();
        let [length_0, length_1] = self.length.to_le_bytes();
        [
            self.kind,
            self.request,
            value_0,
            value_1,
            index_0,
            index_1,
            length_0,
            length_1,
        ]
    }

    /// The descriptor of `kind` with this index, at most `length` bytes of it.
    pub fn descriptor(kind: u8, index: u8, language: u16, length: u16) -> Self {
        Self {
            kind: 0x80,
            request: 6,
            value: u16::from_le_bytes([index, kind]),
            index: language,
            length,
        }
    }

    /// Sets the device's address.
    pub fn set_address(address: u8) -> Self {
        Self {
            kind: 0x00,
            request: 5,
            value: address.into(),
            index: 0,
            length: 0,
        }
    }

    /// Chooses a configuration.
    pub fn set_configuration(value: u8) -> Self {
        Self {
            kind: 0x00,
            request: 9,
            value: value.into(),
            index: 0,
            length: 0,
        }
    }

    /// Ends an endpoint's halt.
    pub fn clear_halt(endpoint: u8) -> Self {
        Self {
            kind: 0x02,
            request: 1,
            value: 0,
            index: endpoint.into(),
            length: 0,
        }
    }

    /// Halts an endpoint.
    pub fn set_halt(endpoint: u8) -> Self {
        Self {
            request: 3,
            ..Self::clear_halt(endpoint)
        }
    }
}
