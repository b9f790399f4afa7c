//! Liveliness through the command: textures with recorded snippets, compared with recordings made by the same rule.

use crate::support::{Bench, RATE_HZ, all_pole, denim_rig_of, holds, json, noise, scaled, text, wav};
use host_tools::dsp::sums::rms;
use model_format::{Library, PartsSpec, TextureSpec, encode};
use serde_json::Value;

const POLES: [f64; 2] = [-0.6, 0.7];

/// Impulsive noise of unit variance: Gaussian numbers to the power of 3/2.
fn impulsive(seed: u64, samples: usize) -> Vec<f64> {
    let raw: Vec<f64> = noise(seed, samples)
        .into_iter()
        .map(|x| x.signum() * x.abs().powf(1.5))
        .collect();
    scaled(&raw, 1.0 / rms(&raw))
}

/// Levels in steps of 0.25 dB, one per 20 ms: smoothed noise with a standard deviation of 3.5 dB. The mean square of
/// the gains is 1.
fn levels(seed: u64, entries: usize) -> Vec<i8> {
    let mut state = 0.0;
    let decibels: Vec<f64> = noise(seed, entries + 50)
        .iter()
        .map(|x| {
            state = 0.7 * state + 2.5 * x;
            state
        })
        .skip(50)
        .collect();
    let square = decibels.iter().map(|db| 10f64.powf(db / 10.0)).sum::<f64>() / entries as f64;
    let offset_db = 10.0 * square.log10();
    decibels
        .iter()
        .map(|db| (4.0 * (db - offset_db)).round().clamp(-127.0, 127.0) as i8)
        .collect()
}

/// 8 s of a surface: impulsive noise with varying level, through a filter.
fn recording(seed: u64) -> Vec<f64> {
    let levels = levels(seed + 1000, 410);
    let source = impulsive(seed, 40_000);
    let excited: Vec<f64> = source
        .iter()
        .enumerate()
        .map(|(n, x)| {
            let (at, share) = (n / 100, (n % 100) as f64 / 100.0);
            let amplitude = |at: usize| 10f64.powf(f64::from(levels[at]) * 0.25 / 20.0);
            x * (amplitude(at) + share * (amplitude(at + 1) - amplitude(at)))
        })
        .collect();
    all_pole(&POLES, &excited)
}

/// Two takes, and libraries of the first take, with and without parts.
fn bench() -> Bench {
    let bench = Bench::new();
    for (folder, seed) in [("set", 1), ("takes", 2)] {
        let file = wav(&[&recording(seed)], RATE_HZ);
        bench.write_set(folder, &[("felt", 100.0, 1.0, file)]);
    }
    bench.succeed("fit set --out plain.lib --order 20 --excitation snippets");
    let bytes = bench.read("plain.lib");
    let library = Library::decode(&bytes).unwrap();
    let texture = library.textures().next().unwrap();
    let spec = host_tools::scene::texture_spec(&texture);
    for (name, parts) in [("plain.lib", PartsSpec::default()), ("fed.lib", spec.parts.clone())] {
        let bytes = encode(&[TextureSpec { parts, ..spec.clone() }]);
        std::fs::remove_file(bench.path("plain.lib.fit.json")).ok();
        bench.write(name, bytes.unwrap());
    }
    bench
}

/// The figures of one signal, which `role` names, for the first texture.
fn of<'j>(evaluation: &'j Value, role: &str) -> &'j Value {
    let rows = evaluation["textures"][0]["liveliness"].as_array().unwrap();
    let is = |row: &&Value| row["role"] == role || row["role"]["version"] == role;
    rows.iter().find(is).unwrap_or_else(|| panic!("{role}: {rows:?}"))
}

fn difference(evaluation: &Value, role: &str, measure: &str) -> f64 {
    let differences = &of(evaluation, role)["differences"];
    differences[measure].as_f64().unwrap()
}

fn evaluated(bench: &Bench, library: &str, more: &str) -> (String, Value) {
    let said = bench.succeed(&format!(
        "evaluate set --library {library} --takes takes --synthesis 40 --json-out e.json {more}"
    ));
    (said, bench.report("e.json"))
}

