//! The USB core, register by register, and the host at the other end of the cable.

use rigless::time::VirtualNanos;
use stylus_board::ALL;
use virtual_stylus::Electrical;
use virtual_stylus::model::usb::WINDOW_BASE;
use virtual_stylus::model::usb::core::{Core, Handshake, InAnswer, Pid};
use virtual_stylus::model::usb::host::{Host, Transfer};
use virtual_stylus::model::usb::registers::*;

use crate::bench::{AHB1ENR, EmulatedPart, RCC};

/// `MPSIZ`: 64 bytes.
const PACKET: u32 = 0x40;
const BULK: u32 = 2 << 18;

const DIEPCTL1: u64 = DIEP0 + ENDPOINT_STEP;
const DIEPINT1: u64 = DIEPCTL1 + INT;
const DIEPTSIZ1: u64 = DIEPCTL1 + TSIZ;
const DTXFSTS1: u64 = DIEPCTL1 + TXFSTS;
const DOEPCTL1: u64 = DOEP0 + ENDPOINT_STEP;
const DOEPTSIZ1: u64 = DOEPCTL1 + TSIZ;
const DOEPINT0: u64 = DOEP0 + INT;
const FIFO1: u64 = FIFO0 + FIFO_STEP;

/// A core with endpoint 1 in use in both directions, its FIFOs configured, and all interrupts unmasked.
fn configured() -> Core {
    let mut core = Core::default();
    let bulk = PACKET | EPCTL_USBAEP | BULK | EPCTL_SD0PID;
    for (register, value) in [
        (GRXFSIZ, 64),
        (DIEPTXF0, 16 << 16 | 64),
        (DIEPTXF1, 16 << 16 | 0x50),
        (
            GINTMSK,
            GINTSTS_RXFLVL | GINTSTS_USBRST | GINTSTS_ENUMDNE | GINTSTS_IEPINT | GINTSTS_OEPINT,
        ),
        (GAHBCFG, 1),
        (DIEPMSK, 1),
        (DOEPMSK, 1 << 3 | 1),
        (DAINTMSK, u32::MAX),
        (DIEPCTL1, bulk | 1 << 22 | EPCTL_SNAK),
        (DOEPCTL1, bulk | EPCTL_CNAK | EPCTL_EPENA),
        (DOEPTSIZ1, 1 << 19 | 64),
    ] {
        core.write(register, value);
    }
    core.write(GINTSTS, u32::MAX);
    core
}

/// Makes endpoint 1 send `words`.
fn send(core: &mut Core, words: &[u32], bytes: u32) {
    core.write(DIEPTSIZ1, 1 << 19 | bytes);
    let control = core.peek(DIEPCTL1);
    core.write(DIEPCTL1, control | EPCTL_CNAK | EPCTL_EPENA);
    for &word in words {
        core.write(FIFO1, word);
    }
}

/// Empties the receive FIFO. Returns the kind of each status, with the words that belong to it.
fn drain(core: &mut Core) -> Vec<(u32, Vec<u32>)> {
    let mut entries = Vec::new();
    while core.peek(GINTSTS) & GINTSTS_RXFLVL != 0 {
        let peeked = core.peek(GRXSTSR);
        let status = core.read(GRXSTSP);
        assert_eq!(status, peeked);
        let words = (status >> 4 & 0x7FF).div_ceil(4);
        let words = (0..words).map(|_| core.read(FIFO0)).collect();
        entries.push((status >> 17 & 0xF, words));
    }
    entries
}

#[test]
fn a_setup_is_taken_whatever_its_endpoint_does_and_is_complete_with_the_next_token() {
    let mut core = configured();
    core.write(DIEP0, EPCTL_STALL);
    core.write(DOEP0, EPCTL_STALL | EPCTL_SNAK);
    assert_eq!(core.answer_in(0), Some(InAnswer::Stall));
    assert_eq!(core.setup([1, 2, 3, 4, 5, 6, 7, 8]), Some(Handshake::Ack));
    assert_eq!(core.answer_in(0), Some(InAnswer::Nak), "a SETUP ends the stall");
    assert_eq!(drain(&mut core), [(0b0110, vec![0x0403_0201, 0x0807_0605])]);
    assert_eq!(core.peek(DOEPINT0) & 1 << 3, 0);
    assert_eq!(core.token_in(0), Some(InAnswer::Nak));
    assert_eq!(
        core.peek(GINTSTS) & GINTSTS_OEPINT,
        0,
        "the entry has to be popped first"
    );
    assert_eq!(drain(&mut core), [(0b0100, vec![])]);
    assert_eq!(core.peek(DOEPINT0) & 1 << 3, 1 << 3);
    assert_eq!(core.peek(DAINT), 1 << 16);
    assert_ne!(core.peek(GINTSTS) & GINTSTS_OEPINT, 0);
    assert!(core.interrupt());
    core.write(DOEPINT0, 1 << 3);
    assert_eq!(core.peek(GINTSTS) & GINTSTS_OEPINT, 0);
}

