//! Settings as a user writes them.

use host_tools::link::settings::changes;
use model_format::link::SettingsChange;

/// Judges `input` as words of a command line.
pub fn judge(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let words: Vec<String> = text.split('\n').map(str::to_owned).collect();
    let found = match changes(&words) {
        Ok(found) => found,
        Err(error) => {
            // One of the words is named.
            let problem = error.to_string();
            assert!(
                words.iter().any(|word| problem.contains(word.as_str())),
                "{problem}"
            );
            return;
        }
    };
    assert_eq!(2 * found.len(), words.len());
    let again: Vec<String> = found
        .iter()
        .flat_map(|change| {
            [
                change.setting.spec().name.to_owned(),
                format!("{:?}", change.value),
            ]
        })
        .collect();
    let again = changes(&again).expect("they were written from changes");
    for (before, after) in found.iter().zip(&again) {
        assert_eq!(before.setting, after.setting);
        assert_eq!(before.value.is_nan(), after.value.is_nan());
        assert!(before.value.is_nan() || before.value.to_bits() == after.value.to_bits());
    }
    // Values out of range are refused by name.
    if let Err(error) = SettingsChange::of(&found) {
        assert!(!error.to_string().is_empty());
    }
}
