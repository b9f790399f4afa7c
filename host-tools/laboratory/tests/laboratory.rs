//! The laboratory's answers over files in memory, against the same functions over files of the disk.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use stylus_fit::fit::record::FitRecord;
use stylus_fit::fit::{Options, fit};
use stylus_laboratory::{Asked, answer};
use stylus_signals::recording::{RecordingSet, Trial, read};
use stylus_signals::rig::{RigFile, simulate_to_folder};
use stylus_support::Result;
use stylus_support::float_wav::float_wav;
use stylus_support::{atomic_file, files};

fn ask(asked: Value, bytes: &[u8]) -> Result<Value> {
    let asked: Asked = serde_json::from_value(asked).unwrap();
    answer(&asked, bytes.to_vec()).map(|answer| answer.told)
}

/// Puts all files of the disk below `folder` into memory, under the same paths, where they are read from then on.
fn mounted(folder: &Path) {
    let (mut folders, mut all) = (vec![folder.to_owned()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                all.push((std::fs::read(&path).unwrap(), path));
            }
        }
    }
    files::mount(folder);
    for (bytes, path) in all {
        ask(json!({ "ask": "put", "path": path }), &bytes).unwrap();
        std::fs::remove_file(path).unwrap();
    }
}

fn simulated(to: &Path) {
    let rig = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../examples/tutorial/rig.toml");
    let text = std::fs::read_to_string(&rig).unwrap();
    simulate_to_folder(&RigFile::from_toml(&rig, &text).unwrap(), 1, to, false).unwrap();
}

#[test]
fn files_in_memory_give_the_library_record_and_pages_of_those_on_the_disk() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("recordings");
    simulated(&folder);
    let set = RecordingSet::open(std::slice::from_ref(&folder)).unwrap();
    let options = Options::default();
    let on_disk = fit(&set, &options, |_| ()).unwrap();
    let bytes = on_disk.library().unwrap();
    let record = FitRecord::of(&set, &options, &bytes).unwrap().with_account_of(&on_disk);

    mounted(home.path());
    let rows = json!({ "ask": "rows", "folder": folder, "pattern": "", "known": [] });
    let rows = ask(rows, &[]).unwrap()["rows"].clone();
    assert_eq!(rows.as_array().unwrap().len(), set.trials.len());
    let library = home.path().join("textures.lib");
    let fitted = ask(
        json!({ "ask": "fit", "folder": folder, "rows": rows, "library": library }),
        &[],
    )
    .unwrap();
    assert_eq!(fitted["trials"].as_array().unwrap().len(), set.trials.len());
    let held = |path: &Path| files::held(path).unwrap();
    assert_eq!(*held(&library), *bytes);
    let text = String::from_utf8(held(&FitRecord::path_for(&library)).to_vec()).unwrap();
    assert_eq!(text, record.to_text().unwrap());

    let page = home.path().join("rub.html");
    let judge = json!({ "ask": "judge", "folder": folder, "library": library, "page": page,
        "report": home.path().join("report") });
    let judged = ask(judge, &[]).unwrap();
    assert!(
        judged["verdicts"][0].as_str().unwrap().starts_with("denim: "),
        "{judged}"
    );
    assert!(held(&page).starts_with(b"<!DOCTYPE html>"));
    assert!(held(Path::new(judged["report"].as_str().unwrap())).starts_with(b"<!DOCTYPE html>"));
    let stroke = home.path().join("stroke.wav");
    ask(
        json!({ "ask": "stroke", "library": library, "texture": 0, "path": stroke }),
        &[],
    )
    .unwrap();
    assert!(held(&stroke).starts_with(b"RIFF"));
    assert_eq!(
        std::fs::read_dir(&folder)
            .unwrap()
            .filter(|entry| entry.as_ref().unwrap().path().is_file())
            .count(),
        0
    );
}

#[test]
fn a_fault_of_a_file_has_the_same_words_in_memory() {
    let home = tempfile::tempdir().unwrap();
    let whole = float_wav(1, 5000, (0..5000).map(|n| f64::from(n).sin())).unwrap();
    let cases: [(&str, &[u8]); 5] = [
        ("empty.wav", b""),
        ("cut.wav", &whole[..200]),
        ("text.wav", b"this is no sound"),
        ("words.csv", b"time_s,x\n0,a\n0.001,b\n"),
        ("matrix.mat", b"MATLAB"),
    ];
    for (name, bytes) in cases {
        std::fs::write(home.path().join(name), bytes).unwrap();
    }
    // Two that are not there: one misspelt, one with a folder's name.
    let names = cases.iter().map(|(name, _)| *name).chain(["Cut.wav", "emptyy.wav", ""]);
    let told = || -> Vec<String> {
        let told = |name| read(&Trial::of(home.path().join(name), "t", 100.0, 1.0)).map(drop);
        names
            .clone()
            .map(|name| format!("{name}: {:?}", told(name).map_err(|fault| fault.to_string())))
            .collect()
    };
    let on_disk = told();
    mounted(home.path());
    assert_eq!(told(), on_disk);
}

#[test]
fn a_list_with_a_gap_names_the_line_and_a_unit_is_a_number_there() {
    let home = tempfile::tempdir().unwrap();
    files::mount(home.path());
    let folder = home.path().join("set");
    let wave = float_wav(1, 5000, (0..10_000).map(|n| f64::from(n * n % 17))).unwrap();
    for name in ["a <b>.wav", "=c.wav"] {
        atomic_file::write(&folder.join(name), &wave).unwrap();
    }
    let row =
        |file, speed| json!({ "file": file, "texture": "a", "speed_mm_s": speed, "force_n": "1", "scale_m_s2": "mg" });
    let fit = |rows: Value| {
        ask(
            json!({ "ask": "fit", "folder": folder, "rows": rows, "library": home.path().join("l.lib") }),
            &[],
        )
    };
    let refused = fit(json!([row("a <b>.wav", "100"), row("=c.wav", "")])).unwrap_err();
    test_helpers::holds(&refused, &["trials.csv, line 3: no speed_mm_s"]);
    fit(json!([row("a <b>.wav", "100"), row("=c.wav", "50")])).unwrap();
    let list = files::held(&folder.join("trials.csv")).unwrap();
    let set = RecordingSet::open(std::slice::from_ref(&folder)).unwrap();
    assert_eq!(
        set.trials[1].file,
        folder.join("=c.wav"),
        "{}",
        String::from_utf8_lossy(&list)
    );
    assert_eq!(set.trials[0].scale_m_s2, Some(0.009_806_65));
    // As a sound card's program writes it, which a fit must not forget.
    let sound = float_wav(1, 48_000, (0..96_000).map(|n| f64::from(n).sin())).unwrap();
    atomic_file::write(&folder.join("sound.wav"), &sound).unwrap();
    let row = json!({ "file": "sound.wav", "texture": "a", "speed_mm_s": "100", "force_n": "1" });
    let looked = ask(json!({ "ask": "look", "folder": folder, "row": row }), &[]).unwrap();
    assert!(looked["rms_m_s2"].is_null());
    test_helpers::holds(&looked["verdicts"].to_string(), &["its level is not known"]);
    assert_eq!(fit(json!([row])).unwrap()["trials"][0], looked["verdicts"]);
}
