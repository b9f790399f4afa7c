//! USB: enumeration, and what the link carries.

use model_format::link::{RecordStartEndpoint, RecordStopEndpoint};
use virtual_stylus::Options;

use crate::device::{Device, MS, SECOND};
use crate::library;

#[test]
fn an_upload_over_usb() {
    let mut device = Device::on_usb(Options::default());
    let large = library::large();
    let begin = device.stylus.now_ns();
    let wall = std::time::Instant::now();
    let committed = device.upload(&large);
    let nanos = device.stylus.now_ns() - begin;
    println!("{} bytes in {} ms: {} KB/s, wall {:?}", large.len(), nanos / MS, large.len() as f64 / nanos as f64 * 1e6, wall.elapsed());
    println!("{:?}", device.activate(committed.slot));
    device.keep_alive(true);
    device.request::<RecordStartEndpoint>(&()).unwrap();
    let wall = std::time::Instant::now();
    device.run_for(2 * SECOND);
    println!("2 s wall {:?}", wall.elapsed());
    let stopped = device.request::<RecordStopEndpoint>(&()).unwrap();
    device.run_for(20 * MS);
    println!("{stopped:?} {}", device.blocks.len());
    println!("{:?}", device.status());
    let (stylus, _) = device.usb();
    println!("{:?}", stylus.usb(|host, _| host.traffic()));
    println!("{:?} {:?}", stylus.report().unwrap().told, stylus.resets());
}
