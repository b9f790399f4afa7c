//! Descriptions of rigs as TOML.

use std::path::Path;

use host_tools::rig::RigFile;

use crate::place;

/// Judges `input` as a rig's description.
pub fn judge(input: &[u8]) {
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
        Err(error) => place::check(&error, path, input),
    }
}