#[test]
fn an_out_endpoint_takes_what_it_was_set_up_for_and_refuses_until_its_nak_is_cleared() {
    let mut core = configured();
    let packet: Vec<u8> = (0..64).collect();
    assert_eq!(core.out(1, Pid::Data0, &packet), Some(Handshake::Ack));
    assert_eq!(core.out(1, Pid::Data1, &packet), Some(Handshake::Nak));
    assert_ne!(core.peek(DOEPCTL1) & EPCTL_NAKSTS, 0);
    let entries = drain(&mut core);
    assert_eq!(entries[0].0, 0b0010);
    assert_eq!((entries[0].1[0], entries[0].1[15]), (0x0302_0100, 0x3F3E_3D3C));
    assert_eq!(entries[1], (0b0011, vec![]));
    assert_eq!(core.peek(DOEPCTL1) & EPCTL_EPENA, 0, "the transfer is complete");
    core.write(DOEPTSIZ1, 1 << 19 | 64);
    core.write(DOEPCTL1, core.peek(DOEPCTL1) | EPCTL_CNAK);
    // The host sends the same packet again because the acknowledgement was lost.
    assert_eq!(core.out(1, Pid::Data0, &packet), Some(Handshake::Ack));
    assert_eq!(drain(&mut core), [], "it is acknowledged and dropped");
    assert_eq!(core.out(1, Pid::Data1, &[9, 8, 7]), Some(Handshake::Ack));
    assert_eq!(drain(&mut core), [(0b0010, vec![0x0007_0809]), (0b0011, vec![])]);
}

#[test]
fn a_receive_fifo_without_room_refuses_data() {
    let mut core = configured();
    core.write(GRXFSIZ, 20);
    assert_eq!(core.out(1, Pid::Data0, &[0; 64]), Some(Handshake::Ack));
    core.write(DOEPTSIZ1, 1 << 19 | 64);
    core.write(DOEPCTL1, core.peek(DOEPCTL1) | EPCTL_CNAK);
    assert_eq!(core.out(1, Pid::Data1, &[0; 64]), Some(Handshake::Nak));
    drain(&mut core);
    assert_eq!(core.out(1, Pid::Data1, &[0; 64]), Some(Handshake::Ack));
    core.write(GRSTCTL, 1 << 4);
    assert_eq!(drain(&mut core), [], "flushed");
}

#[test]
fn an_in_endpoint_sends_whole_packets_and_again_until_they_are_acknowledged() {
    let mut core = configured();
    assert_eq!(core.token_in(1), Some(InAnswer::Nak));
    assert_eq!(core.peek(DTXFSTS1), 16);
    send(&mut core, &[0x0403_0201], 6);
    assert_eq!(core.token_in(1), Some(InAnswer::Nak), "half of it is not there");
    core.write(FIFO1, 0x0605);
    assert_eq!(core.peek(DTXFSTS1), 14);
    let answer = Some(InAnswer::Data(Pid::Data0, vec![1, 2, 3, 4, 5, 6]));
    assert_eq!(core.token_in(1), answer);
    assert_eq!(core.token_in(1), answer, "without an acknowledgement the same again");
    assert_eq!(core.peek(DIEPCTL1) & EPCTL_EPENA, EPCTL_EPENA);
    core.acknowledged(1);
    assert_eq!(core.peek(DIEPCTL1) & EPCTL_EPENA, 0);
    assert_eq!(core.peek(DIEPINT1) & 1, 1);
    assert_eq!(core.peek(DAINT), 1 << 1);
    assert_ne!(core.peek(GINTSTS) & GINTSTS_IEPINT, 0);
    assert_eq!(core.token_in(1), Some(InAnswer::Nak));
    // An empty packet follows, with the other toggle.
    send(&mut core, &[], 0);
    assert_eq!(core.token_in(1), Some(InAnswer::Data(Pid::Data1, vec![])));
}

