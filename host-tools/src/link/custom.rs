//! Links that a program brings itself, such as a pipe to another computer.

use std::fmt;
use std::io::{self, Read, Write};
use std::thread;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, DuplexStream, duplex};
use tokio::runtime::Handle;

/// Bytes on their way between a thread that blocks and the link.
const BUFFER_BYTES: usize = 1 << 14;

/// A link that a program brings itself: a stream of bytes to a stylus, such as its serial line behind a pipe, a socket
/// or another computer.
///
/// Frames are COBS-encoded in it and end with a zero byte, as on the serial port. Bytes may come in pieces of any
/// length; none may be lost or changed, and what is damaged is counted and not taken for an answer.
///
/// [`Device::connect_over`](super::Device::connect_over) opens it, and `examples/custom_link.rs` has one.
pub trait CustomLink: Send + Sync {
    /// Name of the link in errors, such as `ssh:rig`.
    fn name(&self) -> String;

    /// Opens the stream: once to connect, and anew after each loss. It is called on a runtime of tokio, so that its
    /// sockets can be made there. The stream before is dropped by then.
    ///
    /// # Errors
    /// The reason for which there is no stream; the caller sees it with the name.
    fn open(&self) -> io::Result<ByteStream>;
}

/// The two ends of an open stream of bytes.
pub struct ByteStream {
    pub(super) reader: Box<dyn AsyncRead + Send + Unpin>,
    pub(super) writer: Box<dyn AsyncWrite + Send + Unpin>,
}

impl ByteStream {
    /// A stream that waits without a thread, such as one of tokio's sockets.
    pub fn new(
        reader: impl AsyncRead + Send + Unpin + 'static,
        writer: impl AsyncWrite + Send + Unpin + 'static,
    ) -> Self {
        Self {
            reader: Box::new(reader),
            writer: Box::new(writer),
        }
    }

    /// A stream that blocks, such as the pipes of a child process; it is read and written by a thread each.
    ///
    /// With the link, `writer` is dropped. `reader` is when it has come to its end, or has brought a further byte:
    /// no program can stop a read that blocks. So the end of `writer` should be that of `reader`, as it is with a
    /// child that ends with its input.
    ///
    /// # Errors
    /// A call outside of [`CustomLink::open`], or a system that gives no thread.
    pub fn blocking(
        reader: impl Read + Send + 'static,
        writer: impl Write + Send + 'static,
    ) -> io::Result<Self> {
        let runtime = Handle::try_current().map_err(io::Error::other)?;
        let (ours, theirs) = duplex(BUFFER_BYTES);
        let (input, runtime_of_input) = (theirs, runtime.clone());
        named("stylus-read", move || {
            carry_in(reader, input, &runtime_of_input)
        })?;
        let (written, output) = duplex(BUFFER_BYTES);
        named("stylus-write", move || carry_out(output, writer, &runtime))?;
        Ok(Self::new(ours, written))
    }
}

impl fmt::Debug for ByteStream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ByteStream")
    }
}

/// Starts a thread that ends by itself.
fn named(name: &str, work: impl FnOnce() -> io::Result<()> + Send + 'static) -> io::Result<()> {
    // The link is told of a failure by the end of its side of the stream.
    let run = move || drop(work());
    thread::Builder::new()
        .name(name.to_owned())
        .spawn(run)
        .map(drop)
}

/// Carries what `reader` brings to `input`, until either ends.
fn carry_in(mut reader: impl Read, mut input: DuplexStream, runtime: &Handle) -> io::Result<()> {
    let mut buffer = [0; 4096];
    loop {
        match reader.read(&mut buffer) {
            Ok(0) => return Ok(()),
            Ok(count) => runtime.block_on(input.write_all(&buffer[..count]))?,
            Err(failure) if failure.kind() == io::ErrorKind::Interrupted => {}
            Err(failure) => return Err(failure),
        }
    }
}

/// Carries what comes from `output` to `writer`, until either ends.
fn carry_out(mut output: DuplexStream, mut writer: impl Write, runtime: &Handle) -> io::Result<()> {
    let mut buffer = [0; 4096];
    loop {
        let count = runtime.block_on(output.read(&mut buffer))?;
        if count == 0 {
            return Ok(());
        }
        writer.write_all(&buffer[..count])?;
        writer.flush()?;
    }
}
