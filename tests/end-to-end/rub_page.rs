//! `stylus page`: one file with kernel, library, clips and spectra, and what it states about them.

use std::collections::BTreeSet;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use host_tools::dsp::sums::rms;
use host_tools::report::rub_page::KERNEL;
use serde_json::Value;

use crate::support::{Bench, RATE_HZ, holds, json, scaled, text, two_textures};

/// Recordings of two textures, and their library.
fn fitted() -> Bench {
    let bench = two_textures(|signal| [scaled(signal, 1.0)]);
    bench.succeed("fit set --out textures.lib --order 20");
    bench
}

/// The content of the element `id` of a page.
fn element(bench: &Bench, page: &str, id: &str) -> String {
    let text = text(&bench.read(page));
    let (_, rest) = text.split_once(&format!("id=\"{id}\">")).unwrap();
    let (content, _) = rest.split_once("</").unwrap();
    content.to_owned()
}

fn data(bench: &Bench, page: &str) -> Value {
    json(&element(bench, page, "data"))
}

fn bytes(bench: &Bench, page: &str, id: &str) -> Vec<u8> {
    STANDARD.decode(element(bench, page, id)).unwrap()
}

#[test]
fn a_library_alone_makes_a_page_with_its_digests_and_its_size_is_said() {
    let bench = fitted();
    let said = bench.succeed("page textures.lib --out page.html");
    let library = bench.read("textures.lib");
    assert_eq!(bytes(&bench, "page.html", "library"), library);
    assert_eq!(bytes(&bench, "page.html", "kernel"), KERNEL);
    let again = bench.read("page.html");
    let size = format!("{:.1} MB", again.len() as f64 / 1e6);
    holds(&said, &[&size, "no clips of recordings"]);
    assert!(!said.contains("SIMULATED"), "{said}");
    let data = data(&bench, "page.html");
    for texture in 0..2 {
        let name = data["textures"][texture]["name"].as_str().unwrap();
        let digest = data["digest"]["of_textures"][texture].as_str().unwrap();
        holds(&said, &[&format!("{name} {digest}")]);
        assert_eq!(digest.len(), 8);
    }
    assert_eq!(data["digest"]["words"], 50_000);
    bench.succeed("page textures.lib --out page.html");
    assert_eq!(bench.read("page.html"), again);
    let notice = "<p class=\"notice\">SIMULATED";
    assert!(!String::from_utf8_lossy(&again).contains(notice));
}

#[test]
fn recordings_are_fitted_as_fit_does_and_come_with_clips_and_costs() {
    let bench = two_textures(|signal| [scaled(signal, 1.0)]);
    bench.succeed("fit set --out textures.lib");
    holds(&bench.succeed("page set --out page.html"), &["8 clips of recordings"]);
    let library = bench.read("textures.lib");
    assert_eq!(bytes(&bench, "page.html", "library"), library);
    for texture in data(&bench, "page.html")["textures"].as_array().unwrap() {
        assert!(texture["recorded_base64"].is_string());
        holds(&texture["verdict"], &["another part of the recording"]);
        for cost in texture["nodes"]["costs"].as_array().unwrap() {
            let cost = cost.as_f64().unwrap();
            assert!((0.0..0.6).contains(&cost), "{cost}");
        }
    }
}

#[test]
fn a_sound_alone_makes_the_page_of_the_library_that_fit_makes_of_it() {
    let bench = two_textures(|signal| [scaled(signal, 1.0)]);
    std::fs::copy(bench.path("set/silk-50-0.5.wav"), bench.path("phone.WAV")).unwrap();
    bench.succeed("fit phone.WAV --speed 80 --out phone.lib");
    bench.succeed("page phone.WAV --speed 80 --out page.html");
    let library = bench.read("phone.lib");
    assert_eq!(bytes(&bench, "page.html", "library"), library);
}

#[test]
fn a_clip_is_the_middle_of_its_nodes_recording() {
    let bench = fitted();
    bench.succeed("page textures.lib --recordings set --clips 0.4 --out page.html");
    let data = data(&bench, "page.html");
    let clips = data["clips"].as_array().unwrap();
    assert_eq!(clips.len(), 8);
    for clip in clips {
        let texture = clip["texture"].as_u64().unwrap() as usize;
        let [speeds, forces] =
            ["speeds_mm_s", "forces_n"].map(|key| data["textures"][texture][key].as_array().unwrap());
        let node = clip["node"].as_u64().unwrap() as usize;
        let place = (&speeds[node / forces.len()], &forces[node % forces.len()]);
        assert_eq!(place, (&clip["speed_mm_s"], &clip["force_n"]));
        let codes = clip["codes_base64"].as_str().unwrap();
        let codes = STANDARD.decode(codes).unwrap();
        assert_eq!(codes.len(), 2000);
        let peak = clip["peak_m_s2"].as_f64().unwrap();
        let value = |code: u8| {
            let code = f64::from(code.cast_signed());
            code.signum() * peak * (256f64.powf(code.abs() / 127.0) - 1.0) / 255.0
        };
        let file = format!("set/{}", clip["file"].as_str().unwrap());
        let samples = bench.samples(&file, RATE_HZ);
        // The clip, with its joint of 150 samples, is taken from the middle of the recording.
        let begin = (samples.len() - 2150) / 2;
        let pairs = codes[150..].iter().zip(&samples[begin + 150..]);
        let (mut error, mut energy) = (0.0, 0.0);
        for (&code, &sample) in pairs {
            error += (value(code) - sample).powi(2);
            energy += sample * sample;
        }
        assert!(error < 1e-3 * energy, "{clip}: {error} of {energy}");
    }
    holds(&data["clip_note"], &["every recorded node"]);
}

