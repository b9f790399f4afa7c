//! The USB of a virtual stylus. Its USB host is another process, at a TCP port, which makes bulk transfers on request.
//!
//! Each message is its length, four bytes in little-endian order, and a [`ToBus`] or [`FromBus`] in postcard. A
//! connection serves one program; transfers that wait at its end are cancelled.

use std::collections::VecDeque;
use std::io;

use serde::{Deserialize, Serialize};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use super::bulk::{BulkIn, BulkOut};

/// Longest packet of a bulk endpoint at full speed (USB 2.0 section 5.8.3).
const PACKET_BYTES: usize = 64;

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
///
/// # Panics
/// Never for [`ToBus`] and [`FromBus`], because postcard can encode every value of theirs.
pub fn encode(message: &impl Serialize) -> Vec<u8> {
    let body = postcard::to_allocvec(message).expect("plain data");
    let mut bytes = (body.len() as u32).to_le_bytes().to_vec();
    bytes.extend(body);
    bytes
}

/// Removes the first message from the front of `bytes`, and returns it, or `None` if it is not yet complete.
///
/// # Errors
/// Bytes that are not a message.
pub fn take<T: for<'a> Deserialize<'a>>(bytes: &mut VecDeque<u8>) -> io::Result<Option<T>> {
    let unusable = || {
        io::Error::new(
            io::ErrorKind::InvalidData,
            "not a message of a virtual USB host",
        )
    };
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
    postcard::from_bytes(&message)
        .map(Some)
        .map_err(|_| unusable())
}

/// The endpoint to the device.
pub(super) struct VirtualOut {
    to_bus: UnboundedSender<ToBus>,
    ended: UnboundedReceiver<Result<(), String>>,
    cleared: UnboundedReceiver<Result<(), String>>,
    pending: usize,
}

/// The endpoint from the device.
pub(super) struct VirtualIn {
    to_bus: UnboundedSender<ToBus>,
    ended: UnboundedReceiver<Result<Vec<u8>, String>>,
    cleared: UnboundedReceiver<Result<(), String>>,
}

/// Returns the endpoints of the device whose USB host is at the other end of `stream`. Two tasks on the current runtime
/// carry the messages.
pub(super) fn open(stream: TcpStream) -> (VirtualOut, VirtualIn) {
    let (mut reader, mut writer) = stream.into_split();
    let (to_bus, mut outgoing) = unbounded_channel::<ToBus>();
    let (out_ended, out_ends) = unbounded_channel();
    let (in_ended, in_ends) = unbounded_channel();
    let (out_cleared, out_clears) = unbounded_channel();
    let (in_cleared, in_clears) = unbounded_channel();
    tokio::spawn(async move {
        while let Some(message) = outgoing.recv().await {
            if writer.write_all(&encode(&message)).await.is_err() {
                return;
            }
        }
    });
    // The end of the connection drops the senders, which ends every wait for an answer.
    tokio::spawn(async move {
        let (mut bytes, mut buffer) = (VecDeque::new(), [0; 4096]);
        loop {
            match reader.read(&mut buffer).await {
                Ok(count) if count > 0 => bytes.extend(&buffer[..count]),
                _ => return,
            }
            while let Ok(Some(message)) = take(&mut bytes) {
                // An endpoint that was dropped needs no answer.
                let _ = match message {
                    FromBus::Out(ended) => out_ended.send(ended).is_ok(),
                    FromBus::In(ended) => in_ended.send(ended).is_ok(),
                    FromBus::ClearedOut(cleared) => out_cleared.send(cleared).is_ok(),
                    FromBus::ClearedIn(cleared) => in_cleared.send(cleared).is_ok(),
                };
            }
        }
    });
    let output = VirtualOut {
        to_bus: to_bus.clone(),
        ended: out_ends,
        cleared: out_clears,
        pending: 0,
    };
    let input = VirtualIn {
        to_bus,
        ended: in_ends,
        cleared: in_clears,
    };
    (output, input)
}

async fn outcome<T: Send>(ends: &mut UnboundedReceiver<Result<T, String>>) -> io::Result<T> {
    match ends.recv().await {
        Some(ended) => ended.map_err(io::Error::other),
        None => Err(io::Error::new(
            io::ErrorKind::UnexpectedEof,
            "the virtual stylus closed the connection",
        )),
    }
}

impl BulkOut for VirtualOut {
    fn packet_bytes(&self) -> usize {
        PACKET_BYTES
    }

    fn submit(&mut self, data: Vec<u8>) {
        self.pending += 1;
        // `next` reports a connection that has ended.
        let _ = self.to_bus.send(ToBus::Out(data));
    }

    fn pending(&self) -> usize {
        self.pending
    }

    async fn next(&mut self) -> io::Result<()> {
        self.pending -= 1;
        outcome(&mut self.ended).await
    }

    async fn clear_halt(&mut self) -> io::Result<()> {
        let _ = self.to_bus.send(ToBus::ClearOut);
        outcome(&mut self.cleared).await
    }
}

impl BulkIn for VirtualIn {
    fn packet_bytes(&self) -> usize {
        PACKET_BYTES
    }

    fn submit(&mut self, bytes: usize) {
        let _ = self.to_bus.send(ToBus::In(bytes as u32));
    }

    async fn next(&mut self) -> io::Result<Vec<u8>> {
        outcome(&mut self.ended).await
    }

    async fn clear_halt(&mut self) -> io::Result<()> {
        let _ = self.to_bus.send(ToBus::ClearIn);
        outcome(&mut self.cleared).await
    }
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
