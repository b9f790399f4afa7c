//! Durations on the wire.

use super::pending::Packets;
use super::transfer::PACKET_BYTES;

/// A bit's time in thousandths of a nanosecond.
pub(super) const PICOS_PER_BIT: u64 = 83_333;
pub(super) const FRAME_NS: u64 = 1_000_000;
/// Bits of a token, of a handshake, and of a data packet beside its data: sync, identifiers, CRC and end of packet.
pub(super) const TOKEN_BITS: u64 = 35;
pub(super) const HANDSHAKE_BITS: u64 = 19;
pub(super) const DATA_BITS: u64 = 35;
/// Longest time to an answer, and the wait for one that does not come (section 7.1.19).
pub(super) const TURNAROUND_BITS: u64 = 8;
pub(super) const TIMEOUT_BITS: u64 = 18;
/// Time left free at the end of a frame.
pub(super) const GUARD_NS: u64 = 3_500;
pub(super) fn nanos(bits: u64) -> u64 {
    bits * PICOS_PER_BIT / 1000
}

pub(super) fn data_nanos(bytes: usize) -> u64 {
    nanos(DATA_BITS + (bytes as u64 * 8 * 7).div_ceil(6))
}

/// Duration of a transaction that the device refuses.
pub(super) fn refusal_nanos(packets: &Packets) -> u64 {
    let data_ns = match packets {
        Packets::Setup(_) => data_nanos(8),
        Packets::Out { data, .. } => data_nanos(data.len()),
        Packets::In { .. } => 0,
    };
    data_ns + nanos(TOKEN_BITS + 2 * TURNAROUND_BITS + HANDSHAKE_BITS)
}

/// Longest duration of a transaction.
pub(super) fn longest_nanos(packets: &Packets) -> u64 {
    refusal_nanos(packets)
        + match packets {
            Packets::In { .. } => data_nanos(PACKET_BYTES) + nanos(TURNAROUND_BITS),
            _ => 0,
        }
}
