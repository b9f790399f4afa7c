//! Library files: reading and decoding, with errors that name the file.

use std::path::Path;

use crate::support::bounded_file::{Limit, MIB};
use crate::support::error::{Error, Result};
use model_format::Library;

/// A library. A slot holds half a mebibyte; the decoder names the lengths of what is a little larger.
const LIBRARY: Limit = Limit {
    of: "a library",
    bytes: 16 * MIB,
};

/// Reads a library's bytes.
///
/// # Errors
/// A file that cannot be read, or is larger than any library.
pub fn read_library(path: &Path) -> Result<Vec<u8>> {
    LIBRARY.read(path)
}

/// Decodes a library; `path` is only named in errors.
///
/// # Errors
/// Bytes that are not a valid library, with the place.
pub fn decode_library<'a>(path: &Path, bytes: &'a [u8]) -> Result<Library<'a>> {
    Library::decode(bytes).map_err(|source| Error::Library {
        path: path.to_owned(),
        source,
    })
}
