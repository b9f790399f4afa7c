//! Links that a program brings itself, by the example of `host-tools/examples`.

use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use fake_stylus::FakeStylus;
use host_tools::link::upload::upload;
use host_tools::link::{ByteStream, CustomLink, Device, LinkError, Timeouts};
use tokio::net::TcpStream;

use example::{Pipes, relay_to, upload_over};

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
