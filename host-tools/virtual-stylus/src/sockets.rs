//! Ports of the loopback interface for programs: the serial line (`--link tcp:127.0.0.1:PORT`), and a host on USB,
//! which enumerates the device and carries out a program's bulk transfers (`--link usb-virtual:127.0.0.1:PORT`).
//!
//! An answer on the serial line is sent at once and as a whole. The emulator's own socket sends the answer byte by byte
//! and lets the operating system collect bytes (Nagle's algorithm). Each answer then waits some 40 ms for the
//! acknowledgement of its first byte, which does not happen on a real line.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};

use virtual_link::usb_messages::{FromBus, ToBus, encode, take};

use crate::model::usb::host::{Transfer, TransferId};
use crate::stylus::VirtualStylus;
use crate::usb_host::UsbHost;
use crate::usb_host::descriptor::bulk_endpoints;
use crate::{Error, Result};

/// A port that is open for connections. No call on it waits.
#[derive(Debug)]
struct Loopback(TcpListener);

impl Loopback {
    /// Listens on `port` (0 for any).
    fn listen(port: u16) -> Result<Self> {
        let told = failure(port);
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(&told)?;
        listener.set_nonblocking(true).map_err(&told)?;
        Ok(Self(listener))
    }

    /// The port.
    fn port(&self) -> Result<u16> {
        Ok(self.0.local_addr().map_err(failure(0))?.port())
    }

    /// Returns the next program that has connected, if any. Bytes to it are sent at once, and reading from it does not
    /// wait.
    fn accept(&self) -> Option<TcpStream> {
        let (stream, _) = self.0.accept().ok()?;
        stream.set_nonblocking(true).ok()?;
        stream.set_nodelay(true).ok()?;
        Some(stream)
    }
}

/// Returns true if the program has ended, and has left no byte to read.
fn has_ended(program: &TcpStream) -> bool {
    match program.peek(&mut [0]) {
        Ok(count) => count == 0,
        Err(failure) => ![ErrorKind::WouldBlock, ErrorKind::Interrupted].contains(&failure.kind()),
    }
}

fn failure(port: u16) -> impl Fn(std::io::Error) -> Error {
    move |error| Error::Port {
        port,
        reason: error.to_string(),
    }
}

/// Largest number of bytes that wait for the line. A program that sends more has to wait.
const MOST_WAITING: usize = 4096;

/// The socket of the serial line, with the connected program.
#[derive(Debug)]
pub struct SerialSocket {
    listener: Loopback,
    program: Option<TcpStream>,
}

impl SerialSocket {
    /// Listens on `port` of the loopback interface (0 for any).
    pub fn listen(port: u16) -> Result<Self> {
        Ok(Self {
            listener: Loopback::listen(port)?,
            program: None,
        })
    }

    /// The port that the socket listens on.
    pub fn port(&self) -> Result<u16> {
        self.listener.port()
    }

    /// Carries bytes in both directions. A program that connects while another one is connected is refused: its
    /// connection ends at once. Without a program, the image's bytes are lost.
    pub fn serve(&mut self, stylus: &mut VirtualStylus) {
        if let Some(stream) = self.listener.accept()
            && self.program.as_ref().is_none_or(has_ended)
        {
            self.program = Some(stream);
        }
        // These are taken even without a program, or the next one would receive them all.
        let sent: Vec<u8> = stylus.receive().iter().map(|sent| sent.byte).collect();
        let Some(program) = &mut self.program else {
            return;
        };
        let room = MOST_WAITING.saturating_sub(stylus.waiting());
        let goes_on = match read_some(program, room) {
            Some(bytes) => {
                if !bytes.is_empty() {
                    stylus.send(&bytes);
                }
                sent.is_empty() || write_all(program, &sent)
            }
            None => false,
        };
        if !goes_on {
            self.program = None;
        }
    }
}

/// Reads at most `room` bytes that have arrived; `None` if the connection has ended.
fn read_some(program: &mut TcpStream, room: usize) -> Option<Vec<u8>> {
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
        Err(failure) if [ErrorKind::WouldBlock, ErrorKind::Interrupted].contains(&failure.kind()) => Some(Vec::new()),
        Err(_) => None,
    }
}

/// Sends `bytes`, and waits while the program does not read. Returns false if the connection has ended.
fn write_all(program: &mut TcpStream, bytes: &[u8]) -> bool {
    program.set_nonblocking(false).is_ok() && program.write_all(bytes).is_ok() && program.set_nonblocking(true).is_ok()
}

/// Virtual time from pulling a cable to plugging it in again, ns.
const UNPLUGGED_NS: u64 = 300_000_000;

/// The host and its socket.
#[derive(Debug)]
pub struct UsbSocket {
    listener: Loopback,
    usb: UsbHost,
    /// Addresses of the OUT and the IN endpoint, while the device is configured.
    endpoints: Option<[u8; 2]>,
    program: Option<Program>,
}

/// The connected program.
#[derive(Debug)]
struct Program {
    stream: TcpStream,
    bytes: VecDeque<u8>,
    out: VecDeque<TransferId>,
    input: VecDeque<TransferId>,
    /// Largest number of the program's IN transfers that have waited at once.
    most: usize,
}

