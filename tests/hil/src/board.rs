//! Reset and flashing of the board: by a probe, by the process of a virtual stylus, or by the user.

use std::fmt::Display;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::Duration;

use crate::report::{Error, Result};

/// A variant of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// The image of the release.
    Product,
    /// The product's image, extended by faults on request.
    FaultInjection,
}

/// The images' ELF files.
#[derive(Clone, Debug)]
pub struct Images {
    /// The board that they are for.
    pub board: &'static stylus_board::Board,
    /// The image of the release.
    pub product: PathBuf,
    /// The product's image, extended by faults on request.
    pub faults: PathBuf,
}

impl Images {
    fn file(&self, image: Image) -> &PathBuf {
        match image {
            Image::Product => &self.product,
            Image::FaultInjection => &self.faults,
        }
    }
}

/// Time that a virtual stylus takes to restart, on an idle computer.
const VIRTUAL_START: Duration = Duration::from_millis(700);

/// Control of the board, in addition to its link.
#[derive(Debug)]
pub enum Board {
    /// No control: the user resets the board and flashes images.
    ByHand,
    /// A probe with probe-rs.
    Probe(Probe),
    /// A virtual stylus in its own process.
    Virtual(VirtualBoard),
}

impl Board {
    /// Returns the reason why [`Board::reset`] and [`Board::flash`] cannot be used; `None` if they can.
    pub fn lacks(&self) -> Option<&'static str> {
        match self {
            Self::ByHand => Some("it needs the probe: run with --flash where probe-rs is installed"),
            Self::Probe(_) | Self::Virtual(_) => None,
        }
    }

    /// Returns true if there is no hardware at the other end.
    pub fn is_emulated(&self) -> bool {
        matches!(self, Self::Virtual(_))
    }

    /// Resets the processor: a virtual stylus by its reset pin, a board as its probe does it, which may be a request to
    /// the core.
    pub fn reset(&mut self) -> Result<()> {
        match self {
            Self::ByHand => Err(by_hand()),
            Self::Probe(probe) => probe.run(&["reset"], None),
            Self::Virtual(board) => {
                board.tell("reset")?;
                // A request sent now would be lost, and its timeout would have to elapse.
                std::thread::sleep(VIRTUAL_START);
                Ok(())
            }
        }
    }

    /// Writes `image` into the flash and starts it. The libraries and settings in flash stay.
    pub fn flash(&mut self, image: Image) -> Result<()> {
        match self {
            Self::ByHand => Err(by_hand()),
            Self::Probe(probe) => {
                let file = probe.images.file(image).clone();
                probe.run(&["download"], Some(file))?;
                probe.run(&["reset"], None)
            }
            Self::Virtual(board) => board.restart(image),
        }
    }
}

fn by_hand() -> Error {
    Error::Program {
        program: "probe-rs".to_owned(),
        problem: "not in use: run with --flash".to_owned(),
    }
}

/// A probe with probe-rs. It detaches after each call, so that nothing halts the core and thereby its watchdog.
#[derive(Debug)]
pub struct Probe {
    /// The probe-rs program.
    pub program: PathBuf,
    /// The images.
    pub images: Images,
}

impl Probe {
    fn run(&self, subcommand: &[&str], file: Option<PathBuf>) -> Result<()> {
        let mut command = Command::new(&self.program);
        command.args(subcommand).args(["--chip", self.images.board.probe]);
        command.args(file);
        let failed = |problem: String| Error::Program {
            program: format!("{} {}", self.program.display(), subcommand.join(" ")),
            problem,
        };
        let status = command.status().map_err(|error| failed(error.to_string()))?;
        if status.success() {
            Ok(())
        } else {
            Err(failed(format!("{status}; see above")))
        }
    }
}

/// A virtual stylus, which resets and ends on commands over its standard input.
#[derive(Debug)]
pub struct VirtualBoard {
    program: PathBuf,
    images: Images,
    flash: PathBuf,
    motion: PathBuf,
    port: u16,
    running: Option<(Child, ChildStdin)>,
    _folder: tempfile::TempDir,
}

/// The hand's motion, mm/s and N: from rest to 120 mm/s and 1 N in a second, then a stroke that is longer than any run.
const MOTION: &str = "time_s,speed_mm_s,force_n\n0,0,0\n1,120,1\n100000,120,1\n";

impl VirtualBoard {
    /// Starts `program` with the product's image on blank flash.
    pub fn start(program: PathBuf, images: Images) -> Result<Self> {
        let folder = tempfile::tempdir()?;
        let motion = folder.path().join("motion.csv");
        std::fs::write(&motion, MOTION)?;
        let mut board = Self {
            program,
            images,
            flash: folder.path().join("flash"),
            motion,
            port: 0,
            running: None,
            _folder: folder,
        };
        board.restart(Image::Product)?;
        Ok(board)
    }

    /// The address of the virtual stylus's link.
    pub fn link(&self) -> String {
        format!("tcp:127.0.0.1:{}", self.port)
    }

    fn failed(&self, problem: &dyn Display) -> Error {
        Error::Program {
            program: self.program.display().to_string(),
            problem: problem.to_string(),
        }
    }

    fn tell(&mut self, what: &str) -> Result<()> {
        let Some((_, stdin)) = &mut self.running else {
            return Err(self.failed(&"it has ended"));
        };
        writeln!(stdin, "{what}")
            .and_then(|()| stdin.flush())
            .map_err(|error| self.failed(&error))
    }

    /// Ends the process, which then writes the flash to its file.
    fn end(&mut self) -> Result<()> {
        if let Some((mut child, stdin)) = self.running.take() {
            // The process ends when its standard input closes.
            drop(stdin);
            let status = child.wait().map_err(|error| self.failed(&error))?;
            if !status.success() {
                return Err(self.failed(&status));
            }
        }
        Ok(())
    }

    fn restart(&mut self, image: Image) -> Result<()> {
        self.end()?;
        let mut child = Command::new(&self.program)
            .args(["--board", self.images.board.name])
            .arg("--image")
            .arg(self.images.file(image))
            .arg("--flash")
            .arg(&self.flash)
            .arg("--motion")
            .arg(&self.motion)
            .args(["--port", &self.port.to_string(), "--commands"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| self.failed(&error))?;
        let (Some(stdin), Some(stdout)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(self.failed(&"it has no input or output"));
        };
        self.running = Some((child, stdin));
        let mut lines = BufReader::new(stdout).lines();
        let port = loop {
            let Some(line) = lines.next() else {
                return Err(self.failed(&"it ended before it listened"));
            };
            let line = line.map_err(|error| self.failed(&error))?;
            if let Some(port) = line.rsplit_once("127.0.0.1:").map(|(_, port)| port.trim()) {
                break port.parse().map_err(|_| self.failed(&line))?;
            }
        };
        self.port = port;
        // A pipe that nobody reads would fill and block the process.
        std::thread::spawn(move || lines.for_each(drop));
        std::thread::sleep(VIRTUAL_START);
        Ok(())
    }
}

impl Drop for VirtualBoard {
    fn drop(&mut self) {
        // A failure cannot be reported any more.
        let _ = self.end();
    }
}
