//! The USB of a virtual stylus: its host is another process, at a TCP port, and does with bulk transfers what it is told.
//!
//! Each message is its length, four bytes, little-endian, and [`ToBus`] or [`FromBus`] in postcard. A connection is one
//! program's; what waits when it ends is called off.

use std::collections::VecDeque;
use std::io;

use serde::{Deserialize, Serialize};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use super::bulk::{BulkIn, BulkOut};

/// Longest packet of a bulk endpoint at full speed (USB 2.0 section 5.8.3).
const PACKET_BYTES: usize = 64;

/// Longest message; far more than any transfer.
pub const MAX_MESSAGE_BYTES: u32 = 1 << 16;

/// What a program tells the host of a virtual stylus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ToBus {
    /// Has a transfer to the device wait.
    Out(Vec<u8>),
    /// Has a transfer of so many bytes from the device wait.
    In(u32),
    /// Clears the halt of the endpoint to the device.
    ClearOut,
    /// Clears the halt of the endpoint from the device.
    ClearIn,
}

/// What it hears: answers of each kind come in the order of what was told. A failure is in words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FromBus {
    /// A transfer to the device ended.
    Out(Result<(), String>),
    /// A transfer from the device ended.
    In(Result<Vec<u8>, String>),
    /// A halt was cleared.
    ClearedOut(Result<(), String>),
    /// A halt was cleared.
    ClearedIn(Result<(), String>),
}

/// A message as it goes over the connection.
///
/// # Panics
/// Never for these messages, which are plain data.
pub fn encode(message: &impl Serialize) -> Vec<u8> {
    let body = postcard::to_allocvec(message).expect("plain data");
    let mut bytes = (body.len() as u32).to_le_bytes().to_vec();
    bytes.extend(body);
    bytes
}

/// Takes the first message off the front of `bytes`, if all of it is there.
///
/// # Errors
/// Bytes that are no message.
pub fn take<T: for<'a> Deserialize<'a>>(bytes: &mut VecDeque<u8>) -> io::Result<Option<T>> {
    let unusable = || io::Error::new(io::ErrorKind::InvalidData, "no message of a virtual bus");
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

/// The endpoints of the device whose host is at the other end of `stream`; two tasks of the runtime that this is called in
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
    // When the connection ends the senders are dropped, and whoever waits hears of it.
    tokio::spawn(async move {
        let (mut bytes, mut buffer) = (VecDeque::new(), [0; 4096]);
        loop {
            match reader.read(&mut buffer).await {
                Ok(count) if count > 0 => bytes.extend(&buffer[..count]),
                _ => return,
            }
            while let Ok(Some(message)) = take(&mut bytes) {
                // Whoever does not listen any more does not miss it.
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
            "the virtual stylus has gone",
        )),
    }
}

impl BulkOut for VirtualOut {
    fn packet_bytes(&self) -> usize {
        PACKET_BYTES
    }

    fn submit(&mut self, data: Vec<u8>) {
        self.pending += 1;
        // A connection that has ended is heard of in `next`.
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
