//! The USB link: full speed on PA11 (DM) and PA12 (DP), one interface of the vendor's class with a bulk endpoint in
//! each direction.
//!
//! A frame is a bulk transfer, ended by a packet that is not full. Windows selects its own driver (WinUSB) by the
//! descriptors of Microsoft OS 2.0; other systems need no driver.
//!
//! embassy's driver waits for the peripheral without a bound. Therefore this module first tests, within bounds, that
//! the peripheral answers; if it does not, the device has its serial link only.

use embassy_futures::yield_now;
use embassy_stm32::pac::{PWR, USB_OTG_FS};
use embassy_stm32::peripherals::{self, PA11, PA12};
use embassy_stm32::{Peri, bind_interrupts, rcc, uid, usb};
use embassy_time::{Duration, Instant, Timer};
use embassy_usb::driver::{Endpoint, EndpointError, EndpointIn, EndpointOut};
use embassy_usb::msos::{self, windows_version};
use embassy_usb::{Builder, Config, UsbDevice};
use model_format::link::{MAX_HOST_FRAME_BYTES, USB_PRODUCT, USB_PRODUCT_ID, USB_VENDOR_ID};
use static_cell::ConstStaticCell;
use stylus_board::BOARD;

use crate::link::otg::control::PACKET_BYTES;
use crate::link::otg::{BulkIn, BulkOut, Driver, Listen, Watch};
use crate::link::outlet::{ReceiveFrame, SendFrame, USB_COUNTERS};

/// Identifier by which programs on Windows find the interface; generated once, for this interface.
const INTERFACE_GUIDS: &[&str] = &["{6D1F0C5A-9B0E-4C86-8F2B-51E6C2F5B0A7}"];

/// Longest wait for the peripheral, which needs 25 ms to change to device mode (RM0433, OTG_GUSBCFG.FDMOD).
const READY_LIMIT: Duration = Duration::from_millis(100);

/// Core identifiers that embassy's driver supports and this part may have (RM0433, OTG_CID).
const CORES: [u32; 5] = [0x2000, 0x2100, 0x2300, 0x3000, 0x3100];

/// Most current from the socket, mA.
const SUPPLY_MA: u16 = BOARD.usb_ma;

/// Class of vendor-specific interfaces (USB 2.0, section 9.6.1).
const VENDOR_CLASS: u8 = 0xFF;

/// Buffer of the bytes received by all endpoints and not yet read.
static OUT: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);

bind_interrupts!(struct Interrupts {
    OTG_FS => Watch, usb::InterruptHandler<peripherals::USB_OTG_FS>, Listen;
});

/// Device on the bus, which [`UsbDevice::run`] serves.
pub type Device = UsbDevice<'static, Driver>;

/// Sets up the link and returns device, sender and receiver. [`answers`] must have returned true.
pub fn open(
    peripheral: Peri<'static, peripherals::USB_OTG_FS>,
    dp: Peri<'static, PA12>,
    dm: Peri<'static, PA11>,
) -> (Device, Sender, Receiver) {
    let mut config = usb::Config::default();
    // A socket may not power the board, and PA9, which would sense its VBUS, may have another use. So D+ is also pulled
    // up while the socket has no power, which USB 2.0, section 7.1.5.1, forbids: a host that is off receives a
    // current through 1.5 kΩ.
    config.vbus_detection = false;
    let driver = usb::Driver::new_fs(peripheral, Interrupts, dp, dm, OUT.take(), config);
    describe(Driver(driver))
}

/// Waits until `ready` is true, and returns false if that takes longer than [`READY_LIMIT`].
async fn becomes(ready: impl Fn() -> bool) -> bool {
    let begin = Instant::now();
    while !ready() {
        if Instant::now().saturating_duration_since(begin) > READY_LIMIT {
            return false;
        }
        yield_now().await;
    }
    true
}

/// Returns true if the peripheral does everything that embassy's driver waits for.
pub async fn answers() -> bool {
    PWR.cr3().modify(|w| w.set_usb33den(true));
    if !becomes(|| PWR.cr3().read().usb33rdy()).await {
        return false;
    }
    rcc::enable_and_reset::<peripherals::USB_OTG_FS>();
    if !CORES.contains(&USB_OTG_FS.cid().read().0) || !becomes(|| USB_OTG_FS.grstctl().read().ahbidl()).await {
        return false;
    }
    USB_OTG_FS.gusbcfg().write(|w| {
        w.set_fdmod(true);
        w.set_physel(true);
    });
    becomes(|| !USB_OTG_FS.gintsts().read().cmod()).await
}

