//! Library files: reading and decoding, with errors that name the file.

use std::path::Path;

use host_tools::support::error::{Error, Result};
use model_format::Library;

/// Reads a library's bytes.
pub fn read_library(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(Error::io("read", path))
}

/// Decodes a library; `path` is only named in errors.
pub fn decode_library<'a>(path: &Path, bytes: &'a [u8]) -> Result<Library<'a>> {
    Library::decode(bytes).map_err(|source| Error::Library {
        path: path.to_owned(),
        source,
    })
}
