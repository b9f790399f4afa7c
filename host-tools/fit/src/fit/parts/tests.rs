use std::path::Path;

use stylus_signals::recording::{RecordingSet, Trial};
use stylus_support::Result;
use stylus_support::float_wav::float_wav;

use super::{Mapped, Merged, Shard, map};
use crate::fit::lines::Lines;
use crate::fit::options::Order;
use crate::fit::record::FitRecord;
use crate::fit::{ExcitationChoice, Fit, FloorChoice, Options, fit};
use test_helpers::{holds, noise};

const SAMPLES: usize = 2600;

/// Textures of the set.
const TEXTURES: [&str; 3] = ["felt", "cork", "tile"];

/// Writes a recording of coloured noise.
fn write(path: &Path, seed: u64) {
    let mut before = 0.0;
    let samples = noise(seed, SAMPLES).into_iter().map(|next| {
        before = 0.8 * before + next;
        before
    });
    std::fs::write(path, float_wav(1, 5000, samples).unwrap()).unwrap();
}

/// Makes a set of three textures, whose trials are mixed in the list. One trial is a copy of a trial in another
/// texture.
fn set(folder: &Path) -> RecordingSet {
    let mut trials = Vec::new();
    for place in 0..4u64 {
        for (number, texture) in TEXTURES.iter().enumerate() {
            let file = folder.join(format!("{texture}-{place}.wav"));
            let is_copy = place == 3 && number == 2;
            write(&file, if is_copy { 1 } else { 10 * number as u64 + place + 1 });
            trials.push(Trial::of(
                file,
                (*texture).to_owned(),
                50.0 + 40.0 * (place / 2) as f64,
                0.5 + (place % 2) as f64,
            ));
        }
    }
    RecordingSet {
        trials,
        is_listed: true,
    }
}

fn options(lines: Lines) -> Options {
    Options {
        order: Order::Fixed(30),
        lines,
        ..Options::default()
    }
}

/// All results of a fit: the library's bytes, the record, the reports on the trials, and the notes.
fn left_by(set: &RecordingSet, options: &Options, fit: &Fit, contents: Option<&[u64]>) -> Vec<String> {
    let bytes = fit.library().unwrap();
    let record = match contents {
        None => FitRecord::of(set, options, &bytes).unwrap(),
        Some(contents) => FitRecord::with_contents(set, options, &bytes, contents),
    };
    vec![
        format!("{bytes:?}"),
        record.with_account_of(fit).to_text().unwrap(),
        serde_json::to_string(&fit.trials).unwrap(),
        format!("{:?}", fit.warnings()),
    ]
}

fn merged(set: &RecordingSet, options: &Options, folder: &Path) -> Result<Vec<String>> {
    let merged = Merged::of_folder(set, options, folder, |_| ())?;
    let fit = merged.fit(|| ())?;
    Ok(left_by(set, options, &fit, Some(merged.contents())))
}

fn mapped(set: &RecordingSet, options: &Options, shard: Shard, folder: &Path) -> Mapped {
    map(set, options, shard, folder, |_| ()).unwrap()
}

fn copies(trials: &[crate::fit::TrialReport]) -> usize {
    trials
        .iter()
        .flat_map(|trial| &trial.verdicts)
        .filter(|verdict| verdict.name() == "duplicate")
        .count()
}

/// Covers more shards than units, so that some are empty, and each texture by itself. The last case subtracts the rig's
/// noise, which the first trial of each texture, at 0 N, holds.
#[test]
fn shards_of_any_number_made_in_any_order_leave_what_one_process_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let mut set = set(folder.path());
    for (lines, floor, of) in [
        (Lines::Auto, FloorChoice::Note, 2),
        (Lines::None, FloorChoice::Note, 7),
        (Lines::None, FloorChoice::Subtract, 3),
    ] {
        if floor == FloorChoice::Subtract {
            set.trials[..TEXTURES.len()]
                .iter_mut()
                .for_each(|trial| trial.force_n = 0.0);
        }
        let options = Options {
            floor,
            ..options(lines)
        };
        let whole = fit(&set, &options, |_| ()).unwrap();
        assert_eq!(copies(&whole.trials), 1);
        let parts = folder.path().join(format!("parts-{of}"));
        let trials: usize = (1..=of)
            .rev()
            .map(|number| Shard { number, of })
            .map(|shard| mapped(&set, &options, shard, &parts).trials)
            .sum();
        assert_eq!(trials, set.trials.len());
        let expected = left_by(&set, &options, &whole, None);
        assert_eq!(merged(&set, &options, &parts).unwrap(), expected);

        let merged = Merged::of_folder(&set, &options, &parts, |_| ()).unwrap();
        for (number, name) in set.textures().into_iter().enumerate() {
            let (part, contents, alone) = merged.fit_texture(number).unwrap();
            assert_eq!((part.trials.len(), contents.len(), alone.textures.len()), (4, 4, 1));
            assert_eq!(alone.textures[0].nodes, whole.textures[number].nodes);
            assert!(
                alone.textures[0]
                    .members
                    .iter()
                    .map(|&member| &part.trials[member].file)
                    .eq(part.trials.iter().map(|own| &own.file))
            );
            // The copy is found even if its original is in another library.
            assert_eq!(copies(&alone.trials), usize::from(name == "tile"));
        }
    }
}

