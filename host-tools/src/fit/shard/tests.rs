use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use model_format::Provenance;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::file::{Header, Kind, frame};
use super::identity::{MapOptions, encoded, of_set};
use super::{Merged, Shard, map};
use crate::fit::lines::Lines;
use crate::fit::options::{Estimator, Order};
use crate::fit::record::FitRecord;
use crate::fit::{Fit, Options, fit};
use crate::recording::{RecordingSet, Trial};
use crate::support::error::Result;

const SAMPLES: usize = 2600;

/// Textures of the set.
const TEXTURES: [&str; 3] = ["felt", "cork", "tile"];

/// Writes a recording of coloured noise.
fn write(path: &Path, seed: u64) {
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: 5000,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    let mut writer = hound::WavWriter::create(path, spec).unwrap();
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let mut before = 0.0;
    for _ in 0..SAMPLES {
        let next: f64 = StandardNormal.sample(&mut random);
        before = 0.8 * before + next;
        writer.write_sample(before as f32).unwrap();
    }
    writer.finalize().unwrap();
}

/// A set of three textures, whose trials stand mixed in the list, with a copy of a trial in another texture.
fn set(folder: &Path) -> RecordingSet {
    let mut trials = Vec::new();
    for place in 0..4u64 {
        for (number, texture) in TEXTURES.iter().enumerate() {
            let file = folder.join(format!("{texture}-{place}.wav"));
            let is_copy = place == 3 && number == 2;
            let seed = if is_copy {
                1
            } else {
                10 * number as u64 + place + 1
            };
            write(&file, seed);
            trials.push(Trial {
                file,
                texture: (*texture).to_owned(),
                speed_mm_s: 50.0 + 40.0 * (place / 2) as f64,
                force_n: 0.5 + (place % 2) as f64,
                scale_m_s2: None,
                start_s: 0.0,
                duration_s: None,
                sample_rate_hz: None,
                provenance: Provenance::Recorded,
                held: None,
            });
        }
    }
    RecordingSet {
        trials,
        is_listed: true,
    }
}

fn options(lines: Lines) -> Options {
    Options {
        order: Order::AtMost(30),
        lines,
        ..Options::default()
    }
}

/// All that a fit leaves: the library's bytes, the record, the accounts of the trials, and the notes.
fn left_by(
    set: &RecordingSet,
    options: &Options,
    fit: &Fit,
    contents: Option<&[u64]>,
) -> Vec<String> {
    let bytes = model_format::encode(&fit.specs).unwrap();
    let record = match contents {
        None => FitRecord::of(set, options, &bytes).unwrap(),
        Some(contents) => FitRecord::with_contents(set, options, &bytes, contents),
    };
    vec![
        format!("{bytes:?}"),
        record.with_account_of(fit).to_text().unwrap(),
        serde_json::to_string(&fit.trials).unwrap(),
        fit.warnings.join("\n"),
    ]
}

fn merged(set: &RecordingSet, options: &Options, folder: &Path) -> Result<Vec<String>> {
    let merged = Merged::of_folder(set, options, folder, |_| ())?;
    let fit = merged.fit(|| ())?;
    Ok(left_by(set, options, &fit, Some(merged.contents())))
}

fn refusal(set: &RecordingSet, options: &Options, folder: &Path) -> String {
    merged(set, options, folder).unwrap_err().to_string()
}

fn part(folder: &Path, number: u32, of: u32) -> PathBuf {
    folder.join(Shard { number, of }.file_name())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, ..ProptestConfig::default() })]
    /// Also with more shards than units, some of which are then empty.
    #[test]
    fn shards_of_any_number_made_in_any_order_leave_what_one_process_leaves(
        of in 1u32..8, order in any::<prop::sample::Index>(), seeks_lines: bool,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let set = set(folder.path());
        let options = options(if seeks_lines { Lines::Auto } else { Lines::None });
        let whole = fit(&set, &options, || ()).unwrap();
        let copies = whole.trials.iter().flat_map(|trial| &trial.verdicts);
        prop_assert_eq!(copies.filter(|verdict| verdict.name() == "duplicate").count(), 1);
        let parts = folder.path().join("parts");
        let mut numbers: Vec<u32> = (1..=of).collect();
        numbers.rotate_left(order.index(of as usize));
        let mut trials = 0;
        for number in numbers {
            trials += map(&set, &options, Shard { number, of }, &parts, |_| ()).unwrap().trials;
        }
        prop_assert_eq!(trials, set.trials.len());
        prop_assert_eq!(merged(&set, &options, &parts).unwrap(), left_by(&set, &options, &whole, None));
    }
}

