//! Support for the end-to-end tests: the built command, folders, and synthetic recordings.

use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use fake_stylus::FakeStylus;
use host_tools::link::{Device, Timeouts};
use serde_json::Value;
use tempfile::TempDir;
pub use test_helpers::{holds, near, noise};

/// Sample rate of the recordings made here, Hz.
pub const RATE_HZ: u32 = 5000;

/// A temporary folder in which the command is run.
pub struct Bench {
    folder: TempDir,
    /// True if commands may replace existing files, as in tests that write a file twice.
    overwrites: bool,
    /// Environment variables of every command.
    variables: Vec<(&'static str, String)>,
}

impl Bench {
    /// Creates an empty folder.
    pub fn new() -> Self {
        Self {
            folder: TempDir::new().expect("there is room for a folder"),
            overwrites: true,
            variables: Vec::new(),
        }
    }

    /// Returns the bench with an environment variable for its commands.
    pub fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.variables.push((name, value.into()));
        self
    }

    /// Returns the bench with commands that replace existing files only on request.
    pub fn careful(self) -> Self {
        Self {
            overwrites: false,
            ..self
        }
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file, and creates its folders.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("it is in the folder")).expect("made");
        std::fs::write(path, content).expect("there is room for a file");
    }

    /// Writes recordings, `0.wav` and so on, and their list. Each trial has its texture, speed, mm/s, force, N, and
    /// bytes.
    pub fn write_set(&self, folder: &str, trials: &[(&str, f64, f64, Vec<u8>)]) {
        let mut list = String::from("file,texture,speed_mm_s,force_n\n");
        for (number, (texture, speed, force, file)) in trials.iter().enumerate() {
            self.write(&format!("{folder}/{number}.wav"), file);
            list.push_str(&format!("{number}.wav,{texture},{speed},{force}\n"));
        }
        self.write(&format!("{folder}/trials.csv"), list);
    }

    /// The content of a file in the folder.
    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|failure| panic!("{name}: {failure}"))
    }

    /// Reads a report that was written as JSON.
    pub fn report(&self, name: &str) -> Value {
        json(&text(&self.read(name)))
    }

    /// Samples of a WAV file of floats, which must have the rate `rate_hz`.
    pub fn samples(&self, name: &str, rate_hz: u32) -> Vec<f64> {
        let bytes = self.read(name);
        let reader = hound::WavReader::new(&bytes[..]).expect("it is a WAV file");
        assert_eq!(reader.spec().sample_rate, rate_hz);
        reader
            .into_samples::<f32>()
            .map(|sample| f64::from(sample.unwrap()))
            .collect()
    }

    /// Runs `stylus` in the folder; the arguments are split at spaces.
    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments.split_whitespace())
            .output()
            .expect("the command runs")
    }

    /// The command with these arguments, in the folder.
    pub fn command<'a>(&self, arguments: impl IntoIterator<Item = &'a str>) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_stylus"));
        command
            .args(arguments)
            .current_dir(self.folder.path())
            .env_remove("STYLUS_LINK")
            .envs(self.variables.iter().map(|(name, value)| (name, value)));
        if self.overwrites {
            command.env("STYLUS_OVERWRITE", "1");
        }
        command
    }

    /// Starts `stylus` with these arguments, without waiting for its end.
    pub fn spawn<'a>(&self, arguments: impl IntoIterator<Item = &'a str>) -> Child {
        self.command(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts")
    }

    /// Runs `stylus`, which must succeed, and returns its standard output.
    pub fn succeed(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        assert!(output.status.success(), "stylus {arguments}\n{out}\n{err}");
        out
    }

    /// Runs `stylus`, which must succeed, and returns the report that it prints as JSON.
    pub fn json(&self, arguments: &str) -> Value {
        json(&self.succeed(arguments))
    }

    /// Runs `stylus`, which must succeed, and returns its standard error with one line per message.
    pub fn told(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let told = text(&output.stderr);
        assert!(output.status.success(), "stylus {arguments}\n{told}");
        told.replace("\n  ", " ")
    }

    /// Runs each command of a table, which must be refused. Each line is `arguments | word | word`, and the message
    /// must contain the words.
    pub fn refuse_each(&self, table: &str) {
        for row in table.trim().lines() {
            let (arguments, words) = row.trim().split_once(" | ").expect("it has words");
            let words: Vec<&str> = words.split(" | ").collect();
            holds(&self.refuse(arguments), &words);
        }
    }

    /// Runs `stylus`, which must end with code 2, and returns its standard error with one line per message.
    pub fn fail(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "stylus {arguments}\n{told}");
        told.replace("\n  ", " ")
    }

    /// Runs `stylus`, which must end with code 2 and one line on standard error, and returns that line.
    pub fn refuse(&self, arguments: &str) -> String {
        refusal(&self.run(arguments), arguments)
    }

    /// The names in the folder, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).expect("the folder is there");
        let mut names: Vec<String> = entries
            .map(|entry| {
                entry
                    .expect("it can be read")
                    .file_name()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        names.sort();
        names
    }
}

