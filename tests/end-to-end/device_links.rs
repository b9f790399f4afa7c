//! Links to a stylus: a serial port, TCP and USB; and the messages where there is no stylus.

use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use example::{Pipes, relay_to, upload_over};
use fake_stylus::FakeStylus;
use host_tools::link::upload::upload;
use host_tools::link::{ByteStream, CustomLink, Device, LinkError, Timeouts};
use model_format::link::{USB_PRODUCT_ID, USB_VENDOR_ID};
use tokio::net::TcpStream;

use crate::support::{Bench, text};

/// A pseudo-terminal in front of a stylus, whose other end is an ordinary serial port.
pub mod port {
    use std::time::Duration;

    use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
    use tokio::net::TcpStream;
    use tokio::runtime::Runtime;
    use tokio_serial::{SerialPort, SerialStream};

    /// Carries bytes both ways until it is dropped.
    pub struct Port {
        pub name: String,
        /// The test's own handle of the port.
        pub held: Option<SerialStream>,
        _runtime: Runtime,
    }

    pub fn before(tcp_port: u16) -> Port {
        let runtime = Runtime::new().expect("it needs nothing");
        let (master, slave) = {
            let _within = runtime.enter();
            SerialStream::pair().expect("there are pseudo-terminals")
        };
        let stream = runtime.block_on(TcpStream::connect(("127.0.0.1", tcp_port)));
        let (from_stylus, to_stylus) = stream.expect("the stylus listens").into_split();
        let (from_host, to_host) = tokio::io::split(master);
        runtime.spawn(pump(from_stylus, to_host));
        runtime.spawn(pump(from_host, to_stylus));
        Port {
            name: slave.name().expect("it has one"),
            held: Some(slave),
            _runtime: runtime,
        }
    }

    async fn pump(mut from: impl AsyncRead + Unpin, mut to: impl AsyncWrite + Unpin) {
        let mut buffer = [0; 1024];
        loop {
            match from.read(&mut buffer).await {
                Ok(0) => return,
                Ok(count) if to.write_all(&buffer[..count]).await.is_err() => return,
                Ok(_) => {}
                // A terminal whose other end is not open.
                Err(_) => tokio::time::sleep(Duration::from_millis(5)).await,
            }
        }
    }
}

#[test]
fn a_serial_port_carries_what_tcp_carries() {
    let (stylus, bench) = (FakeStylus::start(), Bench::new());
    let mut port = port::before(stylus.port());
    port.held = None;
    let name = &port.name;
    bench.write("a.lib", fake_stylus::library::library(1, 50, 1));
    let uploaded = bench.succeed(&format!("upload a.lib --activate --link serial:{name}"));
    assert!(uploaded.contains("read back"), "{uploaded}");
    let status = bench.succeed(&format!("status --link serial:{name}"));
    assert!(status.contains("slot A, checksum"), "{status}");
}

#[test]
fn a_port_that_another_program_uses_is_said_to_be_in_use() {
    let stylus = FakeStylus::start();
    let mut port = port::before(stylus.port());
    let held = port.held.as_mut().expect("it is held from the beginning");
    held.set_exclusive(true).unwrap();
    let message = Bench::new().refuse(&format!("status --link serial:{}", port.name));
    assert!(message.contains("in use by another program"), "{message}");
}

#[test]
fn where_there_is_no_device_one_line_says_so() {
    let bench = Bench::new();
    for (link, words) in [
        ("serial:/dev/no-such-port", "there is no such port"),
        ("serial:/dev/null", "is it a serial port?"),
        ("tcp:127.0.0.1:1", "nothing listens there"),
        ("tcp:no-such-host.invalid:4000", "cannot be opened"),
        // If a stylus is plugged in, it has another serial number.
        ("usb:no-such-serial", "on USB"),
    ] {
        let message = bench.refuse(&format!("status --link {link}"));
        assert!(message.contains(words), "{link}: {message}");
    }
    let output = bench.run("status --link bluetooth:stylus");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("tcp:HOST:PORT"));
}

