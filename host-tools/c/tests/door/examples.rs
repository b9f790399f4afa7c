//! The examples in C and C++, compiled by the compilers of the system: `CC` and `CXX`, or cc and c++.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::Duration;

use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::Rendering;
use kernel_vectors::digest_library;
use model_format::Library;

/// The folder of the tests' programs, which has the libraries too.
pub fn libraries() -> PathBuf {
    std::env::current_exe()
        .expect("it runs")
        .parent()
        .expect("it is in a folder")
        .to_owned()
}

pub fn run(command: &mut Command) -> String {
    let output = command
        .output()
        .unwrap_or_else(|error| panic!("{command:?}: {error}; install a C and C++ compiler"));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{told}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Compiles an example, or a program of the tests, with the flags that make any warning an error.
fn compiled(compiler: (&str, &str), source: &str, flags: &[&str], to: &Path) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = to.join("example");
    let name = std::env::var(compiler.0).unwrap_or_else(|_| compiler.1.to_owned());
    let mut command = Command::new(name);
    command.args(["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-I"]);
    command
        .arg(folder.join("include"))
        .arg(folder.join("examples").join(source));
    run(command.args(flags).arg("-o").arg(&program));
    program
}

/// The flags that link the shared library, and find it.
fn shared() -> [String; 3] {
    let libraries = libraries();
    let libraries = libraries.to_str().expect("it is UTF-8");
    let find = format!("-Wl,-rpath,{libraries}");
    [format!("-L{libraries}"), find, "-lstylusplayer".to_owned()]
}

fn written(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("it can be written");
    path
}

#[test]
fn a_stroke_by_the_example_in_c_has_the_bits_of_render() {
    let folder = tempfile::tempdir().expect("it can be made");
    let archive = libraries().join("libstylusplayer.a");
    let archive = archive.to_str().expect("it is UTF-8");
    let flags = ["-std=c11", "-ffp-contract=off", archive, "-lm", "-lpthread", "-ldl"];
    let program = compiled(("CC", "cc"), "stroke.c", &flags, folder.path());
    let bytes = digest_library();
    let library = Library::decode(&bytes).expect("it is valid");
    let texture = library.texture_at(0).expect("there is one");
    let rows = "time_s,speed_mm_s,force_n,position_mm\n0,0,0,3\n0.3,90,0.7,16.5\n0.8,-150,1.4,1.1\n\
                1.2,33.3,0,-20\n1.5,180,0.9,12.05\n2,0,0,57\n";
    let motion = written(folder.path(), "motion.csv", rows);
    let wav = folder.path().join("stroke.wav");
    let library = written(folder.path(), "textures.lib", &bytes);
    run(Command::new(program)
        .arg(library)
        .arg(texture.name())
        .arg(&motion)
        .arg(&wav));
    let path = MotionPath::from_csv(&motion).expect("it is a motion");
    let rendering = Rendering::new(texture, &path, 2.0, 1).expect("it is short");
    let rendered: Vec<u8> = rendering
        .flat_map(|word| word.metres_per_second_squared().0.to_le_bytes())
        .collect();
    let played = std::fs::read(wav).expect("it was written");
    let (header, played) = played.split_at(44);
    assert_eq!(&header[36..40], b"data");
    assert_eq!(played.len(), 40_000);
    assert!(played == rendered);
    assert!(rendered.iter().any(|byte| *byte != 0));
}

#[test]
#[ignore = "needs valgrind: tests/run long only 'the player under valgrind'"]
fn no_call_in_c_touches_memory_that_is_not_its_own_whatever_it_is_given() {
    let folder = tempfile::tempdir().expect("it can be made");
    let archive = libraries().join("libstylusplayer.a");
    let archive = archive.to_str().expect("it is UTF-8");
    let flags = ["-std=c11", "-g", archive, "-lm", "-lpthread", "-ldl"];
    let program = compiled(("CC", "cc"), "../tests/door/mistakes.c", &flags, folder.path());
    let library = written(folder.path(), "textures.lib", digest_library());
    let valgrind = [
        "--quiet",
        "--error-exitcode=9",
        "--leak-check=full",
        "--show-leak-kinds=definite",
    ];
    run(Command::new("valgrind").args(valgrind).arg(program).arg(library));
}

/// What is instrumented is the C and C++ code, and all calls of the allocator and of threads, the library's too. Stable
/// Rust cannot instrument the library itself.
#[test]
#[ignore = "needs the compiler's sanitizers: tests/run long only 'the player under valgrind'"]
fn sanitizers_of_memory_and_of_threads_find_nothing_in_what_c_and_cpp_call() {
    let folder = tempfile::tempdir().expect("it can be made");
    let shared = shared();
    let linked = shared.each_ref().map(String::as_str);
    let library = written(folder.path(), "textures.lib", digest_library());
    let memory = ["-std=c11", "-fsanitize=address,undefined"];
    let threads = ["-std=c++17", "-fsanitize=thread"];
    for (compiler, source, flags, seconds) in [
        (("CC", "cc"), "../tests/door/mistakes.c", memory, None),
        (("CXX", "c++"), "two_threads.cpp", threads, Some("0.2")),
    ] {
        let flags = [&flags[..], &["-g", "-pthread", "-fno-sanitize-recover=all"], &linked].concat();
        let program = compiled(compiler, source, &flags, folder.path());
        run(Command::new(program).arg(&library).args(seconds));
    }
}

