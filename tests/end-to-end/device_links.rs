//! Links to a stylus: a serial port, TCP and USB; the list of what is attached; and the messages if there is no stylus.

use std::fs::{DirBuilder, File};
use std::io::Write;
use std::os::unix::fs::DirBuilderExt;

use fake_stylus::FakeStylus;
use model_format::link::{USB_PRODUCT_ID, USB_VENDOR_ID};

use crate::support::{Bench, LONGEST_WAIT_S, holds, json, refusal, text};

/// A pseudo-terminal in front of a stylus, whose other end is an ordinary serial port.
pub mod port {
    use std::time::Duration;

    use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
    use tokio::net::TcpStream;
    use tokio::runtime::Runtime;
    use tokio_serial::{SerialPort, SerialStream};

    /// Carries bytes in both directions until it is dropped.
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
                // The other end of the terminal is not open.
                Err(_) => tokio::time::sleep(Duration::from_millis(5)).await,
            }
        }
    }
}

#[test]
fn a_port_that_another_program_uses_is_said_to_be_in_use() {
    let stylus = FakeStylus::start();
    let mut port = port::before(stylus.port());
    port.held
        .as_mut()
        .expect("it is held from the beginning")
        .set_exclusive(true)
        .unwrap();
    let refused = Bench::new().refuse(&format!("status --link serial:{}", port.name));
    holds(&refused, &["in use by ", "close that program"]);
}

#[test]
fn where_there_is_no_device_one_line_says_so() {
    let bench = Bench::new();
    // Any stylus that is plugged in has another serial number.
    bench.refuse_each(
        "status --link serial:/dev/no-such-port | there is no such port
        status --link serial:/dev/null | is it a serial port?
        status --link tcp:127.0.0.1:1 | nothing listens there
        status --link tcp:no-such-host.invalid:4000 | cannot be opened
        status --link usb:no-such-serial | on USB",
    );
    holds(&bench.fail("status --link bluetooth:stylus"), &["tcp:HOST:PORT"]);
}

#[test]
fn the_udev_rule_is_for_the_device_that_the_protocol_names() {
    let rules = include_str!("../../host-tools/70-stylus.rules");
    let device = format!("ATTR{{idVendor}}==\"{USB_VENDOR_ID:04x}\", ATTR{{idProduct}}==\"{USB_PRODUCT_ID:04x}\"");
    let rule = rules.lines().find(|line| line.contains(&device));
    assert!(rule.is_some_and(|rule| rule.contains("TAG+=\"uaccess\"")));
}

/// A folder whose commands have a runtime folder of their own, in which only the tests announce styluses.
pub fn at_a_desk() -> Bench {
    let bench = Bench::new();
    let run = bench.path("run");
    let mut folder = DirBuilder::new();
    folder.recursive(true).mode(0o700).create(run.join("stylus")).unwrap();
    bench.with("XDG_RUNTIME_DIR", run.display().to_string())
}

/// Announces a virtual stylus at the desk, like a running one, until the returned file is dropped.
pub fn announce(desk: &Bench, name: &str, links: &[&str]) -> File {
    let path = desk.path("run/stylus").join(format!("virtual-{name}"));
    let mut file = File::create(path).unwrap();
    file.lock().unwrap();
    // The first line is the virtual time.
    writeln!(file, "0").unwrap();
    for link in links {
        writeln!(file, "{link}").unwrap();
    }
    file
}

#[test]
fn what_is_attached_is_listed_and_the_only_one_is_used() {
    let stylus = FakeStylus::start();
    let desk = at_a_desk().with("STYLUS_TIMEOUT", LONGEST_WAIT_S.to_string());
    let link = stylus.link();
    let run = |arguments: &[&str]| desk.command(arguments.iter().copied()).output().unwrap();
    let none = run(&["status"]);
    holds(&refusal(&none, "status"), &["no stylus is attached: plug one in"]);
    let listed = run(&["devices"]);
    assert_eq!(listed.status.code(), Some(0));
    assert_eq!(text(&listed.stdout), "");

    let _one = announce(&desk, "1-0", &[&link, "usb-virtual:127.0.0.1:1"]);
    // A list waits for answers for a second, in which a busy computer may not run the stylus, but not always.
    let list = |arguments: &[&str]| {
        let mut lists = (0..100).map(|_| text(&run(arguments).stdout));
        lists.find(|list| !list.contains("no answer")).expect("it answers")
    };
    let listed = json(&list(&["devices", "--json"]));
    let rows = listed.as_array().unwrap();
    assert_eq!(rows.len(), 2, "{listed}");
    assert_eq!(rows[0]["link"], link.as_str());
    assert_eq!(rows[0]["serial_number"], "0123456789ABCDEF01234567");
    assert_eq!(rows[0]["state"], "answers");
    assert!(
        rows[1]["state"].as_str().unwrap().contains("nothing listens there"),
        "{listed}"
    );
    let status = run(&["status"]);
    assert!(status.status.success());
    let note = format!("note: {link}: the only stylus found\n");
    assert_eq!(text(&status.stderr), note);
}
