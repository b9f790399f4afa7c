//! The host on USB behind a socket: it enumerates the device, and carries out the bulk transfers of a program at the
//! other end (`--link usb-virtual:HOST:PORT`).

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;

use virtual_link::usb_messages::{FromBus, ToBus, encode, take};

use crate::error::Result;
use crate::loopback::Loopback;
use crate::model::usb::host::{Transfer, TransferId};
use crate::stylus::VirtualStylus;
use crate::usb_host::{UsbHost, bulk_endpoints};

/// Virtual time from a pulled cable until it is plugged in again.
const UNPLUGGED_NS: u64 = 300_000_000;

/// The host and its socket.
#[derive(Debug)]
pub struct UsbSocket {
    listener: Loopback,
    usb: UsbHost,
    /// Addresses of the endpoints to the device and from it, while it is configured.
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
    /// Largest number of transfers from the device that have waited.
    most: usize,
}

impl UsbSocket {
    /// Listens on `port` of the loopback interface (0 for any).
    ///
    /// # Errors
    /// The port cannot be listened on.
    pub fn listen(port: u16) -> Result<Self> {
        Ok(Self {
            listener: Loopback::listen(port)?,
            usb: UsbHost::default(),
            endpoints: None,
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

    /// True if fewer transfers of the program wait for the device than before, so that it is about to ask for more. A
    /// run that went on meanwhile would be faster than its program.
    pub fn is_ahead(&self) -> bool {
        (self.program.as_ref()).is_some_and(|program| program.input.len() < program.most)
    }

    /// Serves the socket and the device. Enumerates the device if it is not configured, which runs the stylus, and
    /// plugs it in again some time after its cable was pulled.
    ///
    /// # Errors
    /// The run is over.
    pub fn serve(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        let runs = stylus.usb(|host, _| host.is_running())?;
        if self.endpoints.is_some() && !runs {
            self.program = None;
            self.endpoints = None;
            stylus.run_for(UNPLUGGED_NS)?;
        }
        if self.endpoints.is_none() {
            let read = self.usb.enumerate(stylus)?;
            self.endpoints = read
                .ok()
                .and_then(|read| bulk_endpoints(&read.configuration));
        }
        if self.program.is_none()
            && let Some(stream) = self.listener.accept()
            // Without a configured device there is nothing to open.
            && self.endpoints.is_some()
        {
            self.program = Some(Program {
                stream,
                bytes: VecDeque::new(),
                out: VecDeque::new(),
                input: VecDeque::new(),
                most: 0,
            });
        }
        if let (Some(program), Some(endpoints)) = (&mut self.program, self.endpoints)
            && !program.serve(endpoints, &mut self.usb, stylus)?
        {
            let ended = self.program.take();
            let waiting: Vec<TransferId> = ended
                .into_iter()
                .flat_map(|program| program.out.into_iter().chain(program.input))
                .collect();
            self.usb.call_off(stylus, &waiting)?;
        }
        Ok(())
    }
}

impl Program {
    /// Serves the program; false if the connection has ended.
    fn serve(
        &mut self,
        [output, input]: [u8; 2],
        usb: &mut UsbHost,
        stylus: &mut VirtualStylus,
    ) -> Result<bool> {
        if !self.read() {
            return Ok(false);
        }
        loop {
            let answer = match take(&mut self.bytes) {
                Ok(None) => break,
                Err(_) => return Ok(false),
                Ok(Some(ToBus::Out(data))) => {
                    let endpoint = output & 0x0F;
                    let transfer = Transfer::Out { endpoint, data };
                    self.out
                        .push_back(stylus.usb(move |host, _| host.submit(transfer))?);
                    continue;
                }
                Ok(Some(ToBus::In(bytes))) => {
                    let transfer = Transfer::In {
                        endpoint: input & 0x0F,
                        bytes: bytes as usize,
                    };
                    self.input
                        .push_back(stylus.usb(move |host, _| host.submit(transfer))?);
                    self.most = self.most.max(self.input.len());
                    continue;
                }
                Ok(Some(ToBus::ClearOut)) => FromBus::ClearedOut(
                    (usb.clear_halt(stylus, output)?).map_err(|error| error.to_string()),
                ),
                Ok(Some(ToBus::ClearIn)) => FromBus::ClearedIn(
                    (usb.clear_halt(stylus, input)?).map_err(|error| error.to_string()),
                ),
            };
            if !self.write(&answer) {
                return Ok(false);
            }
        }
        while let Some(&id) = self.out.front()
            && let Some(ended) = usb.take_ended(stylus, id)?
        {
            self.out.pop_front();
            let ended = ended.result.map(|_| ()).map_err(|error| error.to_string());
            if !self.write(&FromBus::Out(ended)) {
                return Ok(false);
            }
        }
        while let Some(&id) = self.input.front()
            && let Some(ended) = usb.take_ended(stylus, id)?
        {
            self.input.pop_front();
            let ended = ended.result.map_err(|error| error.to_string());
            if !self.write(&FromBus::In(ended)) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Reads the bytes that have come; false if the connection has ended.
    fn read(&mut self) -> bool {
        let mut buffer = [0; 4096];
        loop {
            match self.stream.read(&mut buffer) {
                Ok(0) => return false,
                Ok(count) => self.bytes.extend(&buffer[..count]),
                Err(failure) if failure.kind() == ErrorKind::WouldBlock => return true,
                Err(failure) if failure.kind() == ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
    }

    /// Sends a message, waiting for a program that does not read; false if the connection has ended.
    fn write(&mut self, message: &FromBus) -> bool {
        self.stream.set_nonblocking(false).is_ok()
            && self.stream.write_all(&encode(message)).is_ok()
            && self.stream.set_nonblocking(true).is_ok()
    }
}
