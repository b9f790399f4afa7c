//! The serial link: USART3 on PD8 (TX) and PD9 (RX), the virtual serial port of the board's probe.
//!
//! A frame is one COBS frame, ended by a zero byte. Each byte is an interrupt below the tick's priority; the peripheral's
//! FIFO of 16 bytes, 170 µs of them, holds what comes during a tick (RM0433 section 48.5.4). No DMA, so no memory of another
//! domain and no cache to care for.

use embassy_stm32::interrupt::typelevel::{self, Handler};
use embassy_stm32::pac;
use embassy_stm32::peripherals::{self, PD8, PD9};
use embassy_stm32::usart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config, ConfigError,
};
use embassy_stm32::{Peri, bind_interrupts};
use embedded_io_async::{Read, Write};
use model_format::link::{MAX_DEVICE_FRAME_BYTES, MAX_HOST_FRAME_BYTES, SERIAL_BAUD};
use postcard_rpc::header::VarHeader;
use postcard_rpc::server::{WireRx, WireRxErrorKind};
use static_cell::ConstStaticCell;

use crate::link::counters::SERIAL;
use crate::link::outlet::SendFrame;

/// Longest COBS frame of `length` bytes, with the zero: one byte more for every 254, and one.
const fn encoded(length: usize) -> usize {
    length + length / 254 + 2
}

/// Bytes received and not yet looked at: 44 ms of them, about twice as long as a library of the largest size is checked in
/// one go.
const RECEIVED_BYTES: usize = 4 * encoded(MAX_HOST_FRAME_BYTES);

/// Bytes on their way out: the longest frame.
const SENT_BYTES: usize = encoded(MAX_DEVICE_FRAME_BYTES);

bind_interrupts!(struct Interrupts {
    USART3 => LineErrors, BufferedInterruptHandler<peripherals::USART3>;
});

/// Counts errors of the line before embassy's handler clears their flags.
pub struct LineErrors;

#[expect(
    unsafe_code,
    reason = "a handler of embassy's interrupts is unsafe to call; this one only reads and counts"
)]
// SAFETY: it calls for nothing of its caller.
impl Handler<typelevel::USART3> for LineErrors {
    // SAFETY: as above.
    unsafe fn on_interrupt() {
        let flags = pac::USART3.isr().read();
        if flags.pe() | flags.fe() | flags.ne() | flags.ore() {
            SERIAL.count(|counters| &mut counters.line_errors);
        }
    }
}

/// Sets the port up.
///
/// # Errors
/// A rate that the clock cannot give.
pub fn open(
    usart: Peri<'static, peripherals::USART3>,
    tx: Peri<'static, PD8>,
    rx: Peri<'static, PD9>,
) -> Result<(Half, Inlet), ConfigError> {
    static TX: ConstStaticCell<[u8; SENT_BYTES]> = ConstStaticCell::new([0; SENT_BYTES]);
    static RX: ConstStaticCell<[u8; RECEIVED_BYTES]> = ConstStaticCell::new([0; RECEIVED_BYTES]);
    let mut config = Config::default();
    config.baudrate = SERIAL_BAUD;
    let port = BufferedUart::new(usart, rx, tx, TX.take(), RX.take(), Interrupts, config)?;
    let (tx, rx) = port.split();
    Ok((
        Half {
            tx,
            frame: [0; SENT_BYTES],
            broken: true,
        },
        Inlet {
            rx,
            chunk: [0; CHUNK_BYTES],
            from: 0,
            to: 0,
        },
    ))
}

/// The sending half.
pub struct Half {
    tx: BufferedUartTx<'static>,
    frame: [u8; SENT_BYTES],
    /// Whether the last frame may not have gone out whole; a zero ends what there is of it.
    broken: bool,
}

impl Half {
    /// Sends the first `length` bytes of the frame and its zero, after a zero if the frame before is broken.
    ///
    /// A write that finds too little room in embassy's buffer is woken by nobody (embassy-stm32 0.6.0), so each one waits until
    /// the one before has gone out, and finds the buffer empty.
    async fn send(
        &mut self,
        broken: bool,
        length: usize,
    ) -> Result<(), embassy_stm32::usart::Error> {
        if broken {
            self.tx.flush().await?;
            self.tx.write_all(&[0]).await?;
            self.tx.flush().await?;
        }
        self.tx.write_all(&self.frame[..=length]).await?;
        self.tx.flush().await
    }
}

impl SendFrame for Half {
    async fn send_frame(&mut self, frame: &[u8]) -> bool {
        // One byte stays for the zero; a frame of the device fits, or it is not sent.
        let length = match cobs::try_encode(frame, &mut self.frame) {
            Ok(length) if length < self.frame.len() => length,
            _ => return false,
        };
        self.frame[length] = 0;
        // Set while this may be given up half way.
        let broken = core::mem::replace(&mut self.broken, true);
        self.broken = self.send(broken, length).await.is_err();
        !self.broken
    }
}

/// Bytes that are taken from the port's buffer at a time.
const CHUNK_BYTES: usize = 64;

/// The receiving half.
pub struct Inlet {
    rx: BufferedUartRx<'static>,
    /// What was taken and not yet used.
    chunk: [u8; CHUNK_BYTES],
    from: usize,
    to: usize,
}

impl Inlet {
    async fn byte(&mut self) -> u8 {
        while self.from == self.to {
            self.from = 0;
            // An error is counted by the handler; what it has spoilt is a frame that does not decode.
            self.to = self.rx.read(&mut self.chunk).await.unwrap_or(0);
        }
        let byte = self.chunk[self.from];
        self.from += 1;
        byte
    }

    /// The bytes before the next zero, as many as fit, and how many there were.
    async fn encoded_frame(&mut self, buffer: &mut [u8]) -> usize {
        let mut length: usize = 0;
        loop {
            match self.byte().await {
                0 => return length,
                byte => {
                    if let Some(place) = buffer.get_mut(length) {
                        *place = byte;
                    }
                    length = length.saturating_add(1);
                }
            }
        }
    }
}

/// Buffer for a frame from the host, before it is decoded in place.
pub type Buffer = [u8; encoded(MAX_HOST_FRAME_BYTES)];

/// A buffer with nothing in it.
pub const EMPTY: Buffer = [0; encoded(MAX_HOST_FRAME_BYTES)];

impl WireRx for Inlet {
    type Error = WireRxErrorKind;

    async fn receive<'a>(&mut self, buffer: &'a mut [u8]) -> Result<&'a mut [u8], WireRxErrorKind> {
        let length = loop {
            match self.encoded_frame(buffer).await {
                // Zeros between frames are allowed.
                0 => {}
                length => break length,
            }
        };
        let Some(encoded) = buffer.get_mut(..length) else {
            SERIAL.count(|counters| &mut counters.oversized);
            return Err(WireRxErrorKind::ReceivedMessageTooLarge);
        };
        let decoded = cobs::decode_in_place(encoded).unwrap_or(0);
        if decoded > MAX_HOST_FRAME_BYTES {
            SERIAL.count(|counters| &mut counters.oversized);
            return Err(WireRxErrorKind::ReceivedMessageTooLarge);
        }
        let frame = &mut buffer[..decoded];
        if VarHeader::take_from_slice(frame).is_none() {
            SERIAL.count(|counters| &mut counters.malformed);
            return Err(WireRxErrorKind::Other);
        }
        Ok(frame)
    }
}
