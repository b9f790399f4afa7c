//! `stylus page`: one file with kernel, library, clips and spectra, and what it says of them.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use host_tools::report::rub_page::KERNEL;
use serde_json::Value;

use crate::support::{Bench, holds, scaled, text, two_textures};

/// Recordings of two textures, and their library.
fn fitted() -> Bench {
    let bench = two_textures(|signal| [scaled(signal, 1.0)]);
    bench.succeed("fit set --out textures.lib --order 20");
    bench
}

/// The content of the element `id` of a page.
fn element(bench: &Bench, page: &str, id: &str) -> String {
    let text = std::fs::read_to_string(bench.path(page)).unwrap();
    let (_, rest) = text.split_once(&format!("id=\"{id}\">")).unwrap();
    let (content, _) = rest.split_once("</").unwrap();
    content.to_owned()
}

fn data(bench: &Bench, page: &str) -> Value {
    serde_json::from_str(&element(bench, page, "data")).unwrap()
}

fn bytes(bench: &Bench, page: &str, id: &str) -> Vec<u8> {
    STANDARD.decode(element(bench, page, id)).unwrap()
}

#[test]
fn a_library_alone_makes_a_page_with_its_digests_and_its_size_is_said() {
    let bench = fitted();
    let said = bench.succeed("page textures.lib --out page.html");
    let library = std::fs::read(bench.path("textures.lib")).unwrap();
    assert_eq!(bytes(&bench, "page.html", "library"), library);
    assert_eq!(bytes(&bench, "page.html", "kernel"), KERNEL);
    let size = std::fs::metadata(bench.path("page.html")).unwrap().len();
    holds(
        &said,
        &[
            &format!("{:.2} MB", size as f64 / 1e6),
            "no clips of recordings",
        ],
    );
    assert!(!said.contains("SIMULATED"), "{said}");
    let data = data(&bench, "page.html");
    for texture in 0..2 {
        let name = data["textures"][texture]["name"].as_str().unwrap();
        let digest = data["digest"]["of_textures"][texture].as_str().unwrap();
        holds(&said, &[&format!("{name} {digest}")]);
        assert_eq!(digest.len(), 8);
    }
    assert_eq!(data["digest"]["words"], 50_000);
    let again = std::fs::read(bench.path("page.html")).unwrap();
    bench.succeed("page textures.lib --out page.html");
    assert_eq!(std::fs::read(bench.path("page.html")).unwrap(), again);
}

#[test]
fn recordings_are_fitted_as_fit_does_and_come_with_clips_spectra_and_costs() {
    let bench = two_textures(|signal| [scaled(signal, 1.0)]);
    bench.succeed("fit set --out textures.lib");
    let said = bench.succeed("page set --out page.html");
    holds(&said, &["8 clips of recordings"]);
    let library = std::fs::read(bench.path("textures.lib")).unwrap();
    assert_eq!(bytes(&bench, "page.html", "library"), library);
    let data = data(&bench, "page.html");
    let bands = data["frequencies_hz"].as_array().unwrap().len();
    for texture in data["textures"].as_array().unwrap() {
        assert_eq!(texture["map_quantity"], "C");
        let levels = |key: &str| {
            let coded = texture[key].as_str().unwrap();
            let bytes = STANDARD.decode(coded).unwrap();
            let codes = bytes.as_chunks().0.iter();
            codes
                .map(|code| i16::from_le_bytes(*code))
                .collect::<Vec<i16>>()
        };
        let (model, recorded) = (levels("model_base64"), levels("recorded_base64"));
        assert_eq!((model.len(), recorded.len()), (4 * bands, 4 * bands));
        // Mean difference of a model of order 400 and the recording that it is of.
        let apart = model
            .iter()
            .zip(&recorded)
            .map(|(m, r)| f64::from((m - r).abs()));
        let apart = apart.sum::<f64>() / model.len() as f64 / 100.0;
        assert!(apart < 2.0, "{apart} dB");
        for node in texture["nodes"].as_array().unwrap() {
            let cost = node["cost"].as_f64().unwrap();
            assert!((0.0..0.6).contains(&cost), "{cost}");
            let [model, recorded] =
                ["rms_m_s2", "recorded_rms_m_s2"].map(|key| node[key].as_f64().unwrap());
            assert!((model / recorded - 1.0).abs() < 0.05, "{model} {recorded}");
            assert!(node["clip"].is_u64());
        }
    }
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
        let node = &data["textures"][texture]["nodes"][clip["node"].as_u64().unwrap() as usize];
        let same = |key: &str| node[key] == clip[key];
        assert!(same("speed_mm_s") && same("force_n"), "{clip}");
        let codes = STANDARD
            .decode(clip["codes_base64"].as_str().unwrap())
            .unwrap();
        assert_eq!(codes.len(), 2000);
        let peak = clip["peak_m_s2"].as_f64().unwrap();
        let value = |code: u8| {
            let code = f64::from(code.cast_signed());
            code.signum() * peak * (256f64.powf(code.abs() / 127.0) - 1.0) / 255.0
        };
        let file = bench.path("set").join(clip["file"].as_str().unwrap());
        let mut reader = hound::WavReader::open(file).unwrap();
        let samples: Vec<f64> = match reader.spec().sample_format {
            hound::SampleFormat::Float => reader
                .samples::<f32>()
                .map(|x| f64::from(x.unwrap()))
                .collect(),
            hound::SampleFormat::Int => {
                let scale = f64::from(1u32 << (reader.spec().bits_per_sample - 1));
                reader
                    .samples::<i32>()
                    .map(|x| f64::from(x.unwrap()) / scale)
                    .collect()
            }
        };
        // The clip and its joint of 150 samples lie in the middle.
        let begin = (samples.len() - 2150) / 2;
        let pairs = codes[150..].iter().zip(&samples[begin + 150..]);
        let (mut error, mut energy) = (0.0, 0.0);
        for (&code, &sample) in pairs {
            error += (value(code) - sample).powi(2);
            energy += sample * sample;
        }
        assert!(error < 1e-3 * energy, "{clip}: {error} of {energy}");
    }
    assert!(
        data["clip_note"]
            .as_str()
            .unwrap()
            .contains("every recorded node")
    );
}