#[test]
fn what_makes_no_page_is_refused_with_the_remedy() {
    let bench = fitted();
    bench.write("page.txt", "none");
    bench.refuse_each(
        "page textures.lib --clips 1 --out p.html | --recordings
        page set --recordings set --out p.html | beside a library
        page none.lib --out p.html | none.lib
        page page.txt --out p.html | page.txt
        page textures.lib --out textures.lib | textures.lib",
    );
    assert!(!bench.path("p.html").exists());
    let wrong = bench.fail("page textures.lib --recordings set --clips 0.01 --out p.html");
    holds(&wrong, &["0.1 to 10"]);
}

#[test]
fn the_demo_says_in_forty_lines_what_it_holds_and_its_page_has_one_and_a_half_megabytes() {
    let bench = Bench::new();
    let output = bench.run("demo --out demo");
    // The command generates this data itself, so there is nothing to warn of.
    let warned = text(&output.stderr);
    assert!(!warned.contains("warning"), "{warned}");
    let said = text(&output.stdout) + &text(&output.stderr);
    assert!(said.lines().count() <= 40, "{said}");
    let is_wide = |line: &str| line.chars().count() > 80;
    assert!(!said.lines().any(is_wide), "{said}");
    holds(&said, &["SIMULATED", "demo/page.html"]);
    holds(&said, &["demo/report/index.html"]);
    // One surface has impulses, one has the lines of its weave, and one has neither.
    let plays = [
        "scratched: recorded snippets",
        "denim: Gaussian + lines",
        "paper: Gaussian;",
    ];
    holds(&said, &plays);
    // Nor does a line whose phase wanders leave noise in other bands.
    assert!(!said.contains("too strong"), "{said}");
    let size = bench.read("demo/page.html").len();
    assert!(size <= 1_500_000, "{size}");
    let data = data(&bench, "demo/page.html");
    assert_eq!(data["simulated"], true);
    let textures = data["textures"].as_array().unwrap();
    assert_eq!(textures.len(), 4);
    for texture in textures {
        let costs = texture["nodes"]["costs"].as_array().unwrap();
        assert_eq!(costs.len(), 120);
        assert!(costs.iter().all(Value::is_f64));
    }
    assert_eq!(
        data["clips"]
            .as_array()
            .unwrap()
            .iter()
            .map(|clip| clip["texture"].as_u64().unwrap())
            .collect::<BTreeSet<u64>>()
            .len(),
        4
    );
    holds(&data["clip_note"], &["nearest"]);
}

/// Impulsive noise: Gaussian numbers to the third power, with a kurtosis far above 3.
fn impulsive(signal: &[f64]) -> Vec<f64> {
    let rms = rms(signal);
    signal.iter().map(|x| (x / rms).powi(3)).collect()
}

#[test]
fn what_plays_is_hardly_ever_beyond_full_scale_whatever_excites_it() {
    let plain = fitted();
    let lively = two_textures(|signal| [impulsive(signal)]);
    lively.succeed("fit set --out textures.lib --order 20 --excitation snippets");
    let mut scales = Vec::new();
    for bench in [plain, lively] {
        bench.succeed("page textures.lib --out page.html");
        let data = data(&bench, "page.html");
        let full_scale = data["full_scale_m_s2"].as_f64().unwrap();
        let textures = data["textures"].as_array().unwrap();
        let rms = |texture: &Value| texture["highest_rms_m_s2"].as_f64().unwrap();
        let loudest = textures.iter().max_by(|a, b| rms(a).total_cmp(&rms(b))).unwrap();
        let levels = loudest["nodes"]["rms_m_s2"].as_array().unwrap();
        let level = |node: &usize| levels[*node].as_f64().unwrap();
        let node = (0..levels.len()).max_by(|a, b| level(a).total_cmp(&level(b)));
        let (node, forces) = (node.unwrap(), loudest["forces_n"].as_array().unwrap());
        bench.succeed(&format!(
            "render textures.lib --texture {} --speed {} --force {} --seconds 30 --out loudest.wav",
            loudest["name"].as_str().unwrap(),
            loudest["speeds_mm_s"][node / forces.len()],
            forces[node % forces.len()]
        ));
        let samples = bench.samples("loudest.wav", RATE_HZ);
        let share = samples.iter().filter(|x| x.abs() > full_scale).count() as f64 / samples.len() as f64;
        assert!(share < 1e-3, "{share} {full_scale}");
        scales.push(full_scale / rms(loudest));
    }
    // The scale is not so small that noise is hardly heard.
    assert!(scales[0] < 5.0 && scales[1] < 12.0, "{scales:?}");
}