#[test]
fn the_udev_rule_is_for_the_device_that_the_protocol_names() {
    let rules = include_str!("../../host-tools/70-stylus.rules");
    let device = format!(
        "ATTR{{idVendor}}==\"{USB_VENDOR_ID:04x}\", ATTR{{idProduct}}==\"{USB_PRODUCT_ID:04x}\""
    );
    let rule = rules.lines().find(|line| line.contains(&device));
    assert!(rule.is_some_and(|rule| rule.contains("TAG+=\"uaccess\"")));
}

#[path = "../../host-tools/examples/custom_link.rs"]
#[allow(dead_code, reason = "its `main` is not called")]
mod example;

#[test]
fn a_stylus_behind_pipes_takes_a_library_and_plays_it() {
    let stylus = FakeStylus::start();
    let library = fake_stylus::library::library(3, 4, 1);
    let told = upload_over(Arc::new(relay_to(stylus.port())), &library).unwrap();
    assert!(told.contains("over pipes:bash: slot "), "{told}");
    assert!(told.ends_with("texture 0, texture 1, texture 2"), "{told}");
    // By the product's own link, too.
    let address = stylus.link().parse().unwrap();
    let device = Device::connect(&address, Timeouts::default()).unwrap();
    assert!(device.status().unwrap().active.is_some());
}

/// A socket that is counted when it is opened.
struct Socket {
    port: u16,
    opened: AtomicUsize,
}

impl CustomLink for Socket {
    fn name(&self) -> String {
        "my socket".to_owned()
    }

    fn open(&self) -> io::Result<ByteStream> {
        self.opened.fetch_add(1, Ordering::Relaxed);
        let socket = std::net::TcpStream::connect(("127.0.0.1", self.port))?;
        socket.set_nonblocking(true)?;
        let (reader, writer) = TcpStream::from_std(socket)?.into_split();
        Ok(ByteStream::new(reader, writer))
    }
}

#[test]
fn a_link_of_ones_own_is_opened_anew_after_a_loss_and_another_device_is_refused() {
    let stylus = FakeStylus::start();
    let link = Arc::new(Socket {
        port: stylus.port(),
        opened: AtomicUsize::new(0),
    });
    let mut device = Device::connect_over(link.clone(), Timeouts::default()).unwrap();
    assert_eq!(device.address().to_string(), "my socket");
    let library = fake_stylus::library::library(1, 4, 1);
    // A new connection takes the fake's only line from the one before.
    let other = Device::connect(&stylus.link().parse().unwrap(), Timeouts::default()).unwrap();
    drop(other);
    let lost = device.status();
    assert!(lost.is_err(), "{lost:?}");
    assert!(lost.unwrap_err().to_string().contains("my socket"));
    device.reconnect().unwrap();
    assert_eq!(link.opened.load(Ordering::Relaxed), 2);
    let uploaded = upload(&mut device, &library, |_| ()).unwrap();
    assert_eq!(uploaded.textures, ["texture 0"]);
}

#[test]
fn a_link_that_cannot_be_opened_or_ends_at_once_is_named_with_the_reason() {
    let short = Timeouts::scaled_to(Duration::from_millis(300));
    let failure = |program: &str, arguments: &[&str]| {
        let link = Pipes {
            program: program.to_owned(),
            arguments: arguments.iter().map(ToString::to_string).collect(),
        };
        match Device::connect_over(Arc::new(link), short) {
            Ok(_) => panic!("there is no stylus"),
            Err(failure) => failure,
        }
    };
    let missing = failure("no-such-program", &[]);
    assert!(matches!(missing, LinkError::Open { .. }), "{missing:?}");
    let told = missing.to_string();
    assert!(
        told.contains("pipes:no-such-program") && told.contains("No such file"),
        "{told}"
    );
    let ended = failure("true", &[]);
    assert!(ended.to_string().contains("pipes:true"), "{ended}");
    // Bytes that are no frames are no answer.
    let noise = failure("sh", &["-c", "head -c 4000 /dev/zero | tr '\\0' 'x'; cat"]);
    assert!(noise.to_string().contains("pipes:sh"), "{noise}");
    // A port that nobody serves any more.
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let link = Socket {
        port,
        opened: AtomicUsize::new(0),
    };
    let Err(refused) = Device::connect_over(Arc::new(link), short) else {
        panic!("nothing listens there");
    };
    assert!(refused.to_string().contains("my socket"), "{refused}");
}
