//! Sets of many trials: the memory of a fit grows in proportion to their number, and no faster.
//!
//! The trials are short, so that thousands of them are generated and fitted in seconds.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::support::{Bench, RATE_HZ, all_pole, holds, noise, wav};

/// Number of samples per trial.
const SAMPLES: usize = 500;

/// Speeds, mm/s, and also forces, N, of every texture.
const AXIS: std::ops::RangeInclusive<usize> = 1..=10;

/// Number of trials per texture.
const TEXTURE_TRIALS: usize = 100;

/// Largest memory, bytes, that each of the [`WAYS`] may use per additional trial. For one library, a fit keeps the data
/// that models are fitted to, and the samples twice, up to a bound that is not reached here: with four bytes for
/// comparison, and with eight bytes for playing. For a library per texture it keeps what is reported, about 2500 bytes,
/// with which runs differ by a tenth; kept samples would add 4000 bytes, and the bound is half way.
const MOST_TRIAL_BYTES: [f64; 3] = [8192.0 + 12.0 * SAMPLES as f64, 4500.0, 4500.0];

/// Writes the set `set` of `trials` trials, each with noise of its own. Next to its list is a second list, `few.csv`,
/// where the trials of a texture are at only two speeds, so that all fit in one library.
fn generate(bench: &Bench, trials: usize) {
    let mut list = String::from("file,texture,speed_mm_s,force_n\n");
    let mut few = list.clone();
    for texture in 0..trials / TEXTURE_TRIALS {
        let mut number = TEXTURE_TRIALS * texture;
        for speed in AXIS {
            for force in AXIS {
                let signal = all_pole(&[-0.9, 0.5], &noise(number as u64, SAMPLES));
                let name = format!("{texture:04}/{speed}-{force}.wav");
                bench.write(&format!("set/{name}"), wav(&[&signal], RATE_HZ));
                let low_or_high = 50 + 100 * (speed % 2);
                few.push_str(&format!("{name},texture {texture:04},{low_or_high},1\n"));
                let (speed, force) = (20 * speed, 0.2 * force as f64);
                list.push_str(&format!("{name},texture {texture:04},{speed},{force}\n"));
                number += 1;
            }
        }
    }
    bench.write("set/trials.csv", list);
    bench.write("set/few.csv", few);
}

