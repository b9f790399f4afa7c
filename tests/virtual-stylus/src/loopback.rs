//! A port of the loopback interface that programs connect to.

use std::net::{Ipv4Addr, TcpListener, TcpStream};

use crate::error::{Error, Result};

/// A port that is listened on. Nothing waits for it.
#[derive(Debug)]
pub struct Loopback(TcpListener);

impl Loopback {
    /// Listens on `port` (0 for any).
    ///
    /// # Errors
    /// The port cannot be listened on.
    pub fn listen(port: u16) -> Result<Self> {
        let told = failure(port);
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(&told)?;
        listener.set_nonblocking(true).map_err(&told)?;
        Ok(Self(listener))
    }

    /// The port.
    ///
    /// # Errors
    /// The system does not give it.
    pub fn port(&self) -> Result<u16> {
        let address = self.0.local_addr().map_err(failure(0))?;
        Ok(address.port())
    }

    /// The next program that has connected, if there is one. Its bytes go out at once, and reading does not wait.
    pub fn accept(&self) -> Option<TcpStream> {
        let (stream, _) = self.0.accept().ok()?;
        stream.set_nonblocking(true).ok()?;
        stream.set_nodelay(true).ok()?;
        Some(stream)
    }
}

fn failure(port: u16) -> impl Fn(std::io::Error) -> Error {
    move |error| Error::Port {
        port,
        reason: error.to_string(),
    }
}
