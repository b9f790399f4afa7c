//! USB: enumeration and descriptors.

use virtual_stylus::{Options, VirtualStylus};
use virtual_stylus::usb_host::UsbHost;

use crate::device::{MS, product};

#[test]
fn a_host_enumerates_the_device() {
    let mut stylus = VirtualStylus::new(&product(), Options::default()).unwrap();
    stylus.run_for(300 * MS).unwrap();
    println!("{:?}", stylus.report());
    let mut usb = UsbHost::default();
    let read = usb.enumerate(&mut stylus).unwrap();
    println!("{:?} {:?}", read, stylus.usb(|host, _| host.traffic()));
    println!("{:?} {:?}", stylus.report(), stylus.resets());
    read.unwrap();
}