#[test]
fn a_disabled_or_flushed_in_endpoint_sends_nothing() {
    let mut core = configured();
    send(&mut core, &[7], 4);
    core.write(GRSTCTL, 1 << 5 | 1 << 6);
    assert_eq!(core.token_in(1), Some(InAnswer::Nak));
    assert_eq!(
        core.peek(DIEPCTL1) & EPCTL_EPENA,
        EPCTL_EPENA,
        "a flush does not disable it"
    );
    core.write(DIEPCTL1, core.peek(DIEPCTL1) | EPCTL_SNAK | EPCTL_EPDIS);
    assert_eq!(core.peek(DIEPCTL1) & EPCTL_EPENA, 0);
    assert_eq!(core.peek(DIEPINT1) & 2, 2);
    send(&mut core, &[8], 4);
    assert_eq!(core.token_in(1), Some(InAnswer::Data(Pid::Data0, vec![8, 0, 0, 0])));
}

const USB2OTG: u64 = 1 << 27;
const HSI48_ON: u64 = 1 << 12;
const D2CCIP2R: u64 = RCC + 0x54;
const USB_FROM_HSI48: u64 = 3 << 20;
const APB1HENR: u64 = RCC + 0xEC;
const CRS_CLOCK: u64 = 1 << 1;
const CRS_CR: u64 = 0x4000_8400;
const CRS_CFGR: u64 = CRS_CR + 4;
const TRIMS: u64 = 1 << 6 | 1 << 5;
const MS: u64 = 1_000_000;

/// A part whose USB runs on HSI48, which deviates by `ppm`.
fn part(ppm: i64) -> EmulatedPart {
    let mut electrical = Electrical::of(&ALL[0]);
    electrical.clocks.hsi48_ppm = ppm;
    let mut bench = EmulatedPart::new(electrical);
    bench.write(AHB1ENR, USB2OTG);
    bench.write(RCC, HSI48_ON | 1);
    bench.write(D2CCIP2R, USB_FROM_HSI48);
    bench.wait(MS / 100);
    bench
}

/// Pulls the line up, with a valid session.
fn connect(bench: &mut EmulatedPart) {
    bench.write(WINDOW_BASE + GCCFG, 1 << 16);
    bench.write(WINDOW_BASE + GOTGCTL, 0b11 << 6);
    bench.write(WINDOW_BASE + DCTL, 0);
}

/// Puts the cable in and resets the bus.
fn plug(bench: &mut EmulatedPart) {
    drive(bench, Host::plug);
    drive(bench, |host, now_ns| host.reset_bus(now_ns, 10 * MS));
    bench.wait(10 * MS);
}

fn drive<T>(bench: &mut EmulatedPart, work: impl FnOnce(&mut Host, u64) -> T) -> T {
    bench.part.drive_usb(bench.now, work)
}

fn read(bench: &mut EmulatedPart, register: u64) -> u32 {
    bench.read(WINDOW_BASE + register) as u32
}

#[test]
fn a_pull_up_is_seen_while_the_cable_is_in_and_silence_suspends_with_or_without_it() {
    let mut bench = part(0);
    connect(&mut bench);
    bench.wait(2_900_000);
    assert_eq!(read(&mut bench, GINTSTS) & GINTSTS_USBSUSP, 0);
    bench.wait(200_000);
    assert_eq!(read(&mut bench, GINTSTS) & GINTSTS_USBSUSP, GINTSTS_USBSUSP);
    assert_eq!(read(&mut bench, DSTS) & 1, 1);
    assert!(!drive(&mut bench, |host, _| host.sees_device()));
    drive(&mut bench, Host::plug);
    assert!(drive(&mut bench, |host, _| host.sees_device()));
    drive(&mut bench, |host, now_ns| host.reset_bus(now_ns, 10 * MS));
    bench.wait(11 * MS);
    assert_eq!(
        read(&mut bench, GINTSTS) & (GINTSTS_USBRST | GINTSTS_ENUMDNE),
        GINTSTS_USBRST | GINTSTS_ENUMDNE
    );
    assert_eq!(read(&mut bench, DSTS) & 1, 0);
    // Frames are counted, one per millisecond.
    let frame = read(&mut bench, DSTS) >> 8 & 0x3FFF;
    bench.wait(10 * MS);
    assert_eq!(read(&mut bench, DSTS) >> 8 & 0x3FFF, frame + 10);
    bench.write(WINDOW_BASE + DCTL, 1 << 1);
    assert!(!drive(&mut bench, |host, _| host.sees_device()), "soft disconnect");
}