impl UsbSocket {
    /// Listens on `port` of the loopback interface (0 for any).
    pub fn listen(port: u16) -> Result<Self> {
        Ok(Self {
            listener: Loopback::listen(port)?,
            usb: UsbHost::default(),
            endpoints: None,
            program: None,
        })
    }

    /// The port that the socket listens on.
    pub fn port(&self) -> Result<u16> {
        self.listener.port()
    }

    /// Returns true if fewer of the program's transfers wait for the device than before, so that the program is about
    /// to request more. A run that continued meanwhile would be faster than its program.
    pub fn is_ahead(&self) -> bool {
        (self.program.as_ref()).is_some_and(|program| program.input.len() < program.most)
    }

    /// Serves the socket and the device. Enumerates the device if it is not configured, which runs the stylus. Plugs
    /// the cable in again some time after it was pulled. A program that connects while another one is connected is
    /// refused: its connection ends at once.
    pub fn serve(&mut self, stylus: &mut VirtualStylus) {
        let runs = stylus.usb(|host, _| host.is_running());
        if self.endpoints.is_some() && !runs {
            // The program sees the end of its connection, as one on a real bus sees its device vanish.
            self.program = None;
            self.endpoints = None;
            stylus.run_for(UNPLUGGED_NS);
        }
        if self.endpoints.is_none() {
            let read = self.usb.enumerate(stylus);
            self.endpoints = read.ok().and_then(|read| bulk_endpoints(&read.configuration));
        }
        if let Some(stream) = self.listener.accept() {
            let has_ended = |program: &Program| has_ended(&program.stream);
            if self.program.as_ref().is_some_and(has_ended) {
                self.end_program(stylus);
            }
            // Without a configured device there is nothing to open.
            if self.program.is_none() && self.endpoints.is_some() {
                self.program = Some(Program {
                    stream,
                    bytes: VecDeque::new(),
                    out: VecDeque::new(),
                    input: VecDeque::new(),
                    most: 0,
                });
            }
        }
        if let (Some(program), Some(endpoints)) = (&mut self.program, self.endpoints)
            && !program.serve(endpoints, &mut self.usb, stylus)
        {
            self.end_program(stylus);
        }
    }

    /// Lets the program go, and calls its transfers off. Otherwise the next program would receive their answers.
    fn end_program(&mut self, stylus: &mut VirtualStylus) {
        let waiting: Vec<TransferId> = (self.program.take())
            .into_iter()
            .flat_map(|program| program.out.into_iter().chain(program.input))
            .collect();
        self.usb.call_off(stylus, &waiting);
    }
}

impl Program {
    /// Serves the program. Returns false if the connection has ended.
    fn serve(&mut self, [output, input]: [u8; 2], usb: &mut UsbHost, stylus: &mut VirtualStylus) -> bool {
        if !self.read() {
            return false;
        }
        loop {
            let answer = match take(&mut self.bytes) {
                Ok(None) => break,
                Err(_) => return false,
                Ok(Some(ToBus::Out(data))) => {
                    let endpoint = output & 0x0F;
                    let transfer = Transfer::Out { endpoint, data };
                    self.out.push_back(stylus.usb(move |host, _| host.submit(transfer)));
                    continue;
                }
                Ok(Some(ToBus::In(bytes))) => {
                    let transfer = Transfer::In {
                        endpoint: input & 0x0F,
                        bytes: bytes as usize,
                    };
                    self.input.push_back(stylus.usb(move |host, _| host.submit(transfer)));
                    self.most = self.most.max(self.input.len());
                    continue;
                }
                Ok(Some(ToBus::ClearOut)) => {
                    FromBus::ClearedOut((usb.clear_halt(stylus, output)).map_err(|error| error.to_string()))
                }
                Ok(Some(ToBus::ClearIn)) => {
                    FromBus::ClearedIn((usb.clear_halt(stylus, input)).map_err(|error| error.to_string()))
                }
            };
            if !self.write(&answer) {
                return false;
            }
        }
        // Only the oldest of each direction can have ended, because a pipe carries one transfer at a time.
        let mut answers = Vec::new();
        for (transfers, is_out) in [(&mut self.out, true), (&mut self.input, false)] {
            while let Some(&id) = transfers.front()
                && let Some(ended) = usb.take_ended(stylus, id)
            {
                transfers.pop_front();
                let ended = ended.result.map_err(|error| error.to_string());
                answers.push(if is_out {
                    FromBus::Out(ended.map(drop))
                } else {
                    FromBus::In(ended)
                });
            }
        }
        answers.iter().all(|answer| self.write(answer))
    }

    /// Reads the bytes that have arrived. Returns false if the connection has ended.
    fn read(&mut self) -> bool {
        while let Some(bytes) = read_some(&mut self.stream, MOST_WAITING) {
            if bytes.is_empty() {
                return true;
            }
            self.bytes.extend(bytes);
        }
        false
    }

    /// Sends a message, and waits while the program does not read. Returns false if the connection has ended.
    fn write(&mut self, message: &FromBus) -> bool {
        write_all(&mut self.stream, &encode(message))
    }
}
