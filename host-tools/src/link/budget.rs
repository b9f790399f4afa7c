//! Budget of an upload: the least time that erasing, programming and the link take, by their data sheets. The rest of
//! an upload's time is waiting, checking and proving.
//!
//! | part | figure | source |
//! |---|---|---|
//! | erasing a sector of 128 KB | 1.0 s | DS12110, flash memory programming, typical, parallelism of 64 bits |
//! | programming a flash word of 32 bytes | 100 µs | the same |
//! | the serial port | 10 bits per byte at [`SERIAL_BAUD`] | RM0433, USART |
//! | USB at full speed | 19 packets of 64 bytes per millisecond | USB 2.0, table 5-9 |

use model_format::limits::{FLASH_WORD_BYTES, MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{MAX_CHUNK_BYTES, SERIAL_BAUD};
use serde::Serialize;

use super::LinkAddress;

/// Typical time to erase a sector, s.
const ERASE_S: f64 = 1.0;
/// Typical time to program a flash word, s.
const PROGRAM_S: f64 = 100e-6;
/// Bytes of a sector.
const SECTOR_BYTES: usize = 128 << 10;
/// Packets of USB per second at most.
const PACKETS_PER_S: f64 = 19_000.0;
/// Bytes of a packet.
const PACKET_BYTES: usize = 64;
/// Bytes of a chunk's frame beside its data: the key, the number, the offset and the length.
const FRAME_BYTES: usize = 17;
/// Words beside the library's: the slot's header, and the mark of a proof.
const MORE_WORDS: usize = 2;

const _: () = assert!(SLOT_BYTES.is_multiple_of(SECTOR_BYTES) && MAX_LIBRARY_BYTES < SLOT_BYTES);

/// Least times of an upload, s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Budget {
    /// Erasing the sectors of the library, and that of the slot's header.
    pub erase_s: f64,
    /// Programming the flash words.
    pub program_s: f64,
    /// Carrying the chunks over the link. Most of it goes on while words are programmed. 0 over a
    /// [`CustomLink`](super::CustomLink), of which nothing is known.
    pub link_s: f64,
}

impl Budget {
    /// The budget of a library of `bytes` over the link of `address`.
    ///
    /// ```
    /// use host_tools::link::budget::Budget;
    /// let budget = Budget::of(50_000, &"usb".parse().unwrap());
    /// assert_eq!(budget.erase_s, 2.0);
    /// assert!(budget.least_s() < 2.2);
    /// ```
    pub fn of(bytes: usize, address: &LinkAddress) -> Self {
        let header = SLOT_BYTES / SECTOR_BYTES - 1;
        let data = bytes.div_ceil(SECTOR_BYTES);
        let sectors = if data > header { data } else { data + 1 };
        let words = bytes.div_ceil(FLASH_WORD_BYTES) + MORE_WORDS;
        let chunks = (0..bytes).step_by(MAX_CHUNK_BYTES);
        let frames = chunks.map(|at| (bytes - at).min(MAX_CHUNK_BYTES) + FRAME_BYTES);
        let link_s = match address {
            LinkAddress::Usb { .. } | LinkAddress::UsbVirtual { .. } => {
                // A transfer ends with a packet that is not full.
                let packets: usize = frames.map(|frame| frame / PACKET_BYTES + 1).sum();
                packets as f64 / PACKETS_PER_S
            }
            LinkAddress::Serial { .. } | LinkAddress::Tcp { .. } => {
                // COBS adds a byte per 254, one more, and the zero.
                let bytes: usize = frames.map(|frame| frame + frame / 254 + 2).sum();
                bytes as f64 * 10.0 / f64::from(SERIAL_BAUD)
            }
            // Nothing is known of it.
            LinkAddress::Custom { .. } => 0.0,
        };
        Self {
            erase_s: sectors as f64 * ERASE_S,
            program_s: words as f64 * PROGRAM_S,
            link_s,
        }
    }

    /// Least time of the whole, s: nothing is programmed while a sector is erased, and the link carries while words are
    /// programmed.
    pub fn least_s(&self) -> f64 {
        self.erase_s + self.program_s.max(self.link_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_takes_the_sectors_it_reaches_and_that_of_the_header_once() {
        let erase_s = |bytes| Budget::of(bytes, &"usb".parse().unwrap()).erase_s;
        assert_eq!(erase_s(1), 2.0);
        assert_eq!(erase_s(SECTOR_BYTES), 2.0);
        assert_eq!(erase_s(SECTOR_BYTES + 1), 3.0);
        assert_eq!(erase_s(3 * SECTOR_BYTES), 4.0);
        assert_eq!(erase_s(MAX_LIBRARY_BYTES), 4.0);
    }

    #[test]
    fn the_serial_port_is_slower_than_the_flash_and_usb_is_not() {
        let of = |link: &str| Budget::of(50_000, &link.parse().unwrap());
        let (serial, usb) = (of("serial:/dev/tty"), of("usb"));
        assert!(serial.link_s > serial.program_s && usb.link_s < usb.program_s);
        assert!((0.5..0.7).contains(&serial.link_s), "{serial:?}");
        assert!((0.15..0.17).contains(&usb.program_s), "{usb:?}");
    }
}
