//! Messages between a program and the USB host of a virtual stylus. Each consists of its length, as four bytes in
//! little-endian order, and a [`ToBus`] or [`FromBus`] in postcard.

use std::collections::VecDeque;
use std::io;

use serde::{Deserialize, Serialize};

/// Longest message, bytes; far longer than any transfer.
pub const MAX_MESSAGE_BYTES: u32 = 1 << 16;

/// A request of a program to the USB host of a virtual stylus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ToBus {
    /// Queues a transfer to the device.
    Out(Vec<u8>),
    /// Queues a transfer of at most this many bytes from the device.
    In(u32),
    /// Clears the halt of the endpoint to the device.
    ClearOut,
    /// Clears the halt of the endpoint from the device.
    ClearIn,
}

/// An answer of the USB host. Answers of one kind come in the order of their requests. A failure is a text.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FromBus {
    /// A transfer to the device ended.
    Out(Result<(), String>),
    /// A transfer from the device ended.
    In(Result<Vec<u8>, String>),
    /// The halt of the endpoint to the device was cleared.
    ClearedOut(Result<(), String>),
    /// The halt of the endpoint from the device was cleared.
    ClearedIn(Result<(), String>),
}

/// Encodes a message for the connection.
pub fn encode(message: &impl Serialize) -> Vec<u8> {
    let body = postcard::to_allocvec(message).expect("plain data");
    let mut bytes = (body.len() as u32).to_le_bytes().to_vec();
    bytes.extend(body);
    bytes
}

/// Removes the first message from the front of `bytes`, and returns it, or `None` if it is not yet complete.
pub fn take<T: for<'a> Deserialize<'a>>(bytes: &mut VecDeque<u8>) -> io::Result<Option<T>> {
    let unusable = || io::Error::new(io::ErrorKind::InvalidData, "not a message that is known here");
    let head: Vec<u8> = bytes.iter().copied().take(4).collect();
    let Some(length) = head.first_chunk().map(|head| u32::from_le_bytes(*head)) else {
        return Ok(None);
    };
    if length > MAX_MESSAGE_BYTES {
        return Err(unusable());
    }
    let end = 4 + length as usize;
    if bytes.len() < end {
        return Ok(None);
    }
    let message: Vec<u8> = bytes.drain(..end).skip(4).collect();
    postcard::from_bytes(&message).map(Some).map_err(|_| unusable())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_out_as_they_went_in_however_they_are_cut() {
        let messages = [
            ToBus::Out(vec![0; 1024]),
            ToBus::In(1024),
            ToBus::ClearOut,
            ToBus::Out(Vec::new()),
        ];
        let bytes: Vec<u8> = messages.iter().flat_map(encode).collect();
        for cut in [1, 3, 64, bytes.len()] {
            let (mut queue, mut found) = (VecDeque::new(), Vec::new());
            for piece in bytes.chunks(cut) {
                queue.extend(piece);
                while let Some(message) = take::<ToBus>(&mut queue).unwrap() {
                    found.push(message);
                }
            }
            assert_eq!(found, messages);
        }
    }

    #[test]
    fn a_message_that_is_longer_than_any_is_refused() {
        let mut bytes: VecDeque<u8> = u32::MAX.to_le_bytes().into();
        assert!(take::<ToBus>(&mut bytes).is_err());
    }
}