/// Longest wait for an answer or for a condition, s. Only a fault takes so long, however busy this computer is.
pub const LONGEST_WAIT_S: u16 = 600;

/// A fake stylus, and a folder whose commands use the stylus's link.
pub fn attached(stylus: FakeStylus) -> (FakeStylus, Bench) {
    let bench = Bench::new()
        .with("STYLUS_LINK", stylus.link())
        .with("STYLUS_TIMEOUT", LONGEST_WAIT_S.to_string());
    (stylus, bench)
}

/// A fake stylus with its defaults, and a folder whose commands use its link.
pub fn started() -> (FakeStylus, Bench) {
    attached(FakeStylus::start())
}

/// Connects this process to `stylus`.
pub fn connected(stylus: &FakeStylus) -> Device {
    let address = stylus.link().parse().expect("it is an address");
    let timeouts = Timeouts::scaled_to(Duration::from_secs(LONGEST_WAIT_S.into()));
    Device::connect(&address, timeouts).expect("it listens")
}

/// Plays by the command `arguments` until at least `time` has passed at the device, and another two readings of the
/// status. Then ends the command by Ctrl-C, and returns its output.
#[cfg(unix)]
pub fn play_for(
    time: Duration,
    stylus: &FakeStylus,
    bench: &Bench,
    arguments: impl IntoIterator<Item = &'static str>,
) -> Output {
    stylus.take_heard();
    let play = bench.spawn(arguments);
    wait_for("the play", || stylus.count("stylus/play") > 0);
    let begin = stylus.time();
    wait_for("its time", || stylus.time() >= begin + time);
    // The command asks again once it has seen the answer before.
    let readings = stylus.count("stylus/status") + 2;
    wait_for("the status", || stylus.count("stylus/status") >= readings);
    interrupt(&play);
    play.wait_with_output().expect("it ends")
}

/// A folder with the recordings `set` of two textures, silk and felt, at two speeds and two forces. `axes` turns an
/// autoregressive signal into the axes of a recording.
pub fn two_textures<const AXES: usize>(axes: impl Fn(&[f64]) -> [Vec<f64>; AXES]) -> Bench {
    let bench = Bench::new();
    let mut list = String::from("file,texture,speed_mm_s,force_n\n");
    for (texture, pole) in [("silk", 0.5), ("felt", -0.6)] {
        for (speed, force) in [(50, 0.5), (50, 1.0), (150, 0.5), (150, 1.0)] {
            let seed = speed * 10 + (force * 10.0) as u64;
            let signal = all_pole(&[-pole * 1.2, 0.7], &noise(seed, 10_000));
            let axes = axes(&signal);
            let axes = axes.each_ref().map(Vec::as_slice);
            let name = format!("{texture}-{speed}-{force}.wav");
            bench.write(&format!("set/{name}"), wav(&axes, RATE_HZ));
            list.push_str(&format!("{name},{texture},{speed},{force}\n"));
        }
    }
    bench.write("set/trials.csv", list);
    bench
}

/// The paper's rig with these speeds and forces, as text.
pub fn rig_of(speeds: &str, forces: &str) -> String {
    host_tools::rig::RigFile::paper()
        .text()
        .lines()
        .map(|line| match line.split('=').next().unwrap_or("").trim() {
            "speeds_mm_s" => format!("speeds_mm_s = [{speeds}]\n"),
            "forces_n" => format!("forces_n = [{forces}]\n"),
            _ => format!("{line}\n"),
        })
        .collect()
}

/// Like [`rig_of`], with denim only.
pub fn denim_rig_of(speeds: &str, forces: &str) -> String {
    let rig = rig_of(speeds, forces);
    let (head, textures) = rig.split_once("[[texture]]").expect("it has textures");
    let denim = textures.split("[[texture]]").last().unwrap_or_default();
    format!("{head}[[texture]]{denim}")
}

/// Multiplies `signal` by `factor`.
pub fn scaled(signal: &[f64], factor: f64) -> Vec<f64> {
    signal.iter().map(|x| factor * x).collect()
}

/// Arguments that play the first texture of a library of the fake stylus with a constant motion.
pub const PLAY: [&str; 7] = ["play", "--texture", "texture 0", "--speed", "50", "--force", "1"];

/// Parses a report that was printed as JSON.
pub fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|failure| panic!("{failure}: {text}"))
}

/// Returns the report that a command, which must have succeeded, printed as JSON.
pub fn reported(output: &Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    json(&text(&output.stdout))
}

