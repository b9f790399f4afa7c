//! Trials that are to be recorded.

use std::path::Path;

use model_format::limits::MAX_NAME_BYTES;

use crate::support::csv_table::{CsvTable, TABLE};
use crate::support::error::{Error, Result};
use crate::support::file_name;
use crate::support::hand::{force_fault, speed_fault};

/// A trial to be recorded: one texture at one speed and force.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedTrial {
    /// Name of the texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
}

impl PlannedTrial {
    /// The trials of a grid: every speed with every force.
    pub fn grid(texture: &str, speeds_mm_s: &[f64], forces_n: &[f64]) -> Vec<Self> {
        let at = |speed_mm_s: f64| {
            forces_n.iter().map(move |&force_n| Self {
                texture: texture.to_owned(),
                speed_mm_s,
                force_n,
            })
        };
        speeds_mm_s.iter().flat_map(|&speed| at(speed)).collect()
    }

    /// Reads a CSV list with the columns `speed_mm_s`, in mm/s, and `force_n`, in N. A column `texture` is optional;
    /// `texture` stands in for an empty or missing one.
    ///
    /// # Errors
    /// A file that cannot be read, a missing or unknown column, or a line without a texture or with a speed or force
    /// that is not a number of at least zero.
    pub fn from_csv(path: &Path, texture: Option<&str>) -> Result<Vec<Self>> {
        let table = CsvTable::read(path, TABLE)?;
        let header = table.header()?;
        let expected =
            "a list of trials to record has speed_mm_s, force_n, and texture if there are several";
        let speed = header.needed("speed_mm_s", expected)?;
        let force = header.needed("force_n", expected)?;
        let name = header.column("texture")?;
        let mut columns = header.names().enumerate();
        let known = [Some(speed), Some(force), name];
        if let Some((_, other)) = columns.find(|(index, _)| !known.contains(&Some(*index))) {
            return Err(header.error(format!("unknown column '{other}': {expected}")));
        }
        let mut trials = Vec::new();
        let mut rows = table.rows_below_header()?;
        while let Some(row) = rows.next_row()? {
            let own = name
                .map(|index| row.text(index))
                .filter(|name| !name.is_empty());
            let Some(texture) = own.or(texture) else {
                return Err(row.error("no texture: add a column 'texture', or give --texture"));
            };
            let sound = |index: usize, name: &str, fault: fn(f64) -> Option<String>| {
                let value = row.finite(index, name)?;
                let negative =
                    (value < 0.0).then(|| "negative: a trial is at 0 or above".to_owned());
                negative
                    .or_else(|| fault(value))
                    .map_or(Ok(value), |fault| {
                        Err(row.error(format!("{name} is {fault}")))
                    })
            };
            trials.push(Self {
                texture: texture.to_owned(),
                speed_mm_s: sound(speed, "speed_mm_s", speed_fault)?,
                force_n: sound(force, "force_n", force_fault)?,
            });
        }
        if trials.is_empty() {
            return Err(Error::file(
                path,
                "lists nothing to record: add at least one line",
            ));
        }
        Ok(trials)
    }

    /// Checks that the texture's name can be a folder's name, too.
    ///
    /// # Errors
    /// A name that is empty, too long, starts with a dot, or cannot name a folder on every system.
    pub fn check(&self) -> Result<()> {
        let name = &self.texture;
        let fault = if name.len() > MAX_NAME_BYTES {
            Some("is longer than a library can hold")
        } else if name.starts_with('.') {
            Some("must not start with a dot")
        } else {
            file_name::fault(name)
        };
        fault.map_or(Ok(()), |fault| {
            let problem = format!(
                "{name:?} cannot name a texture: it {fault}; use at most {MAX_NAME_BYTES} bytes"
            );
            Err(Error::Request(problem))
        })
    }

    /// Path of the trial's file, relative to the set's folder, with `/` as separator.
    pub(super) fn file(&self) -> String {
        format!(
            "{}/{}mm_s_{}N.wav",
            self.texture, self.speed_mm_s, self.force_n
        )
    }

    /// Identifies the trial within a set.
    pub(super) fn key(&self) -> (String, u64, u64) {
        key(&self.texture, self.speed_mm_s, self.force_n)
    }
}

impl std::fmt::Display for PlannedTrial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, {} mm/s, {} N",
            self.texture, self.speed_mm_s, self.force_n
        )
    }
}

/// Identifies the trial of a texture at a speed, mm/s, and a force, N. Equal numbers have equal bits.
pub(super) fn key(texture: &str, speed_mm_s: f64, force_n: f64) -> (String, u64, u64) {
    (texture.to_owned(), speed_mm_s.to_bits(), force_n.to_bits())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn planned(texture: &str, speed_mm_s: f64) -> PlannedTrial {
        PlannedTrial {
            texture: texture.to_owned(),
            speed_mm_s,
            force_n: 0.5,
        }
    }

    #[test]
    fn names_that_lead_out_of_the_folder_are_refused() {
        for name in [
            "",
            "..",
            "a/b",
            "a\\b",
            "C:x",
            "a\nb",
            "NUL",
            "x.",
            "e\u{301}",
            &"x".repeat(49),
        ] {
            assert!(planned(name, 1.0).check().is_err(), "{name}");
        }
        assert!(planned("denim (worn)", 1.0).check().is_ok());
    }

    #[test]
    fn a_list_of_points_may_name_their_textures() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str, texture| {
            std::fs::write(file.path(), text).unwrap();
            PlannedTrial::from_csv(file.path(), texture)
        };
        let named = read("texture,speed_mm_s,force_n\nsilk,50,0.5\n", None).unwrap();
        assert_eq!(named, [planned("silk", 50.0)]);
        let given = read("# mine\nspeed_mm_s, force_n\n50, 0.5\n", Some("silk")).unwrap();
        assert_eq!(given, named);
        for (text, word) in [
            ("speed_mm_s,force_n\n50,0.5\n", "no texture"),
            ("texture,speed_mm_s,force_n\nsilk,-1,0.5\n", "line 2"),
            ("texture,speed_mm_s,force_n\nsilk,fast,0.5\n", "line 2"),
            ("texture,speed_mm_s\nsilk,1\n", "force_n"),
            ("texture,speed_mm_s,force_n\n", "nothing to record"),
        ] {
            let message = read(text, None).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }
}