#[test]
fn a_shard_that_is_missing_doubled_or_foreign_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path());
    let (own, parts) = (options(Lines::Auto), folder.path().join("parts"));
    std::fs::create_dir(&parts).unwrap();
    assert!(refusal(&set, &own, &parts).contains("holds no shards"));
    map(&set, &own, Shard { number: 1, of: 2 }, &parts, |_| ()).unwrap();
    let missing = refusal(&set, &own, &parts);
    assert!(
        missing.contains("lacks 1 of 2") && missing.contains("--shard 2/2"),
        "{missing}"
    );
    let second = map(&set, &own, Shard { number: 2, of: 2 }, &parts, |_| ()).unwrap();
    merged(&set, &own, &parts).unwrap();

    let twice = parts.join("other.part");
    std::fs::copy(&second.path, &twice).unwrap();
    let doubled = refusal(&set, &own, &parts);
    assert!(
        doubled.contains("shard 2/2") && doubled.contains("other.part"),
        "{doubled}"
    );
    std::fs::remove_file(twice).unwrap();

    for (options, word) in [
        (
            Options {
                estimator: Estimator::Tapered,
                ..own.clone()
            },
            "--estimator auto",
        ),
        (
            Options {
                order: Order::Fixed(20),
                ..own.clone()
            },
            "orders up to 30",
        ),
        (
            Options {
                lines: Lines::None,
                ..own.clone()
            },
            "--lines auto",
        ),
        (
            Options {
                silence_floor_m_s2: 0.5,
                ..own.clone()
            },
            "--silence-floor",
        ),
        (
            Options {
                sample_rate_hz: 10_000,
                ..own.clone()
            },
            "--model-rate",
        ),
        (
            Options {
                drop: vec!["clipped".into()],
                ..own.clone()
            },
            "--drop",
        ),
    ] {
        let foreign = refusal(&set, &options, &parts);
        assert!(
            foreign.contains(word) && foreign.contains("shard-00001-of-00002"),
            "{foreign}"
        );
    }
    // What the map does not depend on may be another.
    merged(
        &set,
        &Options {
            order: Order::AtMost(30),
            strict: false,
            ..own.clone()
        },
        &parts,
    )
    .unwrap();

    let mut other = set.clone();
    other.trials[3].speed_mm_s += 1.0;
    let foreign = refusal(&other, &own, &parts);
    assert!(foreign.contains("another set"), "{foreign}");

    map(&set, &own, Shard { number: 1, of: 3 }, &parts, |_| ()).unwrap();
    let mixed = refusal(&set, &own, &parts);
    assert!(
        mixed.contains("1/3") && mixed.contains("one of 2"),
        "{mixed}"
    );
}

#[test]
fn a_recording_that_changed_since_its_shard_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path());
    let (own, parts) = (options(Lines::None), folder.path().join("parts"));
    map(&set, &own, Shard::WHOLE, &parts, |_| ()).unwrap();
    // Longer by some samples, so that its size is another whatever the clock's steps are.
    std::fs::copy(
        folder.path().join("felt-0.wav"),
        folder.path().join("cork-1.wav"),
    )
    .unwrap();
    let mut bytes = std::fs::read(folder.path().join("cork-1.wav")).unwrap();
    bytes.extend([0; 4]);
    std::fs::write(folder.path().join("cork-1.wav"), bytes).unwrap();
    let changed = refusal(&set, &own, &parts);
    assert!(
        changed.contains("cork-1.wav") && changed.contains("another size"),
        "{changed}"
    );
}

/// A journal that ends anywhere, also within a frame, is gone on with. Whole units in it are not computed again, and
/// the file is that of an uninterrupted map to the byte.
#[test]
fn an_interrupted_map_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path());
    let (own, parts) = (options(Lines::Auto), folder.path().join("parts"));
    let whole = map(&set, &own, Shard::WHOLE, &parts, |_| ()).unwrap();
    assert_eq!((whole.trials, whole.reused), (12, 0));
    let bytes = std::fs::read(&whole.path).unwrap();
    let journal = parts.join(format!("{}.unfinished", Shard::WHOLE.file_name()));
    let mut seen = BTreeMap::new();
    // The last end is given, because the file's length depends on the folder's name.
    for end in (0..bytes.len())
        .step_by(bytes.len() / 23)
        .chain([bytes.len() - 1])
    {
        std::fs::remove_file(&whole.path).unwrap();
        std::fs::write(&journal, &bytes[..end]).unwrap();
        let again = map(&set, &own, Shard::WHOLE, &parts, |_| ()).unwrap();
        assert_eq!(std::fs::read(&again.path).unwrap(), bytes, "{end}");
        assert!(!journal.exists());
        seen.insert(again.reused, end);
    }
    // A unit is a texture of four trials; all are there if only the file's end is not.
    assert_eq!(seen.keys().copied().collect::<Vec<_>>(), [0, 4, 8, 12]);
    let again = map(&set, &own, Shard::WHOLE, &parts, |_| ()).unwrap();
    assert_eq!(again.reused, 12);
}