/// Output as text.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Passes `excitation` through the all-pole filter y(n) = e(n) - Σ a(i) y(n-i).
pub fn all_pole(a: &[f64], excitation: &[f64]) -> Vec<f64> {
    let mut output: Vec<f64> = Vec::with_capacity(excitation.len());
    for (n, e) in excitation.iter().enumerate() {
        let past = a.iter().enumerate().take(n).map(|(i, a)| a * output[n - 1 - i]);
        let next = e - past.sum::<f64>();
        output.push(next);
    }
    output
}

/// Coefficients of an all-pole process at `rate_hz` with these poles: frequency, Hz, and radius, each with its
/// conjugate.
pub fn predictor(rate_hz: u32, poles: &[(f64, f64)]) -> Vec<f64> {
    let mut polynomial = vec![1.0];
    for &(hertz, radius) in poles {
        let angle = core::f64::consts::TAU * hertz / f64::from(rate_hz);
        let factor = [1.0, -2.0 * radius * angle.cos(), radius * radius];
        let mut product = vec![0.0; polynomial.len() + 2];
        for (i, p) in polynomial.iter().enumerate() {
            for (j, f) in factor.iter().enumerate() {
                product[i + j] += p * f;
            }
        }
        polynomial = product;
    }
    polynomial.split_off(1)
}

/// Power of an all-pole process between two frequencies, for an excitation of unit variance, from the closed form of
/// its density.
pub fn power_between(a: &[f64], rate_hz: u32, low_hz: f64, high_hz: f64) -> f64 {
    const STEPS: u32 = 2000;
    let step_hz = (high_hz - low_hz) / f64::from(STEPS);
    let density = |hertz: f64| {
        let angle = core::f64::consts::TAU * hertz / f64::from(rate_hz);
        let (mut re, mut im) = (1.0, 0.0);
        for (lag, a) in (1..).zip(a) {
            re += a * (angle * f64::from(lag)).cos();
            im -= a * (angle * f64::from(lag)).sin();
        }
        2.0 / f64::from(rate_hz) / (re * re + im * im)
    };
    (0..STEPS)
        .map(|n| low_hz + (f64::from(n) + 0.5) * step_hz)
        .map(density)
        .sum::<f64>()
        * step_hz
}

/// A ratio of powers, dB.
pub fn decibels(ratio: f64) -> f64 {
    10.0 * ratio.log10()
}

/// The bytes of a WAV file in 32-bit float, with one channel per axis.
pub fn wav(axes: &[&[f64]], rate_hz: u32) -> Vec<u8> {
    let frames = (0..axes[0].len()).flat_map(|index| axes.iter().map(move |axis| axis[index]));
    let spec = hound::WavSpec {
        channels: axes.len() as u16,
        sample_rate: rate_hz,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    wav_of(spec, frames.map(|sample| sample as f32))
}

/// The bytes of a WAV file with one channel of integers of `bits` bits.
pub fn integers(signal: &[f64], bits: u16) -> Vec<u8> {
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: RATE_HZ,
        bits_per_sample: bits,
        sample_format: hound::SampleFormat::Int,
    };
    let scale = 2f64.powi(i32::from(bits) - 1);
    let code = |x: &f64| (x * scale).round().clamp(-scale, scale - 1.0) as i32;
    wav_of(spec, signal.iter().map(code))
}

fn wav_of<T: hound::Sample>(spec: hound::WavSpec, samples: impl Iterator<Item = T>) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut writer = hound::WavWriter::new(&mut bytes, spec).expect("the spec is sound");
    for sample in samples {
        writer.write_sample(sample).expect("there is room in memory");
    }
    writer.finalize().expect("there is room in memory");
    bytes.into_inner()
}

/// Waits until `is_there` returns true.
pub fn wait_for(what: &str, mut is_there: impl FnMut() -> bool) {
    let begin = Instant::now();
    let longest = Duration::from_secs(LONGEST_WAIT_S.into());
    while !is_there() {
        assert!(begin.elapsed() < longest, "{what} did not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Sends Ctrl-C to `child`.
#[cfg(unix)]
pub fn interrupt(child: &Child) {
    assert!(signal("INT", child.id()));
}

/// Sends the signal called `name` to `process`, and returns true if the process existed. Uses the shell's own `kill`,
/// because a small system has no other.
#[cfg(unix)]
pub fn signal(name: &str, process: u32) -> bool {
    Command::new("sh")
        .arg("-c")
        .arg(format!("kill -{name} {process}"))
        .stderr(Stdio::null())
        .status()
        .expect("a shell is there")
        .success()
}

/// Returns the one line on standard error of `output`, which must be a refusal with code 2.
pub fn refusal(output: &Output, arguments: &str) -> String {
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "stylus {arguments}\n{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    message
}