#[test]
fn what_makes_no_page_is_refused_with_the_remedy() {
    let bench = fitted();
    bench.write("page.txt", "none");
    for (arguments, word) in [
        ("page textures.lib --clips 1 --out p.html", "--recordings"),
        ("page set --recordings set --out p.html", "beside a library"),
        ("page none.lib --out p.html", "none.lib"),
        ("page page.txt --out p.html", "page.txt"),
        ("page textures.lib --out textures.lib", "textures.lib"),
    ] {
        holds(&bench.refuse(arguments), &[word]);
    }
    assert!(!bench.path("p.html").exists());
    let wrong = bench.run("page textures.lib --recordings set --clips 0.01 --out p.html");
    let said = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(
        !wrong.status.success() && said.contains("0.1 to 10"),
        "{said}"
    );
}

#[test]
fn the_demo_says_in_forty_lines_what_it_holds_and_its_page_has_one_and_a_half_megabytes() {
    let bench = Bench::new();
    let output = bench.run("demo --out demo");
    let said = text(&output.stdout) + &text(&output.stderr);
    assert!(said.lines().count() <= 40, "{said}");
    assert!(
        said.lines().all(|line| line.chars().count() <= 80),
        "{said}"
    );
    holds(
        &said,
        &["SIMULATED", "demo/page.html", "demo/report/index.html"],
    );
    // A surface with impulses, one that holds still, a calm one.
    let plays = [
        "scratched: moments",
        "denim: Gaussian + place",
        "paper: Gaussian;",
    ];
    holds(&said, &plays);
    let size = std::fs::metadata(bench.path("demo/page.html"))
        .unwrap()
        .len();
    assert!(size <= 1_500_000, "{size}");
    let data = data(&bench, "demo/page.html");
    assert_eq!(data["simulated"], true);
    let textures = data["textures"].as_array().unwrap();
    assert_eq!(textures.len(), 4);
    for texture in textures {
        let nodes = texture["nodes"].as_array().unwrap();
        assert_eq!(nodes.len(), 105);
        assert!(nodes.iter().any(|node| node["clip"].is_u64()));
        assert!(nodes.iter().all(|node| node["cost"].is_f64()));
    }
    holds(&data["clip_note"].as_str().unwrap(), &["nearest"]);
}

/// Impulsive noise: Gaussian numbers to the third power, of a kurtosis far above 3.
fn impulsive(signal: &[f64]) -> Vec<f64> {
    let rms = (signal.iter().map(|x| x * x).sum::<f64>() / signal.len() as f64).sqrt();
    signal.iter().map(|x| (x / rms).powi(3)).collect()
}

#[test]
fn what_plays_is_hardly_ever_beyond_full_scale_whatever_excites_it() {
    let plain = fitted();
    let lively = two_textures(|signal| [impulsive(signal)]);
    lively.succeed("fit set --out textures.lib --order 20 --excitation residual");
    let mut scales = Vec::new();
    for bench in [plain, lively] {
        bench.succeed("page textures.lib --out page.html");
        let data = data(&bench, "page.html");
        let full_scale = data["full_scale_m_s2"].as_f64().unwrap();
        let textures = data["textures"].as_array().unwrap();
        let rms = |texture: &Value| texture["highest_rms_m_s2"].as_f64().unwrap();
        let loudest = textures.iter().max_by(|a, b| rms(a).total_cmp(&rms(b)));
        let loudest = loudest.unwrap();
        let nodes = loudest["nodes"].as_array().unwrap();
        let level = |node: &&Value| node["rms_m_s2"].as_f64().unwrap();
        let node = nodes.iter().max_by(|a, b| level(a).total_cmp(&level(b)));
        let node = node.unwrap();
        bench.succeed(&format!(
            "render textures.lib --texture {} --speed {} --force {} --seconds 30 --out loudest.wav",
            loudest["name"].as_str().unwrap(),
            node["speed_mm_s"],
            node["force_n"]
        ));
        let wav = hound::WavReader::open(bench.path("loudest.wav")).unwrap();
        let samples: Vec<f32> = wav.into_samples().map(Result::unwrap).collect();
        let beyond = samples.iter().filter(|x| f64::from(x.abs()) > full_scale);
        let share = beyond.count() as f64 / samples.len() as f64;
        assert!(share < 1e-3, "{share} {full_scale}");
        scales.push(full_scale / rms(loudest));
    }
    // Not by so much that noise is hardly heard.
    assert!(scales[0] < 5.0 && scales[1] < 12.0, "{scales:?}");
}