#[test]
fn only_what_has_changed_is_computed_again() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path());
    let (own, parts) = (options(Lines::Auto), folder.path().join("parts"));
    let reused = |set: &RecordingSet, options: &Options| {
        map(set, options, Shard::WHOLE, &parts, |_| ())
            .unwrap()
            .reused
    };
    assert_eq!(reused(&set, &own), 0);
    let mut fewer = set.clone();
    fewer.trials.retain(|trial| trial.texture != "cork");
    assert_eq!(reused(&fewer, &own), 8);
    let mut faster = fewer.clone();
    faster.trials[0].speed_mm_s += 5.0;
    assert_eq!(reused(&faster, &own), 4);
    let tapered = Options {
        estimator: Estimator::Tapered,
        ..own.clone()
    };
    assert_eq!(reused(&faster, &tapered), 0);
    // A journal of other inputs, which an interruption left, is a source as well.
    let path = part(&parts, 1, 1);
    std::fs::rename(&path, path.with_extension("part.unfinished")).unwrap();
    let mut slower = faster.clone();
    slower.trials[0].speed_mm_s -= 9.0;
    assert_eq!(reused(&slower, &tapered), 4);
    let names = std::fs::read_dir(&parts)
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    assert_eq!(names.collect::<Vec<_>>(), [path.file_name().unwrap()]);
}

#[test]
fn a_file_with_any_byte_changed_or_cut_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path());
    let (own, parts) = (options(Lines::None), folder.path().join("parts"));
    let path = map(&set, &own, Shard::WHOLE, &parts, |_| ()).unwrap().path;
    let bytes = std::fs::read(&path).unwrap();
    let is_refused = |bytes: &[u8], what: &str| {
        std::fs::write(&path, bytes).unwrap();
        let refused = Merged::of_folder(&set, &own, &parts, |_| ()).map(|_| ());
        let message = refused.expect_err(what).to_string();
        assert!(message.contains("shard-00001-of-00001"), "{message}");
    };
    for at in (0..bytes.len())
        .step_by(bytes.len() / 61)
        .chain([0, 4, bytes.len() - 1])
    {
        let mut changed = bytes.clone();
        changed[at] ^= 0x10;
        is_refused(&changed, &format!("byte {at} changed"));
        is_refused(&bytes[..at], &format!("cut at {at}"));
    }
    is_refused(&[bytes.as_slice(), bytes.as_slice()].concat(), "doubled");
    std::fs::write(&path, &bytes).unwrap();
    merged(&set, &own, &parts).unwrap();
}

/// The number of shards sizes what the reduce makes, so that it is judged before.
#[test]
fn a_header_of_a_shard_that_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path());
    let options = options(Lines::None);
    for (number, of) in [(0, 1), (1, 0), (2, 1), (1, u32::MAX)] {
        let shard = Shard { number, of };
        let header = Header::new(
            MapOptions::of(&options),
            of_set(&set),
            set.trials.len(),
            shard,
        );
        let header = frame(Kind::Header, &[&encoded(&header).unwrap()]).unwrap();
        let path = folder.path().join("one.part");
        std::fs::write(&path, header).unwrap();
        let refused = Merged::of_files(&set, &options, &[path], |_| ());
        let message = refused.err().expect("no fit has such a shard").to_string();
        assert!(
            message.contains("one.part: is no partial result"),
            "{message}"
        );
    }
}

#[test]
fn each_texture_can_have_a_library_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path());
    let (own, parts) = (options(Lines::Auto), folder.path().join("parts"));
    map(&set, &own, Shard::WHOLE, &parts, |_| ()).unwrap();
    let merged = Merged::of_folder(&set, &own, &parts, |_| ()).unwrap();
    let whole = merged.fit(|| ()).unwrap();
    for (number, (name, members)) in set.by_texture().into_iter().enumerate() {
        let (part, contents, alone) = merged.fit_texture(&members).unwrap();
        assert_eq!(
            (part.trials.len(), contents.len(), alone.specs.len()),
            (4, 4, 1)
        );
        assert_eq!(alone.textures[0].name, name);
        assert_eq!(alone.specs[0].nodes, whole.specs[number].nodes);
        // The copy is known also where its original is in another library.
        let copies = alone.trials.iter().flat_map(|trial| &trial.verdicts);
        let count = copies
            .filter(|verdict| verdict.name() == "duplicate")
            .count();
        assert_eq!(count, usize::from(name == "tile"));
    }
}

#[test]
fn shards_are_given_as_a_number_of_a_number() {
    assert_eq!("3/8".parse(), Ok(Shard { number: 3, of: 8 }));
    for wrong in ["0/8", "9/8", "8", "a/b", "1/0", "1/1000000", "-1/2", ""] {
        assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
    }
}