#[test]
fn a_texture_with_parts_has_the_recordings_kurtosis_modulation_and_levels_and_without_them_it_has_not() {
    let bench = bench();
    let (said, evaluation) = evaluated(&bench, "fed.lib", "--full");
    let number = |role: &str, measure: &str| difference(&evaluation, role, measure);
    for (measure, most) in [
        ("kurtosis_octaves", 0.9),
        ("residual_kurtosis_octaves", 0.3),
        ("modulation_db", 1.5),
        ("level_spread_db", 2.0),
    ] {
        let (synthesis, gaussian) = (number("synthesis", measure), number("gaussian", measure));
        assert!(synthesis < most, "{measure}: {synthesis}");
        assert!(gaussian > 1.5 * synthesis, "{measure}: {gaussian}");
    }
    let parts = &of(&evaluation, "synthesis")["parts"];
    assert_eq!(parts, "recorded snippets");
    holds(&said, &["recording", "synthesis:", "recorded snippets"]);
    holds(&said, &["Gaussian", "other recording"]);
    // Without its parts, the texture must play the same as a texture that never had any.
    let (_, stripped) = evaluated(&bench, "fed.lib", "--played gaussian");
    let (_, plain) = evaluated(&bench, "plain.lib", "");
    let synthesis = |of_all: &Value| of(of_all, "synthesis")["median"].clone();
    assert_eq!(synthesis(&stripped), synthesis(&plain));
    assert_eq!(synthesis(&stripped), of(&evaluation, "gaussian")["median"]);
    // A texture without parts is played in no other version.
    let rows = plain["textures"][0]["liveliness"].as_array().unwrap();
    assert_eq!(rows.len(), 3, "{rows:?}");
}

/// Denim, SIMULATED, whose threads are not evenly spaced. Blocks that were not fitted are judged by the modulation of
/// the band.
#[test]
fn a_weave_of_uneven_threads_holds_still_where_noise_of_its_spectrum_swells() {
    let bench = Bench::new();
    bench.write("rig.toml", denim_rig_of("60, 120, 180, 240", "0.6, 1.2"));
    bench.succeed("simulate-rig --rig rig.toml --out set");
    let said = bench.succeed("fit set --out weave.lib");
    holds(&said, &["tied to position", "and its harmonics wander by"]);
    bench.succeed("evaluate set --library weave.lib --json-out e.json");
    let evaluation = bench.report("e.json");
    let number = |role: &str, measure: &str| difference(&evaluation, role, measure);
    for measure in ["modulation_db", "level_spread_db"] {
        let [synthesis, gaussian, other] = ["synthesis", "gaussian", "other"].map(|role| number(role, measure));
        assert!(synthesis < other + 1.0, "{measure}: {synthesis}, {other}");
        assert!(gaussian > 3.0 * synthesis, "{measure}: {gaussian}");
    }
    assert!(number("synthesis", "kurtosis_octaves") < 0.15);
    // Takes of other trials change nothing for one that has none: lines are sought in the blocks of all.
    bench.succeed("simulate-rig --rig rig.toml --out takes --seed 2");
    let list = text(&bench.read("takes/trials.csv"));
    let (few, _) = list.trim_end().rsplit_once('\n').unwrap();
    bench.write("takes/trials.csv", few);
    let told = bench.told("evaluate set --library weave.lib --takes takes --json-out t.json");
    holds(&told, &["1 of 8 trials are judged without --takes"]);
    let last = |of: &Value| {
        let mut last = of["trials"].as_array().unwrap().last().cloned().unwrap();
        // This is relative to the trials around it, which takes judge.
        last["loudest_5_ms"].take();
        last
    };
    assert_eq!(last(&bench.report("t.json")), last(&evaluation));
    bench.succeed("fit set --lines none --out noise.lib");
    let bytes = bench.read("noise.lib");
    let library = Library::decode(&bytes).unwrap();
    assert!(library.textures().next().unwrap().lines().is_none());
}

#[test]
fn a_page_for_listening_compares_every_pair_of_recording_and_two_libraries() {
    let bench = bench();
    let compare = "compare set --library fed.lib --takes takes --out page.html --trials 4 --seed 3";
    holds(&bench.succeed(&format!("{compare} --before plain.lib")), &["12 trials"]);
    let text = String::from_utf8(bench.read("page.html")).unwrap();
    let (_, rest) = text.split_once("id=\"plan\">").unwrap();
    let plan = json(rest.split_once("</script>").unwrap().0);
    for pair in ["recording-fitted", "recording-before", "before-fitted"] {
        let trials = plan["trials"].as_array().unwrap();
        assert_eq!(trials.iter().filter(|trial| trial["pair"] == pair).count(), 4, "{pair}");
    }
}
