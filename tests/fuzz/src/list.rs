//! Lists of trials.

use std::fmt::Write;

use host_tools::recording::{RecordingSet, Trial};
use host_tools::support::hand::{MAX_FORCE_N, MAX_SPEED_MM_S};
use model_format::Provenance;

use crate::place;

/// Judges `input` as a list.
pub fn judge(input: &[u8]) {
    let path = place::written("trials.csv", input);
    let set = match RecordingSet::from_list(&path) {
        Ok(set) => set,
        Err(error) => return place::check(&error, &path, input),
    };
    for trial in &set.trials {
        assert!((0.0..=MAX_SPEED_MM_S).contains(&trial.speed_mm_s));
        assert!((0.0..=MAX_FORCE_N).contains(&trial.force_n));
        assert!(trial.scale().is_finite() && trial.scale() != 0.0);
        assert!(!trial.texture.is_empty() && !trial.texture.contains(char::is_control));
    }
    let groups = set.by_texture();
    assert_eq!(
        groups
            .iter()
            .map(|(_, members)| members.len())
            .sum::<usize>(),
        set.trials.len()
    );
    // Written as a list of its own, in two dialects, it is the same set.
    for (separator, decimal) in [(",", "."), (";", ",")] {
        let list = place::written(
            "again.csv",
            rewritten(&set.trials, separator, decimal).as_bytes(),
        );
        let again = RecordingSet::from_list(&list).expect("it was written from a list");
        assert_eq!(again, set);
    }
    if let Ok((snapped, _)) = set.clone().snapped(0.05) {
        for (before, after) in set.trials.iter().zip(&snapped.trials) {
            let moved = (before.speed_mm_s - after.speed_mm_s).abs();
            assert!(moved <= 0.05 * before.speed_mm_s.max(after.speed_mm_s) * (1.0 + 1e-9));
        }
    }
}

fn rewritten(trials: &[Trial], separator: &str, decimal: &str) -> String {
    let names = [
        "file",
        "texture",
        "speed_mm_s",
        "force_n",
        "scale_m_s2",
        "start_s",
        "duration_s",
        "sample_rate_hz",
        "simulated",
    ];
    let mut text = names.join(separator) + "\n";
    let number = |value: Option<f64>| {
        value.map_or(String::new(), |value| {
            format!("{value:?}").replace('.', decimal)
        })
    };
    for trial in trials {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let fields = [
            quoted(&trial.file.to_string_lossy()),
            quoted(&trial.texture),
            number(Some(trial.speed_mm_s)),
            number(Some(trial.force_n)),
            number(trial.scale_m_s2),
            number(Some(trial.start_s)),
            number(trial.duration_s),
            number(trial.sample_rate_hz),
            (trial.provenance == Provenance::Simulated).to_string(),
        ];
        writeln!(text, "{}", fields.join(separator)).expect("text grows");
    }
    text
}
