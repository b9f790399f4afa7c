//! The examples in C and C++, compiled by the compilers of the system: `CC` and `CXX`, or cc and c++.

use std::path::{Path, PathBuf};
use std::process::Command;

use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::Rendering;
use kernel_vectors::digest_library;
use model_format::Library;

/// The folder of the tests' programs, which has the libraries too.
fn libraries() -> PathBuf {
    let test = std::env::current_exe().expect("it runs");
    test.parent().expect("it is in a folder").to_owned()
}

fn run(command: &mut Command) -> String {
    let output = command.output();
    let output =
        output.unwrap_or_else(|error| panic!("{command:?}: {error}; install a C and C++ compiler"));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{command:?}: {}\n{told}",
        output.status
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Compiles an example with the flags that make any warning an error.
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
    let flags = [
        "-std=c11",
        "-ffp-contract=off",
        archive,
        "-lm",
        "-lpthread",
        "-ldl",
    ];
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
    let rendered = rendering.flat_map(|word| word.metres_per_second_squared().0.to_le_bytes());
    let rendered: Vec<u8> = rendered.collect();
    let played = std::fs::read(wav).expect("it was written");
    let (header, played) = played.split_at(44);
    assert_eq!(&header[36..40], b"data");
    assert_eq!(played.len(), 40_000);
    assert!(played == rendered);
    assert!(rendered.iter().any(|byte| *byte != 0));
}

#[test]
fn a_control_loop_and_a_callback_in_two_threads_play_by_the_shared_library_in_cpp() {
    let folder = tempfile::tempdir().expect("it can be made");
    let libraries = libraries();
    let libraries = libraries.to_str().expect("it is UTF-8");
    let (search, find) = (format!("-L{libraries}"), format!("-Wl,-rpath,{libraries}"));
    let flags = ["-std=c++17", "-pthread", &search, &find, "-lstylusplayer"];
    let program = compiled(("CXX", "c++"), "two_threads.cpp", &flags, folder.path());
    let library = written(folder.path(), "textures.lib", digest_library());
    let told = run(Command::new(program).arg(library).arg("1"));
    assert!(told.contains("V RMS"), "{told}");
}
