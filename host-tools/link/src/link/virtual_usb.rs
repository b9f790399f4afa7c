//! The USB of a virtual stylus. Its USB host is another process at a TCP port, which makes bulk transfers on request.
//!
//! A connection serves one program. Transfers that still wait when it ends are cancelled.

use std::collections::VecDeque;
use std::io;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use super::bulk::{BulkIn, BulkOut};

pub use virtual_link::usb_messages::{FromBus, MAX_MESSAGE_BYTES, ToBus, encode, take};

/// Longest packet of a bulk endpoint at full speed (USB 2.0 section 5.8.3).
const PACKET_BYTES: usize = 64;

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
            // A read may hold several messages, and the begin of another.
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
