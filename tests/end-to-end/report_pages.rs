//! The pages of `evaluate --report` and `compare` as files: what they contain, and what is refused. How they behave in
//! a browser is tested in `tests/browser`.

use crate::support::{Bench, RATE_HZ, holds, json, noise, rig_of, scaled, text, two_textures, wav};

/// Simulated recordings of two textures, one of them much louder than the other, and their library.
fn simulated() -> Bench {
    let bench = Bench::new();
    let rig = rig_of("60, 120, 240", "0.4, 0.8, 1.2");
    let is_chosen = |part: &&str| !part.contains("\"organza\"") && !part.contains("\"vinyl\"");
    let chosen: Vec<&str> = rig.split("[[texture]]").filter(is_chosen).collect();
    bench.write("rig.toml", chosen.join("[[texture]]"));
    bench.succeed("simulate-rig --rig rig.toml --out set");
    bench.succeed("fit set --out a.lib --order 30");
    bench
}

/// The texts of elements that begin with `<tag`.
fn texts_of(page: &str, tag: &str) -> Vec<String> {
    let begin = format!("<{tag}");
    page.split(&begin)
        .skip(1)
        .filter_map(|piece| piece.split_once('>'))
        .map(|(_, rest)| rest.split('<').next().unwrap().trim().to_owned())
        .collect()
}

/// Asserts that a page has a recording and a synthesis of every node.
fn check_nodes(page: &str) {
    let nodes = page.split("id=\"nodes\">").nth(1).unwrap();
    let nodes = json(nodes.split("</script>").next().unwrap());
    for texture in ["paper", "denim"] {
        let own = &nodes["textures"][texture];
        let places = own["nodes"].as_array().unwrap();
        assert!(places.len() == 9 && places.contains(&serde_json::json!([120.0, 0.8])));
        let clips = own["clips"].as_array().unwrap();
        assert_eq!(clips.len(), 9);
        for clip in clips.iter().flat_map(|pair| pair.as_array().unwrap()) {
            // A clip has at least half a second at 5 kHz, in 16 bits and base64.
            assert!(clip.as_str().unwrap().len() > 5000 * 4 / 3);
        }
    }
}

#[test]
fn a_report_is_one_page_that_holds_everything_it_shows_with_pictures_beside() {
    let bench = simulated();
    let said = bench.succeed(
        "evaluate set --library a.lib --takes set --leave-one-out --order 30 --synthesis 4 --report folder \
         --json-out numbers.json",
    );
    holds(&said, &["folder/index.html", "SIMULATED"]);
    let page = text(&bench.read("folder/index.html"));
    // A zero is shown without a sign.
    for text in texts_of(&page, "td") {
        let is_zero = text.parse::<f64>().is_ok_and(|value| value == 0.0);
        assert!(!(is_zero && text.starts_with('-')), "{text}");
    }
    let parts = [
        "SIMULATED",
        "The test of the paper&#39;s Table I",
        "figure 7",
        "data:image/png;base64,",
        "are in the fitted set, and judge nothing",
        "fitted on every other block of 0.5 s",
        "silent trials",
        "<li>denim: spectrum",
        "<p class=\"verdict\">spectrum",
        "<details><summary>Waveforms",
        "<details><summary>Mean power spectral density",
        "What the spectrum does not show, of this trial",
        "mismatch C, %",
    ];
    holds(&page, &parts);
    // The page holds a recording and a synthesis of each texture, and denim without its weave's lines, as WAV files.
    assert_eq!(page.matches("<audio controls").count(), 5);
    assert_eq!(page.matches("src=\"data:audio/wav;base64,").count(), 5);
    assert!(page.contains("denim, 120 mm/s, 0.8 N: recorded (SIMULATED)"));
    assert!(page.len() < 4_000_000, "{}", page.len());
    check_nodes(&page);
    // Every picture is also a separate file.
    let entries = std::fs::read_dir(bench.path("folder")).unwrap();
    assert_eq!(
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| name.rsplit('.').next() == Some("svg"))
            .count(),
        page.matches("class=\"plot\"").count()
    );
    // A recording and its synthesis have one mean spectrum, in decibels, and a table of it.
    let table = text(&bench.read("folder/denim-psd.csv"));
    let rows: Vec<Vec<f64>> = table
        .strip_prefix("# SIMULATED\nfrequency_hz,recorded_db,synthesised_db\n")
        .unwrap()
        .lines()
        .map(|line| line.split(',').map(|value| value.parse().unwrap()).collect())
        .collect();
    let apart: Vec<f64> = rows
        .iter()
        .filter(|row| (50.0..500.0).contains(&row[0]))
        .map(|row| row[2] - row[1])
        .collect();
    let mean = apart.iter().sum::<f64>() / apart.len() as f64;
    assert!(apart.len() > 200 && mean.abs() < 1.5, "{mean} dB of {}", apart.len());
    let numbers = bench.report("numbers.json");
    assert_eq!(numbers["trials"].as_array().unwrap().len(), 18);
    let removed = numbers["removed_nodes"]["removed"].as_array().unwrap();
    assert_eq!(removed.len(), 2);
}

