//! Texts that a user writes or a command keeps: scenes and rigs as TOML, records of fits as JSON, settings as words,
//! and tables of motions, of strokes of a free hand, of answers and of planned trials.

use std::path::Path;
use std::sync::OnceLock;

use host_tools::evaluation::listening::{Answers, score};
use host_tools::fit::record::FitRecord;
use host_tools::link::settings::changes;
use host_tools::playing::motion::MotionPath;
use host_tools::procedures::set::PlannedTrial;
use host_tools::recording::{RATES_HZ, freehand};
use host_tools::rig::RigFile;
use host_tools::scene::{SceneFile, with_scenes};
use host_tools::support::number::{MAX_FORCE_N, MAX_SPEED_MM_S};
use model_format::link::SettingsChange;
use model_format::{CodeSpec, Library, NodeSpec, TextureSpec, encode};

use super::{check, guarded, written};

/// A library of one texture, `silk`.
fn library() -> &'static [u8] {
    static LIBRARY: OnceLock<Vec<u8>> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let node = NodeSpec::new(1.0, CodeSpec::lattice(vec![8000, -4000]));
        let texture = TextureSpec::new("silk", &[100.0], &[1.0], vec![node]);
        encode(&[texture]).expect("it is sound")
    })
}

/// Checks `input` as a scene's text.
pub fn scene(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let path = Path::new("fuzz/scene.toml");
    let file = match SceneFile::from_toml(path, text) {
        Ok(file) => file,
        Err(error) => return check(&error, path, input),
    };
    let library = Library::decode(library()).expect("it was encoded");
    let compiled = match file.compile(&library) {
        Ok(compiled) => compiled,
        Err(error) => return check(&error, path, input),
    };
    let bytes = with_scenes(&library, std::slice::from_ref(&compiled.scene)).expect("a library has room for a scene");
    let again = Library::decode(&bytes).expect("it was encoded");
    assert_eq!(again.scenes().next().as_ref(), Some(&compiled.scene));
}

/// Checks `input` as a rig's description.
pub fn rig(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let path = Path::new("fuzz/rig.toml");
    match RigFile::from_toml(path, text) {
        Ok(rig) => {
            assert_eq!(rig.text(), text);
            let again = RigFile::from_toml(path, rig.text()).expect("it was read before");
            assert_eq!(again.description(), rig.description());
        }
        Err(error) => check(&error, path, input),
    }
}

/// Checks `input` as a record of a fit.
pub fn record(input: &[u8]) {
    let path = Path::new("fuzz/a.lib.fit.json");
    let record = match FitRecord::from_text(path, input) {
        Ok(record) => record,
        Err(error) => return check(&error, path, input),
    };
    let text = record.to_text().expect("a record is text");
    let again = FitRecord::from_text(path, text.as_bytes()).expect("it was written from a record");
    assert_eq!(again.to_text().expect("a record is text"), text);
}

/// Checks `input` as words of a command line.
pub fn settings(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let words: Vec<String> = text.split('\n').map(str::to_owned).collect();
    let found = match changes(&words) {
        Ok(found) => found,
        Err(error) => {
            // The error must contain one of the words.
            let problem = error.to_string();
            assert!(words.iter().any(|word| problem.contains(word.as_str())), "{problem}");
            return;
        }
    };
    assert_eq!(2 * found.len(), words.len());
    let again: Vec<String> = found
        .iter()
        .flat_map(|change| [change.setting.spec().name.to_owned(), format!("{:?}", change.value)])
        .collect();
    let again = changes(&again).expect("they were written from changes");
    for (before, after) in found.iter().zip(&again) {
        assert_eq!(before.setting, after.setting);
        assert_eq!(before.value.is_nan(), after.value.is_nan());
        assert!(before.value.is_nan() || before.value.to_bits() == after.value.to_bits());
    }
    // Values out of range are refused with a message.
    if let Err(error) = SettingsChange::of(&found) {
        assert!(!error.to_string().is_empty());
    }
}

/// Checks `input` as a table of the kind that its first byte selects.
pub fn tables(input: &[u8]) {
    let Some((kind, table)) = input.split_first() else {
        return;
    };
    let path = written("table.csv", table);
    let judged = match kind % 4 {
        0 => motion(&path, table),
        1 => freehand::read(&path, None, None).map(|hand| check_hand(&hand)),
        2 => Answers::read_all(std::slice::from_ref(&path)).and_then(|answers| {
            for score in score(&answers)? {
                assert!((0.0..=1.0).contains(&score.proportion) && score.correct <= score.trials);
            }
            Ok(())
        }),
        _ => planned(&path),
    };
    if let Err(error) = judged {
        check(&error, &path, table);
    }
}

fn motion(path: &Path, table: &[u8]) -> host_tools::support::Result<()> {
    let motion = MotionPath::from_csv(path)?;
    let end_s = motion.duration_s();
    for share in [-1.0, 0.0, 0.25, 0.5, 1.0, 2.0] {
        let (speed, force) = motion.values_at(share * end_s);
        assert!(f64::from(speed.0).abs() <= MAX_SPEED_MM_S && f64::from(force.0).abs() <= MAX_FORCE_N);
        motion.at(share * end_s);
        assert!(!motion.position_mm_at(share * end_s).is_nan());
        assert!(motion.contact_at(share * end_s).is_none_or(|_| true));
    }
    assert!(motion.end_s(path).is_ok() == (end_s > 0.0));
    // The same table with another separator must be read as the same motion.
    // In a table with quotes, comments or another separator, an exchange of commas changes the meaning.
    let text = String::from_utf8_lossy(table);
    if !text.contains([';', '\t', ' ', '"', '#', '\r', '\u{feff}']) && text.contains(',') {
        let other = written("other.csv", text.replace(',', "\t").as_bytes());
        assert_eq!(MotionPath::from_csv(&other)?, motion);
    }
    Ok(())
}

fn check_hand(hand: &freehand::Freehand) {
    let count = hand.speed_mm_s.len();
    assert!(RATES_HZ.contains(&hand.rate_hz));
    assert!(count > 0 && hand.force_n.len() == count && hand.is_outlier.len() == count);
    assert!(
        hand.axes
            .iter()
            .all(|axis| axis.len() == count && axis.iter().all(|x| x.is_finite()))
    );
    assert!(
        hand.speed_mm_s
            .iter()
            .all(|speed| (0.0..=MAX_SPEED_MM_S).contains(speed))
    );
}

fn planned(path: &Path) -> host_tools::support::Result<()> {
    let trials = PlannedTrial::from_csv(path, Some("given"))?;
    let mut text = String::from("speed_mm_s;force_n;texture\n");
    for trial in &trials {
        let name = guarded(&trial.texture).replace('"', "\"\"");
        text.push_str(&format!("{:?};{:?};\"{name}\"\n", trial.speed_mm_s, trial.force_n));
        // Names that cannot be a folder's name are refused by a separate check.
        let _ = trial.check();
    }
    let again = written("again.csv", text.as_bytes());
    assert_eq!(PlannedTrial::from_csv(&again, None)?, trials);
    Ok(())
}