/// Runs `stylus` in the folder. Returns its largest resident memory, bytes, its exit code and its messages.
///
/// The kernel's own record of the peak is read every few milliseconds, because it vanishes with the process.
fn watched(bench: &Bench, arguments: &str) -> (f64, Option<i32>, String) {
    let told = bench.path("told");
    let mut child = Command::new(env!("CARGO_BIN_EXE_stylus"))
        .args(arguments.split_whitespace())
        .current_dir(bench.path(""))
        .env("XDG_CONFIG_HOME", bench.path("no-configuration"))
        // Each thread has buffers of its own, and their number would depend on the computer.
        .env("RAYON_NUM_THREADS", "2")
        .stdout(File::create(bench.path("said")).unwrap())
        .stderr(File::create(&told).unwrap())
        .spawn()
        .expect("the command starts");
    let status = format!("/proc/{}/status", child.id());
    let mut peak_bytes = 0.0;
    let ended = loop {
        peak_bytes = high_water_mark(Path::new(&status)).unwrap_or(peak_bytes);
        if let Some(ended) = child.try_wait().expect("it is a child") {
            break ended;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    assert!(peak_bytes > 0.0, "nobody told its memory");
    let told = std::fs::read_to_string(told).unwrap();
    (peak_bytes, ended.code(), told)
}

/// Runs `stylus` like [`watched`]. It must succeed.
fn succeeds(bench: &Bench, arguments: &str) -> f64 {
    let (peak_bytes, code, told) = watched(bench, arguments);
    assert_eq!(code, Some(0), "stylus {arguments}: {told}");
    peak_bytes
}

/// Largest resident memory of the process with this status file, bytes; `None` after the end of the process.
fn high_water_mark(status: &Path) -> Option<f64> {
    let text = std::fs::read_to_string(status).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: f64 = line.trim().strip_suffix(" kB")?.parse().ok()?;
    Some(1024.0 * kilobytes)
}

/// The ways of fitting a set.
const WAYS: [&str; 3] = ["one library", "a library per texture", "these again"];

/// Fits a set of `trials` trials at order 400 in each of the [`WAYS`].
fn measured(trials: usize) -> [f64; 3] {
    let bench = Bench::new();
    generate(&bench, trials);
    let fit = "fit --order 400";
    let one = format!("{fit} set/few.csv --excitation gaussian --out one.lib");
    let one = succeeds(&bench, &one);
    let each = succeeds(&bench, &format!("{fit} set --each --out each"));
    // What is kept of a trial does not depend on the excitation, so no trial is computed again.
    let again = format!("{fit} set --each --out again --parts each/parts --excitation gaussian");
    let again = succeeds(&bench, &again);
    for folder in ["each", "again"] {
        let entries = std::fs::read_dir(bench.path(folder)).unwrap();
        assert_eq!(
            entries
                .map(|entry| entry.unwrap().file_name())
                .filter(|name| name.to_string_lossy().ends_with(".lib"))
                .count(),
            trials / TEXTURE_TRIALS
        );
    }
    [one, each, again]
}

#[test]
fn a_fit_s_memory_grows_by_a_few_kilobytes_per_trial_at_most() {
    let [few, many] = [400, 3200];
    let (small, large) = (measured(few), measured(many));
    for (index, way) in WAYS.iter().enumerate() {
        let slope = (large[index] - small[index]) / (many - few) as f64;
        let most = MOST_TRIAL_BYTES[index];
        assert!(slope < most, "{way}: {slope:.0} bytes per trial");
    }
}

/// Writes a file with `begin`, followed by `line` repeated `times` times.
fn write_many(bench: &Bench, name: &str, begin: &str, line: &str, times: usize) {
    let mut file = BufWriter::new(File::create(bench.path(name)).unwrap());
    file.write_all(begin.as_bytes()).unwrap();
    for _ in 0..times {
        file.write_all(line.as_bytes()).unwrap();
    }
    file.flush().unwrap();
}

#[test]
fn a_table_takes_the_memory_of_its_samples_however_long_or_wide_it_is() {
    /// Largest permitted difference of the peak memory from that of a fit of the short table, bytes.
    const MOST_BYTES: f64 = 24e6;
    let bench = Bench::new();
    let samples = all_pole(&[-0.9, 0.5], &noise(1, 10_000));
    let rows: Vec<String> = samples.iter().map(f64::to_string).collect();
    let rows = rows.join("\n") + "\n";
    let fit = |name: &str| format!("fit {name} --sample-rate 5000 --out a.lib --overwrite");
    bench.write("short.csv", &rows);
    let least = succeeds(&bench, &fit("short.csv"));
    let comment = "# nothing is said in this line\n";
    write_many(&bench, "long.csv", &rows, comment, 2_000_000);
    let long = succeeds(&bench, &fit("long.csv"));
    assert!(long < least + MOST_BYTES, "{long} after {least}");
    let wide = "0,".repeat(500_000) + "\n";
    write_many(&bench, "wide.csv", "", &wide, 40);
    write_many(&bench, "line.csv", "x\n", "0,", 20_000_000);
    for (name, words) in [
        ("wide.csv", "line 1: a row of more than 16384 fields"),
        ("line.csv", "line 2: a row of more than 1048576 bytes"),
    ] {
        let (peak, code, told) = watched(&bench, &fit(name));
        assert_eq!(code, Some(2), "{told}");
        holds(&told, &[words]);
        assert!(peak < least + MOST_BYTES, "{name}: {peak} after {least}");
    }
}
