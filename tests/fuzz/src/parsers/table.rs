//! Tables of motions, of strokes of a free hand, of answers and of planned trials.

use std::path::Path;

use host_tools::evaluation::listening::{Answers, score};
use host_tools::playing::motion::MotionPath;
use host_tools::procedures::set::PlannedTrial;
use host_tools::recording::{RATES_HZ, freehand};
use host_tools::support::number::{MAX_FORCE_N, MAX_SPEED_MM_S};

use super::place;

/// Checks `input` as a table of the kind that its first byte selects.
pub fn judge(input: &[u8]) {
    let Some((kind, table)) = input.split_first() else {
        return;
    };
    let path = place::written("table.csv", table);
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
        place::check(&error, &path, table);
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
        let other = place::written("other.csv", text.replace(',', "\t").as_bytes());
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
        let name = place::guarded(&trial.texture).replace('"', "\"\"");
        text.push_str(&format!("{:?};{:?};\"{name}\"\n", trial.speed_mm_s, trial.force_n));
        // Names that cannot be a folder's name are refused by a separate check.
        let _ = trial.check();
    }
    let again = place::written("again.csv", text.as_bytes());
    assert_eq!(PlannedTrial::from_csv(&again, None)?, trials);
    Ok(())
}
