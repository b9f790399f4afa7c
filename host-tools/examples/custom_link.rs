//! A link of one's own: a stylus behind the pipes of another program, such as `ssh` to the computer that it is attached
//! to.
//!
//!     cargo run --locked -p host-tools --example custom_link -- ssh rig socat - /dev/ttyACM0,b921600,raw,echo=0
//!
//! Without a program it reaches a stylus in memory through a relay of the shell.

use std::io;
use std::process::{Command, Stdio};
use std::sync::Arc;

use host_tools::link::upload::upload;
use host_tools::link::{ByteStream, CustomLink, Device, LinkError, Timeouts};

/// A program whose standard input and output are the serial line of a stylus. It ends with its input.
pub struct Pipes {
    /// The program.
    pub program: String,
    /// Its arguments.
    pub arguments: Vec<String>,
}

impl CustomLink for Pipes {
    fn name(&self) -> String {
        format!("pipes:{}", self.program)
    }

    fn open(&self) -> io::Result<ByteStream> {
        let mut child = Command::new(&self.program)
            .args(&self.arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let ends = child.stdout.take().zip(child.stdin.take());
        let (output, input) = ends.ok_or_else(|| io::Error::other("it has no pipes"))?;
        // Ends with the child, which ends with its input.
        std::thread::spawn(move || child.wait());
        ByteStream::blocking(output, input)
    }
}

/// Uploads `library` over `link`, makes it the active one, and tells what the stylus says of it.
///
/// # Errors
/// A link that cannot be opened or is lost, and refusals of the stylus.
pub fn upload_over(link: Arc<dyn CustomLink>, library: &[u8]) -> Result<String, LinkError> {
    let mut device = Device::connect_over(link, Timeouts::default())?;
    let uploaded = upload(&mut device, library, |_bytes| ())?;
    device.activate(uploaded.slot)?;
    let status = device.status()?;
    Ok(format!(
        "{} over {}: slot {} of {} bytes is active: {}",
        device.info().product,
        device.address(),
        uploaded.slot,
        uploaded.library.length,
        if status.active == Some(uploaded.slot) {
            uploaded.textures.join(", ")
        } else {
            "not yet".to_owned()
        }
    ))
}

/// A relay between its standard streams and a TCP port of this computer.
pub fn relay_to(port: u16) -> Pipes {
    let script = "exec 3<>/dev/tcp/127.0.0.1/$0; cat <&3 & cat >&3; kill $!";
    Pipes {
        program: "bash".to_owned(),
        arguments: vec!["-c".to_owned(), script.to_owned(), port.to_string()],
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let library = fake_stylus::library::library(2, 4, 1);
    let told = if let Some(program) = words.next() {
        let arguments = words.collect();
        upload_over(Arc::new(Pipes { program, arguments }), &library)?
    } else {
        let stylus = fake_stylus::FakeStylus::start();
        upload_over(Arc::new(relay_to(stylus.port())), &library)?
    };
    println!("{told}");
    Ok(())
}
