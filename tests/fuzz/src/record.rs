//! Records of fits as JSON.

use std::path::Path;

use host_tools::fit::record::FitRecord;

use crate::place;

/// Judges `input` as a record.
pub fn judge(input: &[u8]) {
    let path = Path::new("fuzz/a.lib.fit.json");
    let record = match FitRecord::from_text(path, input) {
        Ok(record) => record,
        Err(error) => return place::check(&error, path, input),
    };
    let text = record.to_text().expect("a record is text");
    let again = FitRecord::from_text(path, text.as_bytes()).expect("it was written from a record");
    assert_eq!(again.to_text().expect("a record is text"), text);
}
