//! The serial link: USART3 on the board's pins.
//!
//! A frame is one COBS frame, ended by a zero byte. Each byte causes an interrupt of lower priority than the tick. The
//! peripheral's FIFO of 16 bytes, which is 170 µs, holds the bytes that come during a tick (RM0433 section 48.5.4).
//! There is no DMA, so no buffer needs memory of another domain or cache maintenance.

use embassy_stm32::interrupt::typelevel::{self, Handler};
use embassy_stm32::pac;
use embassy_stm32::peripherals;
use embassy_stm32::usart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config, ConfigError,
};
use embassy_stm32::{Peri, bind_interrupts};
use embedded_io_async::{Read, Write};
use model_format::link::{MAX_DEVICE_FRAME_BYTES, MAX_HOST_FRAME_BYTES, SERIAL_BAUD};
use static_cell::ConstStaticCell;
use stylus_board::pin;

use crate::link::outlet::{ReceiveFrame, SERIAL_COUNTERS, SendFrame};

/// Length of the longest COBS frame of `length` bytes: one byte more per 254, one more, and the zero.
const fn encoded(length: usize) -> usize {
    length + length / 254 + 2
}

/// Length of the buffer of bytes received and not yet read: 44 ms. A step of decoding and a plan, between which tasks
/// do not yield, take far less (`STEP_INSTRUCTIONS` and `PLAN_INSTRUCTIONS` of `model_format::limits`).
const RECEIVED_BYTES: usize = 4 * encoded(MAX_HOST_FRAME_BYTES);

/// Length of the buffer of bytes to send: the longest frame.
const SENT_BYTES: usize = encoded(MAX_DEVICE_FRAME_BYTES);

bind_interrupts!(struct Interrupts {
    USART3 => LineErrors, BufferedInterruptHandler<peripherals::USART3>;
});

/// Handler that counts errors of the line before embassy's handler clears their flags.
pub struct LineErrors;

#[expect(
    unsafe_code,
    reason = "handlers of embassy's interrupts are unsafe to call; this one only reads and counts"
)]
// SAFETY: it requires nothing of its caller.
impl Handler<typelevel::USART3> for LineErrors {
    // SAFETY: as above.
    unsafe fn on_interrupt() {
        let flags = pac::USART3.isr().read();
        if flags.pe() | flags.fe() | flags.ne() | flags.ore() {
            SERIAL_COUNTERS.count(|counters| &mut counters.line_errors);
        }
    }
}

/// Sets up the port and returns its sender and receiver.
pub fn open(
    usart: Peri<'static, peripherals::USART3>,
    tx: Peri<'static, pin!(peripherals::serial_tx)>,
    rx: Peri<'static, pin!(peripherals::serial_rx)>,
) -> Result<(Sender, Receiver), ConfigError> {
    static TX: ConstStaticCell<[u8; SENT_BYTES]> = ConstStaticCell::new([0; SENT_BYTES]);
    // The largest buffer, for which the DTCM has no space. It holds zeros, because the start clears SRAM 4.
    #[expect(unsafe_code, reason = "a place in a memory that the start clears")]
    #[unsafe(link_section = ".sram4.received")]
    static RX: ConstStaticCell<[u8; RECEIVED_BYTES]> = ConstStaticCell::new([0; RECEIVED_BYTES]);
    let mut config = Config::default();
    config.baudrate = SERIAL_BAUD;
    let port = BufferedUart::new(usart, rx, tx, TX.take(), RX.take(), Interrupts, config)?;
    let (tx, rx) = port.split();
    Ok((
        Sender {
            tx,
            frame: [0; SENT_BYTES],
            broken: true,
        },
        Receiver {
            rx,
            chunk: [0; CHUNK_BYTES],
            from: 0,
            to: 0,
        },
    ))
}

/// Sender of frames.
pub struct Sender {
    tx: BufferedUartTx<'static>,
    frame: [u8; SENT_BYTES],
    /// True if possibly only a part of the last frame has been sent; a zero ends that part.
    broken: bool,
}

impl Sender {
    /// Sends the first `length` bytes of the frame and its zero. If the previous frame is `broken`, a zero is sent
    /// first.
    ///
    /// A write that finds too little space in embassy's buffer is never woken (embassy-stm32 0.6.0). So each write
    /// waits until the previous one has been sent, and finds the buffer empty.
    async fn send(&mut self, broken: bool, length: usize) -> Result<(), embassy_stm32::usart::Error> {
        if broken {
            self.tx.flush().await?;
            self.tx.write_all(&[0]).await?;
            self.tx.flush().await?;
        }
        self.tx.write_all(&self.frame[..=length]).await?;
        self.tx.flush().await
    }
}

impl SendFrame for Sender {
    async fn send_frame(&mut self, frame: &[u8]) -> bool {
        // One byte is left for the zero. A frame that does not fit is not sent.
        let length = match cobs::try_encode(frame, &mut self.frame) {
            Ok(length) if length < self.frame.len() => length,
            _ => return false,
        };
        self.frame[length] = 0;
        // Set during the send, because its caller may stop waiting before the end.
        let broken = core::mem::replace(&mut self.broken, true);
        self.broken = self.send(broken, length).await.is_err();
        !self.broken
    }
}

/// Largest number of bytes that are taken from the port's buffer at a time.
const CHUNK_BYTES: usize = 64;

/// Receiver of frames.
pub struct Receiver {
    rx: BufferedUartRx<'static>,
    /// Bytes taken from the port; those at `from..to` are not yet used.
    chunk: [u8; CHUNK_BYTES],
    from: usize,
    to: usize,
}

impl Receiver {
    async fn byte(&mut self) -> u8 {
        while self.from == self.to {
            self.from = 0;
            // The handler counts an error of the line. The damaged frame does not decode.
            self.to = self.rx.read(&mut self.chunk).await.unwrap_or(0);
        }
        let byte = self.chunk[self.from];
        self.from += 1;
        byte
    }

    /// Reads the bytes before the next zero, and returns their number. Keeps as many as fit into `buffer`.
    async fn encoded_frame(&mut self, buffer: &mut [u8]) -> usize {
        let mut length: usize = 0;
        loop {
            match self.byte().await {
                0 => return length,
                byte => {
                    if let Some(slot) = buffer.get_mut(length) {
                        *slot = byte;
                    }
                    length = length.saturating_add(1);
                }
            }
        }
    }
}

/// Buffer for a frame from the host, which is decoded in place.
pub type Buffer = [u8; encoded(MAX_HOST_FRAME_BYTES)];

/// An empty buffer.
pub const EMPTY: Buffer = [0; encoded(MAX_HOST_FRAME_BYTES)];

impl ReceiveFrame for Receiver {
    async fn receive_frame(&mut self, buffer: &mut [u8]) -> Option<usize> {
        let length = loop {
            match self.encoded_frame(buffer).await {
                // A zero between frames is allowed.
                0 => {}
                length => break length,
            }
        };
        let decoded = match buffer.get_mut(..length) {
            Some(encoded) => cobs::decode_in_place(encoded).unwrap_or(0),
            None => usize::MAX,
        };
        if decoded > MAX_HOST_FRAME_BYTES {
            SERIAL_COUNTERS.count(|counters| &mut counters.oversized);
            return None;
        }
        Some(decoded)
    }
}