/// Returns how many packets endpoint 1 receives in `frames` frames, and the serial number read from each. The host
/// always has another packet, and breaks `per_million` of a million.
fn taken(per_million: u64, frames: u64) -> (u64, Vec<u8>) {
    let mut bench = part(0);
    connect(&mut bench);
    plug(&mut bench);
    drive(&mut bench, move |host, _| {
        host.break_packets(per_million, 3);
        // Each packet holds its number.
        let data = (0..frames * 20).flat_map(|number| [number as u8; 64]).collect();
        host.submit(Transfer::Out { endpoint: 1, data });
    });
    for (register, value) in [
        (GRXFSIZ, 64),
        (
            DOEPCTL1,
            u64::from(PACKET | EPCTL_USBAEP | BULK | EPCTL_SD0PID | EPCTL_CNAK),
        ),
    ] {
        bench.write(WINDOW_BASE + register, value);
    }
    let until = VirtualNanos(bench.now.0 + frames * MS);
    let mut numbers = Vec::new();
    while bench.now < until {
        bench.step(until);
        while read(&mut bench, GINTSTS) & GINTSTS_RXFLVL != 0 {
            let status = read(&mut bench, GRXSTSP);
            let words = (status >> 4 & 0x7FF).div_ceil(4);
            let words: Vec<u32> = (0..words).map(|_| read(&mut bench, FIFO0)).collect();
            numbers.extend(words.first().map(|word| *word as u8));
            let control = u64::from(read(&mut bench, DOEPCTL1));
            bench.write(WINDOW_BASE + DOEPCTL1, control | u64::from(EPCTL_CNAK));
        }
    }
    (numbers.len() as u64, numbers)
}

#[test]
fn a_frame_carries_no_more_full_bulk_packets_than_full_speed_allows() {
    // USB 2.0 table 5-9: at most 19 of 64 bytes.
    let (packets, _) = taken(0, 20);
    println!("{packets} packets in 20 frames");
    // The model's longest turnaround and worst bit stuffing leave room for at least 16.
    assert!((16 * 20..=19 * 20).contains(&packets), "{packets}");
}

#[test]
fn packets_that_break_are_sent_again_and_taken_once_each_in_order() {
    let (packets, numbers) = taken(20_000, 60);
    assert!(packets > 600, "{packets}");
    let expected: Vec<u8> = (0..packets).map(|number| number as u8).collect();
    assert_eq!(numbers, expected);
}

/// Returns whether a packet to the part's address is answered, with HSI48 off by `ppm` and trimmed by the frames that
/// `source` selects.
fn answered(ppm: i64, source: Option<u64>) -> bool {
    let mut bench = part(ppm);
    connect(&mut bench);
    if let Some(source) = source {
        bench.write(APB1HENR, CRS_CLOCK);
        bench.write(CRS_CFGR, source << 28);
        bench.write(CRS_CR, TRIMS);
    }
    plug(&mut bench);
    drive(&mut bench, |host, _| {
        host.submit(Transfer::Control {
            setup: [0x80, 6, 0, 1, 0, 0, 18, 0],
            data: Vec::new(),
        });
    });
    bench.wait(MS);
    read(&mut bench, GINTSTS) & GINTSTS_RXFLVL != 0
}

#[test]
fn a_device_is_heard_while_its_clock_is_within_a_quarter_of_a_percent() {
    assert!(answered(2_400, None) && answered(-2_400, None));
    assert!(!answered(2_600, None) && !answered(-2_600, None));
    // Frames of the other USB core do not trim the oscillator.
    assert!(!answered(5_000, Some(2)));
    assert!(answered(5_000, Some(3)));
}