#[test]
fn a_merge_refuses_what_is_missing_damaged_or_of_other_inputs_and_a_map_computes_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut set = set(folder.path());
    let (own, parts) = (options(Lines::Auto), folder.path().join("parts"));
    std::fs::create_dir(&parts).unwrap();
    let refused = |set: &RecordingSet, options: &Options, word: &str| {
        holds(&merged(set, options, &parts).unwrap_err(), &[word]);
    };
    refused(&set, &own, "lacks the results of 12 of 12 trials");
    mapped(&set, &own, Shard { number: 1, of: 2 }, &parts);
    refused(&set, &own, "lacks the results of 4 of 12 trials");
    mapped(&set, &own, Shard { number: 2, of: 2 }, &parts);
    merged(&set, &own, &parts).unwrap();

    let reused = |set: &RecordingSet, options: &Options| mapped(set, options, Shard::WHOLE, &parts).reused;
    assert_eq!(reused(&set, &own), 12);
    let changed = |change: &dyn Fn(&mut Options)| {
        let mut options = own.clone();
        change(&mut options);
        options
    };
    for other in [
        changed(&|options| options.order = Order::Fixed(20)),
        changed(&|options| options.lines = Lines::None),
        changed(&|options| options.floor = FloorChoice::Subtract),
        changed(&|options| options.silence_floor_m_s2 = 0.5),
        changed(&|options| options.drop = vec!["clipped".into()]),
    ] {
        refused(&set, &other, "lacks the results of 12 of 12 trials");
    }
    // Options that the map does not depend on may change.
    let gaussian = changed(&|options| options.excitation = ExcitationChoice::Gaussian);
    merged(&set, &gaussian, &parts).unwrap();

    // A unit is a texture of four trials. It is computed again if a line of its list or one of its recordings changes.
    set.trials[0].speed_mm_s += 5.0;
    refused(&set, &own, "lacks the results of 4 of 12 trials");
    assert_eq!(reused(&set, &own), 8);
    let file = &set.trials[1].file;
    let mut bytes = std::fs::read(file).unwrap();
    bytes.extend([0; 4]);
    std::fs::write(file, bytes).unwrap();
    refused(&set, &own, "cork-0.wav");
    assert_eq!(reused(&set, &own), 8);

    // A measured speed that is snapped to the same node matters to lines only.
    let plain = options(Lines::None);
    assert_eq!(reused(&set, &plain), 0);
    set.trials[0].measured_speed_mm_s = Some(set.trials[0].speed_mm_s + 0.1);
    refused(&set, &own, "lacks the results of 4 of 12 trials");
    assert_eq!((reused(&set, &own), reused(&set, &plain)), (8, 12));

    refuses_damage(&set, &own, &parts);
}

/// Checks that a unit is computed again if its file is damaged anywhere, truncated or too long.
fn refuses_damage(set: &RecordingSet, own: &Options, parts: &Path) {
    let unit = &super::unit::units(set, own)[2][0];
    let path = unit.path(set, own, parts).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for at in (0..bytes.len()).step_by(bytes.len() / 61) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x10;
        for damaged in [&changed[..], &bytes[..at], &[bytes.as_slice(), b"x"].concat()] {
            std::fs::write(&path, damaged).unwrap();
            assert!(unit.read(&path).is_err(), "{at}");
        }
    }
    holds(&merged(set, own, parts).unwrap_err(), &["is damaged"]);
    assert_eq!(mapped(set, own, Shard::WHOLE, parts).reused, 8);
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

#[test]
fn shards_are_given_as_a_number_of_a_number() {
    assert_eq!("3/8".parse(), Ok(Shard { number: 3, of: 8 }));
    for wrong in ["0/8", "9/8", "8", "a/b", "1/0", "1/1000000", "-1/2", ""] {
        assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
    }
}