#[test]
fn a_control_loop_and_a_callback_in_two_threads_play_by_the_shared_library_in_cpp() {
    let folder = tempfile::tempdir().expect("it can be made");
    let [search, find, library] = &shared();
    let flags = ["-std=c++17", "-pthread", search, find, library];
    let program = compiled(("CXX", "c++"), "two_threads.cpp", &flags, folder.path());
    let library = written(folder.path(), "textures.lib", digest_library());
    let output = run_to_its_end(Command::new(program).arg(library).arg("0.2"));
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && told.contains("V RMS"), "{output:?}");
}

/// Waits for the end of a child that reads its own clock, and asks every 100 ms. Returns `None` after ten minutes,
/// which only a fault needs.
fn ended(child: &mut Child) -> Option<ExitStatus> {
    for _ in 0..6000 {
        if let Some(status) = child.try_wait().expect("it is a child") {
            return Some(status);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    None
}

/// Runs a child that reads its own clock, and ends it after ten minutes.
fn run_to_its_end(command: &mut Command) -> Output {
    let piped = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = piped.spawn().expect("it was compiled");
    // What it tells fits into a pipe.
    let is_over = ended(&mut child).is_some();
    if !is_over {
        let _ = child.kill();
    }
    let output = child.wait_with_output().expect("it is a child");
    assert!(is_over, "it does not end: {output:?}");
    output
}

/// JACK's server without a sound card, whose dummy takes samples as fast as a card would. It ends with its client.
struct Server(Child);

impl Server {
    const NAME: &str = "stylus-door";

    fn start() -> Self {
        let mut jackd = Command::new("jackd");
        jackd
            .args(["-n", Self::NAME, "--no-realtime", "--no-mlock", "--temporary"])
            .args(["-d", "dummy", "-r", "48000", "-p", "256"])
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let started = jackd.spawn();
        Self(
            started
                .unwrap_or_else(|error| panic!("jackd: {error}; `tests/run only 'the player by PortAudio'` brings it")),
        )
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Memory that it shares stays if it is killed.
        if std::thread::panicking() || ended(&mut self.0).is_none() {
            let _ = self.0.kill();
        }
    }
}

#[test]
#[ignore = "needs PortAudio and JACK: tests/run only 'the player by PortAudio'"]
fn what_portaudio_takes_is_a_texture_and_no_call_fails() {
    let folder = tempfile::tempdir().expect("it can be made");
    let libraries = libraries();
    let libraries = libraries.to_str().expect("it is UTF-8");
    // The folders of an unpacked PortAudio, and of what it needs.
    let others = std::env::var("LIBRARY_PATH").unwrap_or_default();
    let find = format!("-Wl,--disable-new-dtags,-rpath,{libraries}:{others}");
    let search = format!("-L{libraries}");
    let flags = [
        "-std=c++17",
        "-pthread",
        &search,
        &find,
        "-lstylusplayer",
        "-lportaudio",
    ];
    let program = compiled(("CXX", "c++"), "headphones.cpp", &flags, folder.path());
    let bytes = digest_library();
    let library = Library::decode(&bytes).expect("it is valid");
    let texture = library.texture_at(0).expect("there is one").name();
    let library = written(folder.path(), "textures.lib", &bytes);
    // ALSA's one device cannot be opened, so that PortAudio takes JACK's.
    let no_card = "pcm.default { type hw card 99 }";
    let no_card = written(folder.path(), "asound.conf", no_card);
    let mut server = Server::start();
    let mut player = Command::new(program);
    player
        .arg(library)
        .args([texture, "0.05", "1", "1"])
        .env("ALSA_CONFIG_PATH", no_card)
        .env("JACK_DEFAULT_SERVER", Server::NAME);
    // The server takes no client at first.
    let is_early = |output: &Output| String::from_utf8_lossy(&output.stderr).contains("no output");
    for _ in 0..3000 {
        let output = run_to_its_end(&mut player);
        let ended = server.0.try_wait().expect("it is a child");
        if !is_early(&output) {
            let told = String::from_utf8_lossy(&output.stdout);
            // 3 is its verdict on this machine's speed.
            let is_whole = [Some(0), Some(3)].contains(&output.status.code());
            assert!(is_whole && told.contains("buffers: 0 failed"), "{output:?}");
            return;
        }
        assert!(ended.is_none(), "jackd has ended: {ended:?}");
        std::thread::sleep(Duration::from_millis(100));
    }
    panic!("jackd takes no client");
}
