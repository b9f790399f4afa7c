//! A broker's clients, and the messages that they exchange with the broker. A message consists of its length, as four
//! bytes in little-endian order, and a value in postcard, like the messages of a virtual USB. Programs of another
//! version use another socket.

use std::collections::VecDeque;
use std::io;

use serde::{Deserialize, Serialize};
use tokio::io::{AsyncRead, AsyncReadExt};

use crate::link::virtual_usb::take;

/// Number of a client. No later client gets the same number.
pub(super) type ClientId = u64;

/// A program at the other end of the socket.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Program {
    /// Command of the program.
    pub(super) command: String,
    /// Number of the program's process, if the system reports it.
    pub(super) process: Option<i32>,
}

impl std::fmt::Display for Program {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`stylus {}`", self.command)?;
        match self.process {
            Some(process) => write!(f, " (process {process})"),
            None => Ok(()),
        }
    }
}

/// A message of a client.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum ToBroker {
    /// The client's command; its first message.
    Command(String),
    /// A frame for the device.
    Frame(Vec<u8>),
}

/// A message of a broker.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum FromBroker {
    /// A frame of the device.
    Frame(Vec<u8>),
    /// The reason why the next error refuses the request with this key.
    Refused {
        /// Key of the request.
        key: [u8; 8],
        /// The reason, with the remedy.
        words: String,
    },
    /// The program that has stopped what this client played or recorded.
    Stopped {
        /// The program, in words.
        by: String,
    },
    /// The next answer is about a recording that other clients have begun.
    Joins {
        /// Blocks that the device has recorded so far.
        blocks: u32,
        /// Number of these blocks that the device has lost.
        lost_blocks: u32,
    },
    /// Number of the device's frames that were broken so far.
    Broken(u64),
    /// The link to the device has ended, for this reason.
    Ended(String),
}

/// Messages that arrive.
pub(super) struct Messages<R> {
    reader: R,
    bytes: VecDeque<u8>,
}

impl<R: AsyncRead + Unpin> Messages<R> {
    /// The messages in `reader`.
    pub(super) fn new(reader: R) -> Self {
        Self {
            reader,
            bytes: VecDeque::new(),
        }
    }

    /// Waits for the next message. If the wait is cancelled, the bytes that have arrived are kept.
    ///
    /// # Errors
    /// The end of the connection, or bytes that are no message.
    pub(super) async fn next<T: for<'a> Deserialize<'a>>(&mut self) -> io::Result<T> {
        loop {
            if let Some(message) = take(&mut self.bytes)? {
                return Ok(message);
            }
            let mut buffer = [0; 4096];
            match self.reader.read(&mut buffer).await? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                count => self.bytes.extend(&buffer[..count]),
            }
        }
    }
}
