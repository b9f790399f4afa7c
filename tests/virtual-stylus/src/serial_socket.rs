//! The serial line behind a socket of the loopback interface, for a program at the other end
//! (`--link tcp:127.0.0.1:PORT`).
//!
//! An answer goes out whole and at once. The emulator's own socket sends it byte by byte and lets the operating system
//! collect bytes (Nagle's algorithm), so that each answer waited some 40 ms for the acknowledgement of its first byte:
//! no line does that.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;

use crate::error::Result;
use crate::loopback::Loopback;
use crate::stylus::VirtualStylus;

/// Bytes that may wait for the line; a program that sends more waits itself.
const MOST_WAITING: usize = 4096;

/// The socket, with the program that is connected.
#[derive(Debug)]
pub struct SerialSocket {
    listener: Loopback,
    program: Option<TcpStream>,
}

impl SerialSocket {
    /// Listens on `port` of the loopback interface (0 for any).
    ///
    /// # Errors
    /// The port cannot be listened on.
    pub fn listen(port: u16) -> Result<Self> {
        Ok(Self {
            listener: Loopback::listen(port)?,
            program: None,
        })
    }

    /// The port.
    ///
    /// # Errors
    /// The system does not give it.
    pub fn port(&self) -> Result<u16> {
        self.listener.port()
    }

    /// Carries bytes both ways. A program that connects while another is there takes its place, as whoever plugs the
    /// cable in last does. Without a program, the image's bytes are lost.
    ///
    /// # Errors
    /// The run is over.
    pub fn serve(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        if let Some(stream) = self.listener.accept() {
            self.program = Some(stream);
        }
        let sent: Vec<u8> = stylus.receive()?.iter().map(|sent| sent.byte).collect();
        let Some(program) = &mut self.program else {
            return Ok(());
        };
        let room = MOST_WAITING.saturating_sub(stylus.waiting()?);
        let goes_on = match read(program, room) {
            Some(bytes) => {
                if !bytes.is_empty() {
                    stylus.send(&bytes)?;
                }
                sent.is_empty() || write(program, &sent)
            }
            None => false,
        };
        if !goes_on {
            self.program = None;
        }
        Ok(())
    }
}

/// Reads at most `room` bytes that have come; `None` if the connection has ended.
fn read(program: &mut TcpStream, room: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![0; room];
    if room == 0 {
        return Some(bytes);
    }
    match program.read(&mut bytes) {
        Ok(0) => None,
        Ok(count) => {
            bytes.truncate(count);
            Some(bytes)
        }
        Err(failure)
            if [ErrorKind::WouldBlock, ErrorKind::Interrupted].contains(&failure.kind()) =>
        {
            Some(Vec::new())
        }
        Err(_) => None,
    }
}

/// Sends `bytes`, waiting for a program that does not read; false if the connection has ended.
fn write(program: &mut TcpStream, bytes: &[u8]) -> bool {
    program.set_nonblocking(false).is_ok()
        && program.write_all(bytes).is_ok()
        && program.set_nonblocking(true).is_ok()
}
