//! HaTT's model files.

use host_tools::fit::hatt::import::{Options, plan, read_all};
use host_tools::support::error::Error;

use crate::place;

/// Judges `input` as a model file.
pub fn judge(input: &[u8]) {
    let path = place::written("Models_fuzz.xml", input);
    let sources = match read_all(std::slice::from_ref(&path)) {
        Ok(sources) => sources,
        Err(error) => return place::check(&error, &path, input),
    };
    let toolkit = &sources[0].toolkit;
    assert!(!toolkit.models.is_empty());
    let corners = toolkit.triangles.iter().flatten();
    assert!(
        corners
            .into_iter()
            .all(|&corner| corner < toolkit.models.len())
    );
    for model in &toolkit.models {
        assert!(model.speed_mm_s.is_finite() && model.force_n.is_finite());
    }
    let options = Options {
        speeds: Some(2),
        forces: Some(2),
    };
    // A grid that no slot holds is refused for all files together.
    match plan(&sources, &options) {
        Ok(_) | Err(Error::Request(_)) => {}
        Err(error) => place::check(&error, &path, input),
    }
}