/// Takes half a minute of processor time; `tests/run long` runs it.
#[test]
#[ignore = "half a minute of the processor"]
fn the_sounds_of_a_page_take_24_megabytes_at_most_and_those_left_out_are_said() {
    /// With so many textures, two sounds of 3 s each, 16 bits at 20 kHz, exceed the bound.
    const TEXTURES: u64 = 106;
    const MOST_BYTES: usize = 24_000_000;
    let bench = Bench::new();
    let names: Vec<String> = (0..TEXTURES).map(|n| format!("texture {n}")).collect();
    let trials = (0..).zip(&names).map(|(seed, name)| {
        let signal = noise(seed, 6 * RATE_HZ as usize);
        (name.as_str(), 100.0, 1.0, wav(&[&signal], RATE_HZ))
    });
    bench.write_set("set", &trials.collect::<Vec<_>>());
    bench.succeed("fit set --order 2 --out a.lib");
    bench.succeed("evaluate set --library a.lib --report folder");
    let page = text(&bench.read("folder/index.html"));
    let sounds = page.split("data:audio/wav;base64,").skip(1);
    let bytes: usize = sounds
        .map(|sound| sound.find(['"', '\'', '`']).expect("it ends") / 4 * 3)
        .sum();
    assert!(bytes <= MOST_BYTES + 1000, "{bytes} bytes of sounds");
    assert!(bytes > MOST_BYTES / 2, "{bytes} bytes of sounds");
    assert!(page.contains("No sounds"), "what is left out is said");
}

const LISTENING: &str = "compare set --library textures.lib --out page.html --segment 0.4 --trials 14 --seed 9";

#[test]
fn a_seed_decides_a_page_for_listening_its_size_is_said_and_what_cannot_be_compared_is_refused() {
    let bench = two_textures(|signal| [scaled(signal, 1.0)]);
    bench.succeed("fit set --out textures.lib --order 20");
    let said = bench.succeed(LISTENING);
    let one = bench.read("page.html");
    assert!(!said.contains("SIMULATED"), "{said}");
    let megabytes = format!("{:.1} MB", one.len() as f64 / 1e6);
    holds(&said, &["14 trials", &megabytes]);
    bench.succeed(&format!("{LISTENING} --overwrite"));
    assert_eq!(bench.read("page.html"), one);
    let other = LISTENING.replace("--seed 9", "--seed 10 --overwrite");
    bench.succeed(&other);
    assert_ne!(bench.read("page.html"), one);

    // The textures use Gaussian noise. So one pair of different sounds is left, each of the two kinds is also compared
    // with itself, and the level is the only part that can be tested.
    for (design, trials) in [("similarity", "42 trials"), ("staircase", "up to 14 trials")] {
        let said = bench.succeed(&format!("{LISTENING} --overwrite --design {design}"));
        holds(&said, &[trials]);
        let page = text(&bench.read("page.html"));
        let said = bench.run(&format!("{LISTENING} --overwrite --design {design}"));
        assert_eq!(text(&bench.read("page.html")), page, "the seed decides it");
        let left_out = match design {
            "similarity" => ["recording-fitted: left out", "gaussian-fitted: left out"],
            _ => ["codebook: left out", "lines: left out"],
        };
        holds(&text(&said.stderr), &left_out);
    }
    refuse_what_cannot_be_compared(&bench);
}

fn refuse_what_cannot_be_compared(bench: &Bench) {
    let compare = "compare set --library textures.lib --out p.html";
    bench.refuse_each(&format!(
        "{compare} --design staircase --pairs recording-fitted | give --parts in place of --pairs
        {compare} --design staircase --parts lines | no texture has a part of --parts
        {compare} --pairs gaussian-fitted | nothing to compare
        {compare} --pairs recording-before | needs the library of before: give --before
        compare --score none.csv | none.csv
        compare --score textures.lib | give a file that the page of `stylus compare` saved"
    ));
    std::fs::remove_file(bench.path("textures.lib.fit.json")).unwrap();
    holds(&bench.refuse(compare), &["--takes"]);
    bench.fail(&format!("{compare} --segment 0.01"));
}