fn describe(driver: Driver) -> (Device, Sender, Receiver) {
    static CONFIG_DESCRIPTOR: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);
    static BOS_DESCRIPTOR: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);
    static MSOS_DESCRIPTOR: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    static CONTROL: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);
    let mut config = Config::new(USB_VENDOR_ID, USB_PRODUCT_ID);
    config.manufacturer = Some("stylus");
    config.product = Some(USB_PRODUCT);
    config.serial_number = Some(uid::uid_hex());
    // The one interface declares its class itself, so the device needs neither class nor association descriptors.
    config.device_class = 0;
    config.device_sub_class = 0;
    config.device_protocol = 0;
    config.composite_with_iads = false;
    config.self_powered = SUPPLY_MA == 0;
    config.max_power = SUPPLY_MA;
    let mut builder = Builder::new(
        driver,
        config,
        CONFIG_DESCRIPTOR.take(),
        BOS_DESCRIPTOR.take(),
        MSOS_DESCRIPTOR.take(),
        CONTROL.take(),
    );
    builder.msos_descriptor(windows_version::WIN8_1, 0);
    builder.msos_feature(msos::CompatibleIdFeatureDescriptor::new("WINUSB", ""));
    builder.msos_feature(msos::RegistryPropertyFeatureDescriptor::new(
        "DeviceInterfaceGUIDs",
        msos::PropertyData::RegMultiSz(INTERFACE_GUIDS),
    ));
    let mut function = builder.function(VENDOR_CLASS, 0, 0);
    let mut interface = function.interface();
    let mut setting = interface.alt_setting(VENDOR_CLASS, 0, 0, None);
    let output = setting.endpoint_bulk_out(None, PACKET_BYTES as u16);
    let input = setting.endpoint_bulk_in(None, PACKET_BYTES as u16);
    drop(function);
    (
        builder.build(),
        Sender {
            endpoint: input,
            unfinished: None,
        },
        Receiver { endpoint: output },
    )
}

/// Buffer for a frame from the host.
pub type Buffer = [u8; MAX_HOST_FRAME_BYTES];

/// Sender of frames.
pub struct Sender {
    endpoint: BulkIn,
    /// Session of a frame of which only a part may have been sent.
    unfinished: Option<u32>,
}

impl SendFrame for Sender {
    async fn send_frame(&mut self, frame: &[u8]) -> bool {
        let session = BulkIn::session();
        // An empty packet ends that part, so that this frame is not joined to it.
        if self.unfinished == Some(session) && self.endpoint.write(&[]).await.is_err() {
            return false;
        }
        self.unfinished = Some(session);
        // If the last packet is full, an empty packet follows, so that the host sees the end.
        let sent = self.endpoint.write_transfer(frame, true).await.is_ok();
        if sent {
            self.unfinished = None;
        }
        sent
    }
}

/// Receiver of frames.
pub struct Receiver {
    endpoint: BulkOut,
}

impl Receiver {
    /// Receives one transfer and returns its length; none if it does not fit.
    async fn transfer(&mut self, buffer: &mut [u8]) -> Result<Option<usize>, EndpointError> {
        let mut length = 0;
        let mut fits = true;
        loop {
            let mut packet = [0; PACKET_BYTES];
            let received = self.endpoint.read(&mut packet).await?;
            match buffer.get_mut(length..length + received) {
                Some(rest) if fits => {
                    rest.copy_from_slice(&packet[..received]);
                    length += received;
                }
                _ => fits = false,
            }
            if received < PACKET_BYTES {
                return Ok(fits.then_some(length));
            }
        }
    }
}

impl ReceiveFrame for Receiver {
    async fn receive_frame(&mut self, buffer: &mut [u8]) -> Option<usize> {
        self.endpoint.wait_enabled().await;
        match self.transfer(buffer).await {
            Err(EndpointError::Disabled) => {
                Timer::after_millis(10).await;
                None
            }
            Err(EndpointError::BufferOverflow) | Ok(None) => {
                USB_COUNTERS.count(|counters| &mut counters.oversized);
                None
            }
            Ok(Some(length)) => Some(length),
        }
    }
}
