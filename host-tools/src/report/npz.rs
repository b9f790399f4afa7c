//! Arrays of numbers as a file that `numpy.load` reads: a zip archive, without compression, of NumPy's own format.
//!
//! Written as the arrays come, so that they need not be kept. Source of an array's form: NumPy's NEP 1, version 1.0.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use crate::support::error::{Error, Result};

/// An archive that is being written.
pub struct NpzWriter {
    path: PathBuf,
    archive: ZipWriter<BufWriter<File>>,
}

impl NpzWriter {
    /// Begins a file, in place of one that is there.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(Error::io("create", path))?;
        Ok(Self {
            path: path.to_owned(),
            archive: ZipWriter::new(BufWriter::new(file)),
        })
    }

    /// Writes an array of float64, the last index running fastest.
    ///
    /// # Errors
    /// A file that cannot be written, and an array of 4 GB.
    pub fn add(&mut self, name: &str, shape: &[usize], values: &[f64]) -> Result<()> {
        debug_assert_eq!(shape.iter().product::<usize>(), values.len());
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            // Equal data are to be equal files.
            .last_modified_time(DateTime::DEFAULT);
        let path = &self.path;
        let failed = |failure: ZipError| Error::io("write", path)(failure.into());
        let begun = self.archive.start_file(format!("{name}.npy"), options);
        begun.map_err(failed)?;
        let written = self.archive.write_all(&npy(shape, values));
        written.map_err(Error::io("write", path))
    }

    /// Ends the file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(self) -> Result<()> {
        let path = self.path;
        let file = self.archive.finish();
        let mut file = file.map_err(|failure| Error::io("write", &path)(failure.into()))?;
        file.flush().map_err(Error::io("write", &path))
    }
}

/// An array in NumPy's format.
fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    let axes: Vec<String> = shape.iter().map(|len| format!("{len},")).collect();
    let axes = axes.concat();
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({axes}), }}");
    // Magic, version and length of the header take ten bytes, and the data begin at a multiple of 64.
    let end = (10 + header.len() + 1).next_multiple_of(64);
    header.push_str(&" ".repeat(end - 10 - header.len() - 1));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_of_an_array_ends_at_a_multiple_of_64_bytes_and_the_values_follow() {
        for shape in [vec![3], vec![1, 3], vec![3, 1, 1]] {
            let bytes = npy(&shape, &[1.0, -2.5, f64::NAN]);
            let header = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            assert_eq!((10 + header) % 64, 0);
            assert_eq!(bytes[9 + header], b'\n');
            assert_eq!(bytes.len(), 10 + header + 24);
            assert_eq!(bytes[10 + header..18 + header], 1.0f64.to_le_bytes());
        }
    }

    #[test]
    fn the_directory_leads_to_every_array_and_its_bytes_have_their_check() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let mut writer = NpzWriter::create(&path).unwrap();
        let arrays = [
            ("one", vec![1.0, 2.0]),
            ("zwölf", vec![]),
            ("three.x", vec![0.5; 7]),
        ];
        for (name, values) in &arrays {
            writer.add(name, &[values.len()], values).unwrap();
        }
        writer.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let u16_at =
            |at: usize| usize::from(u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()));
        let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let end = bytes.len() - 22;
        assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
        assert_eq!(u16_at(end + 10), arrays.len());
        let mut at = u32_at(end + 16) as usize;
        for (name, values) in &arrays {
            assert_eq!(&bytes[at..at + 4], b"PK\x01\x02");
            let (check, size, len) = (u32_at(at + 16), u32_at(at + 24) as usize, u16_at(at + 28));
            let extra = u16_at(at + 30) + u16_at(at + 32);
            assert_eq!(
                &bytes[at + 46..at + 46 + len],
                format!("{name}.npy").as_bytes()
            );
            let entry = u32_at(at + 42) as usize;
            assert_eq!(&bytes[entry..entry + 4], b"PK\x03\x04");
            let data = entry + 30 + u16_at(entry + 26) + u16_at(entry + 28);
            let data = &bytes[data..data + size];
            assert_eq!(data, npy(&[values.len()], values));
            // Bit by bit, with the reversed polynomial of the standard.
            let crc = data.iter().fold(u32::MAX, |crc, byte| {
                (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                    (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
                })
            });
            assert_eq!(check, !crc);
            at += 46 + len + extra;
        }
        assert_eq!(at, end);
    }
}
